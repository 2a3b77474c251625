import numpy as np
import pytest
from synthetic_run import forces, speeds, vehicle

from daq import RunInfo
from daq.config import SensorSection
from processing import ProcessedRun, Reason, block_of, units_of
from processing.pipeline import process
from processing.processed_run import UNITS, Column
from wheelsoil.wording.run_summary import summary_table


@pytest.fixture(scope="module")
def full() -> ProcessedRun:
    channels = speeds(30.0, 0.2) | forces(30.0, rng=np.random.default_rng(1))
    return process(channels, vehicle(), RunInfo(id="north-3"))


@pytest.fixture(scope="module")
def bare() -> ProcessedRun:
    return process(speeds(2.0), vehicle())


def test_the_table_says_what_was_kept(full: ProcessedRun) -> None:
    table = dict(summary_table(full))
    assert table["run"] == "north-3"
    assert table["duration"].startswith("30.0 s at 100 Hz, filtered at 4 Hz")
    assert table["used"].endswith(f"of {len(full)} samples")
    assert "filter edge" in table["left out"]
    assert table["slip"].startswith("0.200 / 0.200 / 0.200")
    assert "1000 Hz, no gaps" in table["vertical_load"]


def test_a_sigma_says_what_is_in_it() -> None:
    """That of one filtered sample is not the declared one: the correction for the outboard parts adds noise."""
    config = vehicle()
    assert config.wheel is not None
    sensors = {**config.sensors, "drawbar_pull": SensorSection(sigma=20.0)}
    channels = speeds(30.0, 0.2) | forces(30.0, rng=np.random.default_rng(1))
    sigmas = []
    for mass_kg, corrected in ((0.0, ""), (75.0, " and the correction for 75 kg outboard")):
        wheel = config.wheel.model_copy(update={"outboard_mass_kg": mass_kg, "outboard_inertia_kgm2": 0.0})
        run = process(channels, config.model_copy(update={"wheel": wheel, "sensors": sensors}), RunInfo(id="r"))
        table = dict(summary_table(run))
        assert f" N after the filter (from the declared one{corrected})" in table["drawbar_pull"]
        assert "after the filter (estimated)" in table["driving_torque"]
        sigmas.append(run.quality.sensors["drawbar_pull"].sigma)
    assert sigmas[1] > sigmas[0]


def test_the_table_of_a_run_that_tells_little_has_no_nan(bare: ProcessedRun) -> None:
    text = "\n".join(f"{what}: {value}" for what, value in summary_table(bare))
    assert "nan" not in text
    assert "latency not identifiable" in text
    assert "drawbar" not in text


def _columns(run: ProcessedRun) -> tuple[dict[str, Column], dict[str, str]]:
    units = units_of(run)
    return block_of(run, units, slice(None)), units


def test_columns_have_units_and_one_length(full: ProcessedRun) -> None:
    columns, units = _columns(full)
    assert list(columns) == list(units)
    assert {len(values) for values in columns.values()} == {len(full)}
    assert list(columns)[:2] == ["time_ns", "time_s"]
    assert columns["time_ns"][0] == full.start_ns
    assert np.diff(columns["time_ns"]).tolist() == [10_000_000] * (len(full) - 1)
    assert units["drawbar_pull_sigma_n"] == "N"
    used = columns["reason"] == Reason.USED.name.lower()
    np.testing.assert_array_equal(used, full.used)
    for name in set(UNITS) & set(columns):
        np.testing.assert_array_equal(columns[name], getattr(full, name))


def test_what_was_not_measured_has_no_column(bare: ProcessedRun) -> None:
    columns, _ = _columns(bare)
    assert "slip" in columns
    assert not {"drawbar_pull_n", "vertical_load_n", "sinkage_m", "latitude_deg"} & set(columns)


def test_columns_make_a_table_and_come_back(full: ProcessedRun, tmp_path) -> None:  # type: ignore[no-untyped-def]
    import pyarrow as pa
    from pyarrow import parquet

    columns, _ = _columns(full)
    parquet.write_table(pa.table(columns), tmp_path / "run.parquet")
    back = parquet.read_table(tmp_path / "run.parquet")
    np.testing.assert_array_equal(back["slip"].to_numpy(), full.slip)
    assert back["segment"].to_pylist() == columns["segment"].tolist()


def test_some_rows_are_those_of_the_whole(full: ProcessedRun, bare: ProcessedRun) -> None:
    whole, units = _columns(full)
    part = block_of(full, units, slice(100, 300))
    for name, values in whole.items():
        np.testing.assert_array_equal(part[name], values[100:300])
    assert np.isnan(block_of(bare, ["sinkage_m"], slice(0, 5))["sinkage_m"]).tolist() == [True] * 5
