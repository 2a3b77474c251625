"""What people hold in a notebook as pandas tables, and the way through files and back."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from cli_support import ok
from short_campaign import driven

from daq import Channel, ConfigError, DataError
from daq.runs import Run, open_runs
from daq.series import write_frame
from model.diagnosis import Diagnosis, DiagnosisOptions, diagnose
from model.diagnosis.core.clock import OF_RUNS
from model.fit import CampaignFit, FitOptions, fit_models
from processing import ProcessedRun
from processing.pipeline import process

SAMPLE = Path(__file__).parents[2] / "recordings" / "clay" / "run-1.mcap"


@pytest.fixture(scope="module")
def run() -> Run:
    (found,) = open_runs([SAMPLE])
    return found


@pytest.fixture(scope="module")
def processed(run: Run) -> ProcessedRun:
    return process(run.channels(), run.vehicle, run.info)


@pytest.fixture(scope="module")
def fit() -> CampaignFit:
    campaign = driven("lyasko:m1=0.1,m2=0.05")
    return fit_models(campaign.runs, campaign.wheel, campaign.soil, FitOptions(channels=("dp", "t")))


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return diagnose([driven("lyasko:m1=0.1,m2=0.05")], DiagnosisOptions(effects=("lyasko", "wheel_radius")))


def test_channels_have_their_own_stamps_and_si_units(run: Run) -> None:
    channels, frames = run.channels(), run.to_frames()
    assert frames.keys() == channels.keys()
    pull = frames["drawbar_pull"]
    assert list(pull) == ["time_ns", "drawbar_pull_n"]
    assert pull.attrs["units"] == {"time_ns": "ns", "drawbar_pull_n": "N"}
    np.testing.assert_array_equal(pull["drawbar_pull_n"], channels["drawbar_pull"].values)
    assert frames["latitude"].attrs["units"]["latitude_deg"] == "deg"


def test_a_channel_that_is_not_in_our_unit_keeps_the_name_of_its_signal() -> None:
    stamps, values = np.arange(2, dtype=np.int64), np.array([1.0, np.nan])
    frame = Channel("Hub.Force_Z", "kN", stamps, values).to_frame()
    assert list(frame) == ["time_ns", "Hub.Force_Z"] and frame.attrs["units"]["Hub.Force_Z"] == "kN"
    assert list(Channel("drawbar_pull", "kN", stamps, values).to_frame()) == ["time_ns", "drawbar_pull"]


def test_a_processed_run_is_the_table_that_process_writes(processed: ProcessedRun, tmp_path: Path) -> None:
    frame = processed.to_frame()
    assert len(frame) == len(processed) and frame.attrs["run"] == "run-1"
    assert "sinkage_m" not in frame, "not measured"
    assert (frame["reason"] == "used").sum() == processed.used.sum()
    frame.loc[0, "slip"] = 99.0
    assert processed.slip[0] != 99.0, "the frame is a copy"
    ok("process", SAMPLE, "-o", tmp_path / "run.parquet")
    table = pd.read_parquet(tmp_path / "run.parquet").drop(columns="run")
    pd.testing.assert_frame_equal(table, processed.to_frame(), check_dtype=False)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_frame_comes_back_from_its_file(processed: ProcessedRun, suffix: str, tmp_path: Path) -> None:
    frame = processed.to_frame()
    path = write_frame(tmp_path / f"run{suffix}", frame)
    if suffix == ".csv":
        back = pd.read_csv(path)
        assert "driving_torque_nm [Nm]" in back
        back.columns = back.columns.str.replace(r" \[.*\]", "", regex=True)
    else:
        back = pd.read_parquet(path)
        units = {field.name: field.metadata[b"unit"].decode() for field in pyarrow.parquet.read_schema(path)}
        assert {name: unit for name, unit in units.items() if unit} == frame.attrs["units"]
    pd.testing.assert_frame_equal(back, frame, check_dtype=False, rtol=1e-12)


def test_a_fit_has_estimates_and_criteria(fit: CampaignFit, tmp_path: Path) -> None:
    frames = fit.to_frames()
    back = pd.read_parquet(write_frame(tmp_path / "estimates.parquet", frames["estimates"]))
    pd.testing.assert_frame_equal(back, frames["estimates"], check_dtype=False)
    estimates = frames["estimates"].set_index(["model", "name"])
    m1 = fit.model("lyasko").estimate("m1")
    assert tuple(estimates.loc[("lyasko", "m1"), ["value", "lower", "upper"]]) == (m1.value, *m1.interval)
    criteria = frames["criteria"].set_index(["model", "channel"])
    assert criteria.loc[("wong", "driving_torque"), "R0"] == fit.model("wong").criteria["t"].R0_N
    assert set(criteria.loc["ding", "unit"]) == {"N", "Nm"}


def test_a_diagnosis_has_its_tables(diagnosis: Diagnosis) -> None:
    frames = diagnosis.to_frames()
    assert list(frames["candidates"]["name"]) == [one.name for one in diagnosis.candidates]
    assert frames["candidates"]["probability"].between(0, 1).all()
    assert set(frames["causes"]["name"]) == {cause.name for cause in diagnosis.causes}
    assert len(frames["causes"]) >= sum(len(cause.parameters) for cause in diagnosis.causes)
    assert set(frames["minimum_detectable"]["effect"]) == set(diagnosis.minimum_detectable)
    for name in ("what_is_wrong", "gain", "next_run"):
        assert len(frames[name].columns), "columns are there without a row, too"


def test_the_stages_of_the_bar_are_those_of_a_diagnosis(diagnosis: Diagnosis) -> None:
    assert set(OF_RUNS) <= set(diagnosis.stages_s)


def test_a_fit_opens_in_arviz(fit: CampaignFit) -> None:
    tree = fit.to_inference_data("ding", draws=4000)
    posterior, found = tree["posterior"], fit.model("ding")
    assert dict(posterior.sizes) == {"chain": 4, "draw": 4000} and posterior.attrs["model"] == "ding"
    for one in (e for e in found.estimates if not e.derived):
        drawn = posterior[one.name]
        assert (
            float(drawn.mean()) == pytest.approx(one.value, abs=0.05 * one.sigma) and drawn.attrs["units"] == one.unit
        )
        assert float(drawn.std()) == pytest.approx(one.sigma, rel=0.05)
    for (first, other), each in found.correlation.items():
        drawn = np.corrcoef(posterior[first].values.ravel(), posterior[other].values.ravel())[0, 1]
        assert drawn == pytest.approx(each, abs=0.04)
    np.testing.assert_array_equal(tree["observed_data"]["drawbar_pull_n"].values, fit.observations.drawbar_pull_n)
    assert tree["constant_data"]["slip"].shape == fit.observations.slip.shape


def test_a_diagnosis_opens_in_arviz_beside_its_prior(diagnosis: Diagnosis) -> None:
    tree = diagnosis.to_inference_data()
    posterior, prior = tree["posterior"], tree["prior"]
    assert set(posterior.data_vars) == set(prior.data_vars) and diagnosis.information is not None
    assert set(diagnosis.information.soil) < set(posterior.data_vars) and diagnosis.information.about
    assert all(posterior[name].attrs["units"] for name in posterior.data_vars)
    narrower = [float(posterior[name].std() / prior[name].std()) for name in posterior.data_vars]
    assert max(narrower) < 1.1 and min(narrower) < 0.25
    with pytest.raises(DataError, match="no linear model"):
        replace(diagnosis, information=None).to_inference_data()


def test_draws_without_arviz_are_said(fit: CampaignFit, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "arviz_base", None)
    with pytest.raises(ConfigError, match=r"wheelsoil\[arviz\]"):
        fit.to_inference_data("ding")


def test_pandas_and_python_can_are_not_imported_before_they_are_needed() -> None:
    """Nor is cantools harmed for whoever wants its tester, which needs python-can."""
    program = (
        f"import sys; from wheelsoil.cli.app import run; code = run(['info', {str(SAMPLE)!r}])\n"
        "if code or {'pandas', 'can'} & set(sys.modules): sys.exit(1)\n"
        "import cantools; sys.exit(not (cantools.tester.Tester and 'can' in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
