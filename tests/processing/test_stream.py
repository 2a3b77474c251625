"""A recording in chunks gives the run that it gives in one piece, in memory that does not grow with its frames."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from synthetic_run import START_NS, forces, speeds, vehicle

from daq import Channel
from daq.config import TransducerSection
from processing.pipeline import process, process_stream

COLUMNS = ["slip", "ground_speed_mps", "vertical_load_n", "drawbar_pull_n", "driving_torque_nm", "distance_m"]


def _chunks(channels: dict[str, Channel], cuts_s: list[float]) -> Iterator[dict[str, Channel]]:
    bounds = [np.iinfo(np.int64).min, *(START_NS + np.sort(cuts_s) * 1e9).astype(np.int64), np.iinfo(np.int64).max]
    for k in range(len(bounds) - 1):
        chunk = {}
        for role, c in channels.items():
            inside = (c.time_ns >= bounds[k]) & (c.time_ns < bounds[k + 1])
            if inside.any():
                chunk[role] = Channel(role, c.unit, c.time_ns[inside], c.values[inside])
        yield chunk


@given(st.lists(st.floats(0, 40), max_size=8), st.integers(0, 2**32))
@examples(10, gate=3)
def test_chunks_give_the_same_run(cuts_s: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    channels = speeds(40.0, 0.2, rng=rng, jitter=0.3) | forces(40.0, rng=rng)
    whole = process(channels, vehicle())
    parts = process_stream(_chunks(channels, cuts_s), vehicle())
    np.testing.assert_array_equal(parts.time_s, whole.time_s)
    np.testing.assert_array_equal(parts.reason, whole.reason)
    np.testing.assert_array_equal(parts.segment, whole.segment)
    for column in COLUMNS:
        scale = np.nanstd(getattr(whole, column))
        np.testing.assert_allclose(getattr(parts, column), getattr(whole, column), atol=1e-9 * scale, err_msg=column)


def test_chunks_of_a_rotating_transducer_give_the_same_run() -> None:
    config = vehicle(transducer=TransducerSection(frame="wheel"))
    rng = np.random.default_rng(2)
    channels = speeds(40.0, 0.2, rng=rng, jitter=0.3) | forces(40.0, rng=rng)
    load = channels["vertical_load"]
    channels["wheel_angle"] = Channel("a", "rad", load.time_ns, np.mod((load.time_ns - START_NS) * 8e-9, 2 * np.pi))
    whole = process(channels, config)
    parts = process_stream(_chunks(channels, [3.0, 3.1, 20.0]), config)
    assert np.nanstd(whole.vertical_load_n) > 500  # it does turn
    np.testing.assert_allclose(parts.vertical_load_n, whole.vertical_load_n, atol=3.0)
    np.testing.assert_allclose(parts.drawbar_pull_n, whole.drawbar_pull_n, atol=3.0)


_LONG_RUN = """
    import sys
    import numpy as np
    from memory_support import peak_rss_mb
    from daq.channels import Channel
    from processing.pipeline.pipeline import process_stream
    from synthetic_run import START_NS, driven_speed, vehicle

    FORCES = {"vertical_load": 1000, "drawbar_pull": 1000, "driving_torque": 1000}
    ROLES = FORCES | {"wheel_speed": 100, "ground_speed": 20, "gnss_time": 20, "latitude": 20, "longitude": 20}

    def chunks(minutes):
        for minute in range(minutes):
            out = {}
            for role, rate in ROLES.items():
                at = 60.0 * minute + np.arange(60 * rate) / rate
                values = driven_speed(at) if "speed" in role else at if role == "gnss_time" else 50 + at % 7
                out[role] = Channel(role, "", START_NS + np.round(at * 1e9).astype(np.int64), values)
            yield out

    run = process_stream(chunks(int(sys.argv[1])), vehicle())
    assert run.used.mean() > 0.95
    print(len(run), peak_rss_mb())
"""


def _peak_rss_mib(minutes: int) -> float:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(_LONG_RUN), str(minutes)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
        env={"PYTHONPATH": "tests:."},
    )
    samples, peak = done.stdout.split()
    assert int(samples) == pytest.approx(minutes * 6000, abs=10)
    return float(peak)


@pytest.mark.slow
def test_memory_grows_with_the_time_base_only() -> None:
    """A 5 GB candump of 3.2 kframes/s lasts 9.4 h: a tenth of it, ten times over, must stay well below 1 GB."""
    short, long = _peak_rss_mib(1), _peak_rss_mib(57)
    assert short + 10 * (long - short) < 800
