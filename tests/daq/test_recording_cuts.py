"""A recording cut off anywhere in its last 64 KiB: no exception, every whole chunk read, the loss listed."""

from __future__ import annotations

import itertools
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from recording_cuts import TAIL_BYTES, check_cut, check_cuts, truth_of, write_everything

from daq.recording import Recording

_PROCESSES = 2
_PIECES = 16


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write_everything(path)
    assert path.stat().st_size > TAIL_BYTES
    assert Recording.open(path).loss == ()
    return path


@pytest.mark.parametrize("places", [100, pytest.param(500, marks=pytest.mark.slow)])
def test_cut_at_many_places(whole, places, tmp_path):
    truth, data = truth_of(whole), whole.read_bytes()
    assert len(truth.events) == 14
    rng = np.random.default_rng(11)
    cut_path = tmp_path / "cut.mcap"
    for size in rng.choice(np.arange(len(data) - TAIL_BYTES, len(data)), places, replace=False).tolist():
        cut_path.write_bytes(data[:size])
        check_cut(cut_path, size, truth)


def test_a_file_without_a_chunk(whole, tmp_path):
    truth, data = truth_of(whole), whole.read_bytes()
    cut_path = tmp_path / "cut.mcap"
    for size in [*range(64), *range(64, truth.ends[0] + 50, 37)]:
        cut_path.write_bytes(data[:size])
        check_cut(cut_path, size, truth)


@pytest.mark.parametrize("step", [pytest.param(31, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.study)])
def test_cut_at_many_bytes_and_at_every_one(whole, tmp_path, step):
    truth, size = truth_of(whole), whole.stat().st_size
    edges = np.linspace(size - TAIL_BYTES, size, _PIECES + 1).astype(int).tolist()
    pieces = [range(low, high, step) for low, high in itertools.pairwise(edges)]
    with ProcessPoolExecutor(_PROCESSES, mp_context=multiprocessing.get_context("spawn")) as pool:
        checked = [pool.submit(check_cuts, whole, tmp_path, truth, piece) for piece in pieces]
        assert sum(one.result() for one in checked) == sum(map(len, pieces))
