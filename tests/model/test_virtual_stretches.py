"""A run of the virtual test in stretches of any length is the run at once; its frames are the same bit for bit."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from dataclasses import fields
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from virtual_support import LYASKO, START_NS, lyasko_model

from daq import RunInfo
from daq.can import FrameBatch, concatenate
from model.effects import EFFECTS
from model.simulation import Steering, TransducerSetup, VirtualRun, VirtualSetup, virtual_stretches, whole
from model.simulation.run import SHORTEST_STRETCH_S
from wheelsoil.simulation.vehicle import frame_batches, virtual_frames

FAULTS = (
    ("speed_latency", {"extra_delay_s": 0.6}),
    ("speed_latency", {"extra_delay_s": -0.6}),
    ("speed_bias", {"offset_mps": 0.2}),
    ("wheel_radius", {"relative": 0.05}),
    ("zero_drift", {"campaign_span_n": 300.0}),
)


def stretches(
    stretch_s: float,
    duration_s: float,
    seed: int,
    frame: str,
    faults: list[tuple[str, dict[str, float]]],
    steering: Steering | None,
) -> list[VirtualRun]:
    return list(
        virtual_stretches(
            VirtualSetup(duration_s=duration_s, transducer=TransducerSetup(frame=frame), steering=steering),
            lyasko_model("sandy"),
            LYASKO["sandy"],
            RunInfo(id="run", direction="back" if seed % 2 else "out"),
            start_ns=START_NS,
            elapsed_s=100.0,
            rng=np.random.default_rng(seed),
            ring=np.random.default_rng(99),
            faults=[(EFFECTS[name], values) for name, values in faults],
            stretch_s=stretch_s,
        )
    )


@settings(max_examples=8, deadline=None)
@given(
    stretch_s=st.floats(SHORTEST_STRETCH_S, 20.0),
    duration_s=st.floats(15.0, 35.0),
    seed=st.integers(0, 10_000),
    frame=st.sampled_from(["vehicle", "wheel"]),
    faults=st.lists(st.sampled_from(FAULTS), max_size=3, unique_by=lambda fault: fault[0]),
    steering=st.sampled_from([None, Steering(0.2, 2.7, 2.7 - 0.9j)]),
)
def test_stretches_of_any_length_are_the_run(
    stretch_s: float,
    duration_s: float,
    seed: int,
    frame: str,
    faults: list[tuple[str, dict[str, float]]],
    steering: Steering | None,
) -> None:
    parts = stretches(stretch_s, duration_s, seed, frame, faults, steering)
    (run,) = stretches(inf, duration_s, seed, frame, faults, steering)
    joined = whole(parts)
    for sensor, channels in run.sensors.items():
        for name, channel in channels.items():
            assert np.array_equal(channel.time_ns, joined.sensors[sensor][name].time_ns), (sensor, name)
            # products of matrices round by the place of a row in them
            assert np.allclose(channel.values, joined.sensors[sensor][name].values, rtol=0, atol=1e-9), (sensor, name)
    for field in fields(run.truth):
        if field.name != "conditions":
            assert np.allclose(getattr(run.truth, field.name), getattr(joined.truth, field.name), rtol=0, atol=1e-9)
    frames: FrameBatch = concatenate(list(frame_batches(parts)))
    assert np.array_equal(frames.frames, virtual_frames(run).frames)


_LONG_RUN = """
    import sys
    from pathlib import Path
    from memory_support import peak_rss_mb
    from wheelsoil.simulation import SimulationOptions, simulate_campaign

    options = SimulationOptions(effects={"lyasko": {"m1": 0.1, "m2": 0.05}}, runs=1, duration_s=float(sys.argv[1]))
    simulate_campaign(Path(sys.argv[2]), options)
    print(peak_rss_mb())
"""


def _peak_rss_mb(duration_s: float, folder: Path) -> float:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(_LONG_RUN), str(duration_s), str(folder)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
        env={"PYTHONPATH": "tests:.", "OPENBLAS_NUM_THREADS": "1"},
    )
    return float(done.stdout)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_duration(tmp_path: Path) -> None:
    """Of 12 minutes as of 4, in stretches of one each: at once it would take 290 MB more."""
    short, long = (_peak_rss_mb(minutes * 60.0, tmp_path / f"{minutes}") for minutes in (4, 12))
    assert long - short < 40
    assert long < 400
