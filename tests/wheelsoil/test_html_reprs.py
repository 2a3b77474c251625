"""What people hold in a notebook shows itself as a small table."""

from dataclasses import replace
from pathlib import Path

import pytest
from short_campaign import driven

from daq.runs.open import open_runs
from model.diagnosis.core.campaign import DiagnosisOptions
from model.diagnosis.time_series.diagnosis import diagnose
from model.fit.fit import fit_models
from model.fit.result import FitOptions

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
SCRIPT = '<script>alert("x")</script>'


@pytest.fixture(scope="module")
def fit():
    campaign = driven("lyasko:m1=0.1,m2=0.05")
    options = FitOptions(chosen=("second_order",), channels=("dp", "t"))
    return fit_models(campaign.runs, campaign.wheel, campaign.soil, options)


def test_a_fit(fit):
    page = fit._repr_html_()
    for text in ("vasilev", "H_m", "95 % interval", "chosen", "drawbar pull", "torque", "soil clay", "correlation"):
        assert text in page, text
    assert page.count("<table>") == 3
    assert len(page) < 20_000


def test_a_diagnosis():
    found = diagnose([driven("lyasko:m1=0.1,m2=0.05")], DiagnosisOptions(effects=("lyasko", "wheel_radius")))
    page = found._repr_html_()
    assert "slip sinkage" in page and f"verdict: {found.verdict.replace('_', ' ')}" in page
    named = replace(found, sentence=SCRIPT, causes=tuple(replace(c, name=SCRIPT) for c in found.causes))
    assert "&lt;script&gt;" in named._repr_html_() and "<script" not in named._repr_html_()


def test_a_processed_run_and_its_notes():
    run = driven().runs[0]
    page = run._repr_html_()
    assert "drawbar pull kN" in page and all(note.split()[0] in page for note in run.quality.notes)
    strange = replace(run, run=run.run.model_copy(update={"id": SCRIPT}), quality=replace(run.quality, notes=(SCRIPT,)))
    assert strange._repr_html_().count("&lt;script&gt;") == 2 and "<script" not in strange._repr_html_()


def test_a_run():
    (run,) = open_runs([CLAY / "run-1.mcap"])
    page = run._repr_html_()
    for text in ("run-1.mcap", "virtual test vehicle", "clay", "bus can0", "126,398 frames", "vertical_load"):
        assert text in page, text
    assert "<script" not in replace(run, id=SCRIPT, recording=None)._repr_html_()


def test_names_in_a_fit_are_escaped(fit):
    strange = replace(fit, soil=replace(fit.soil, name=SCRIPT), notes=(SCRIPT,))
    assert "<script" not in strange._repr_html_()
