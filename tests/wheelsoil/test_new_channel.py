"""A channel that no model takes, from a signal of a DBC to tables: what CONTRIBUTING.md promises of a new row.

The tyre pressure needed its row in the table of channels and the units of a pressure, and nothing else.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from cli_support import invoke, ok
from recording_support import write_with_message

from daq.runs import open_runs
from processing.pipeline import process

SAMPLE = Path(__file__).parents[2] / "recordings" / "clay" / "run-1.mcap"
DBC = """VERSION ""
BU_: Tpms
BO_ 1793 Tyres: 2 Tpms
 SG_ RearLeft : 0|16@1+ (0.1,0) [0|6553.5] "kPa" Vector__XXX
"""
START_KPA, END_KPA = 240.0, 260.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the sample with a tyre pressure that rises, ten times a second."""
    (run,) = open_runs([SAMPLE])
    stamps = np.concatenate([batch.frames["time_ns"] for batch in run.frame_batches()])
    at = np.arange(stamps.min(), stamps.max(), 100_000_000)
    path = tmp_path_factory.mktemp("tyres") / "run-1.mcap"
    write_with_message(path, run, ("tyres.dbc", DBC), np.linspace(START_KPA, END_KPA, len(at)), at, "tyre_pressure")
    return path


def test_it_is_decoded_in_si_and_put_on_the_time_base(recording: Path) -> None:
    (run,) = open_runs([recording])
    channel = run.channels()["tyre_pressure"]
    assert channel.unit == "Pa"
    assert channel.values[[0, -1]] == pytest.approx([1e3 * START_KPA, 1e3 * END_KPA])
    processed = process(run.channels(), run.vehicle, run.info)
    pressure = processed.column("tyre_pressure_pa")[processed.used]
    assert np.all((pressure > 1e3 * START_KPA) & (pressure < 1e3 * END_KPA))
    assert np.isfinite(processed.column("tyre_pressure_sigma_pa")).all()
    frame = processed.to_frame()
    assert frame.attrs["units"]["tyre_pressure_pa"] == "Pa"
    np.testing.assert_array_equal(frame["tyre_pressure_pa"], processed.column("tyre_pressure_pa"))


def test_it_moves_nothing_else(recording: Path) -> None:
    with_it, without = (process(run.channels(), run.vehicle, run.info) for run in open_runs([recording, SAMPLE]))
    assert set(with_it.extras) == {"tyre_pressure_pa", "tyre_pressure_sigma_pa"} and not without.extras
    assert np.isnan(without.column("tyre_pressure_pa")).all()
    for name in ("slip", "drawbar_pull_n", "reason"):
        np.testing.assert_array_equal(with_it.column(name), without.column(name))


def test_it_is_shown_and_exported_with_its_unit(recording: Path, tmp_path: Path) -> None:
    shown = ok("process", recording, SAMPLE, "-o", tmp_path / "runs.csv")
    assert "tyre_pressure" in shown.out
    table = pd.read_csv(tmp_path / "runs.csv")
    pressure = table["tyre_pressure_pa [Pa]"].to_numpy()
    assert np.isfinite(pressure).any() and np.isnan(pressure).any(), "the other run carries none"
    assert "Tyres" in ok("info", recording).out
    ok("export", recording, "-o", tmp_path / "t")
    exported = pyarrow.parquet.read_table(tmp_path / "t" / "run-1.can0.Tyres.parquet")
    assert exported.schema.field("RearLeft").metadata == {b"unit": b"kPa"}
    assert exported["RearLeft"].to_numpy()[0] == START_KPA


def test_a_wrong_unit_is_refused(recording: Path, tmp_path: Path) -> None:
    (run,) = open_runs([recording])
    for name, data in run.attachments.items():
        (tmp_path / name).write_bytes(data.replace(b'"kPa"', b'"kN"') if name == "tyres.dbc" else data)
    refused = invoke("process", recording, "--vehicle", tmp_path / "vehicle.toml")
    assert refused.code == 2 and "pressure" in refused.err
