"""What people hold in a notebook shows itself as a small table."""

from dataclasses import replace
from pathlib import Path

import pytest
from IPython.core.interactiveshell import InteractiveShell
from short_campaign import driven

from daq import Note
from daq.runs import Run, open_runs
from model.diagnosis import DiagnosisOptions, diagnose
from model.fit import FitOptions, fit_models
from processing import RunCode
from wheelsoil import register
from wheelsoil.notebook import diagnosis_html, fit_html, processed_run_html, run_html
from wheelsoil.wording.notes import texts_of

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
SCRIPT = '<script>alert("x")</script>'


@pytest.fixture(scope="module")
def fit():
    campaign = driven("lyasko:m1=0.1,m2=0.05")
    options = FitOptions(chosen=("second_order",), channels=("dp", "t"))
    return fit_models(campaign.runs, campaign.wheel, campaign.soil, options)


def test_a_fit(fit):
    page = fit_html(fit)
    for text in ("vasilev", "H_m", "95 % interval", "chosen", "drawbar pull", "torque", "soil clay", "correlation"):
        assert text in page, text
    assert page.count("<table>") == 3
    assert len(page) < 20_000


def test_a_diagnosis():
    found = diagnose([driven("lyasko:m1=0.1,m2=0.05")], DiagnosisOptions(effects=("lyasko", "wheel_radius")))
    page = diagnosis_html(found)
    assert "slip sinkage" in page and f"verdict: {found.verdict.replace('_', ' ')}" in page
    named = replace(found, causes=tuple(replace(c, name=SCRIPT) for c in found.causes))
    assert "&lt;script&gt;" in diagnosis_html(named) and "<script" not in diagnosis_html(named)


def test_a_processed_run_and_its_notes():
    run = driven().runs[0]
    page = processed_run_html(run)
    assert "drawbar pull kN" in page and all(text.split()[0] in page for text in texts_of(run.quality.notes))
    note = Note(RunCode.NOT_MEASURED, values={"role": SCRIPT})
    strange = replace(run, run=run.run.model_copy(update={"id": SCRIPT}), quality=replace(run.quality, notes=(note,)))
    assert processed_run_html(strange).count("&lt;script&gt;") == 2 and "<script" not in processed_run_html(strange)


def test_a_run():
    (run,) = open_runs([CLAY / "run-1.mcap"])
    page = run_html(run)
    for text in ("run-1.mcap", "virtual test vehicle", "clay", "bus can0", "126\u202f398 frames", "vertical_load"):
        assert text in page, text
    assert "<script" not in run_html(replace(run, id=SCRIPT, recording=None))


def test_names_in_a_fit_are_escaped(fit):
    strange = replace(fit, soil=replace(fit.soil, name=SCRIPT))
    assert "&lt;script" in fit_html(strange) and "<script" not in fit_html(strange)


def test_a_notebook_shows_a_run_as_a_table(monkeypatch):
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)  # IPython warns of another one than its own
    (run,) = open_runs([CLAY / "run-1.mcap"])
    shell = InteractiveShell.instance()
    try:
        register()
        shown, _ = shell.display_formatter.format(run)
    finally:
        InteractiveShell.clear_instance()
    assert shown["text/html"] == run_html(run)


def test_without_a_notebook_nothing_is_registered():
    register()
    assert not hasattr(Run, "_repr_html_")
