"""An accelerometer from a signal of a DBC to the outboard compensation, in g and in a unit that it is not in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok
from recording_support import write_with_message

from daq.runs import open_runs
from processing.pipeline import process

SAMPLE = Path(__file__).parents[2] / "recordings" / "clay" / "run-1.mcap"
DBC = """VERSION ""
BU_: Imu
BO_ 1794 Motion: 2 Imu
 SG_ Ax : 0|16@1- (0.0001,0) [-3.2|3.2] "g" Vector__XXX
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the sample with an accelerometer that reads the slope of its ground speed, a hundred times a second."""
    (run,) = open_runs([SAMPLE])
    processed = process(run.channels(), run.vehicle, run.info)
    at = processed.start_ns + np.round(processed.time_s * 1e9).astype(np.int64)
    read = np.nan_to_num(processed.ground_acceleration_mps2) / 9.80665
    path = tmp_path_factory.mktemp("imu") / "run-1.mcap"
    write_with_message(path, run, ("imu.dbc", DBC), read, at, "longitudinal_acceleration")
    return path


def test_it_compensates_the_outboard_mass_in_g(recording: Path) -> None:
    assert "compensated with longitudinal_acceleration" in ok("process", recording).err
    (run,), (plain,) = open_runs([recording]), open_runs([SAMPLE])
    read, before = (process(one.channels(), one.vehicle, one.info) for one in (run, plain))
    assert read.has_accelerometer and not before.has_accelerometer
    both = read.used & before.used
    assert both.sum() > 0.99 * before.used.sum()
    hub_n = [one.drawbar_pull_n - one.outboard_mass_kg * one.outboard_acceleration_mps2 for one in (read, before)]
    np.testing.assert_allclose(hub_n[0][both], hub_n[1][both], atol=1e-6)
    reading = read.column("longitudinal_acceleration_mps2")[both]
    assert np.corrcoef(reading, before.ground_acceleration_mps2[both])[0, 1] > 0.9, "in m/s2, and forward"
    assert np.std(reading) > 0.3


@pytest.mark.parametrize(
    ("unit", "code", "said"),
    [("m/s^2", 0, 'correct its unit: 9.81 says {signal = "...", unit = "g"}'), ("kN", 2, "acceleration")],
)
def test_a_wrong_unit_is_reported(recording: Path, tmp_path: Path, unit: str, code: int, said: str) -> None:
    (run,) = open_runs([recording])
    for name, data in run.attachments.items():
        (tmp_path / name).write_bytes(data.replace(b'"g"', f'"{unit}"'.encode()) if name == "imu.dbc" else data)
    found = invoke("process", recording, "--vehicle", tmp_path / "vehicle.toml")
    assert found.code == code
    assert said in " ".join((found.out + found.err).split())
