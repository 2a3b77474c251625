"""The engine against hidden causes: one seed here, more and a small study with ``-m slow``, all by `make blind`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from blind.engine import campaign_from_channels, fitted
from blind.field import OWN, field_day
from blind.mix import WHOLE, Mix, cases
from blind.study import run
from blind.tables import figures, joined
from blind.world import World

from model.diagnosis import Campaign, Diagnosis, DiagnosisOptions, diagnose
from model.effects import EFFECTS
from wheelsoil.wording.verdict import sentence_of


def campaign_of(seed: int, soil: str, hidden: list[tuple[str, float]], world: World) -> Campaign:
    """Return a campaign whose standstills show the zeros."""
    day = field_day(soil, (21, seed), "fjord", world=world)
    day = replace(day, stance=replace(day.stance, held=False))
    return campaign_from_channels(day, hidden)


def diagnosed(campaign: Campaign) -> Diagnosis:
    """Diagnose a campaign."""
    return diagnose([campaign], DiagnosisOptions())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("soil", "key", "parameter", "size", "world"),
    [
        ("clay", "vasilev", "H_m", 0.1, World(runs=3, duration_s=25.0)),
        pytest.param("sandy", "torque_zero", "offset_nm", -90.0, OWN, marks=pytest.mark.slow),
    ],
)
def test_a_large_cause_is_named_with_its_size(soil: str, key: str, parameter: str, size: float, world: World) -> None:
    campaign = campaign_of(1, soil, [(key, size)], world)
    said = diagnosed(campaign)
    assert said.verdict == "named", sentence_of(said)
    assert [cause.name for cause in said.causes] == [EFFECTS[key].name]
    [cause] = said.causes
    assert cause.probability > 0.9
    [found] = [p for p in cause.parameters if p.name == parameter]
    assert found.value == pytest.approx(size, rel=0.1)
    assert said.gain is not None
    assert said.gain.log_likelihood_gain > 0
    [given] = fitted(campaign, EFFECTS[key].name, key, DiagnosisOptions())
    [alone] = [p for p in given["parameters"] if p["name"] == parameter]
    assert (given["name"], given["form"]) == (cause.name, cause.form)
    assert alone["value"] == pytest.approx(found.value, abs=0.5 * (found.interval95[1] - found.interval95[0]))
    assert alone["interval95"][0] < size < alone["interval95"][1]


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden() -> None:
    said = diagnosed(campaign_of(2, "clay", [], OWN))
    assert not said.causes, sentence_of(said)
    assert said.candidates[0].name == "none"
    assert said.minimum_detectable


@pytest.mark.slow
def test_the_cut_at_little_slip_is_no_misfit() -> None:
    """Chosen by its measured slip, a null seemed to have too much pull where the wheel brakes a little (99.9 %)."""
    [case] = [one for one in cases(replace(WHOLE, block=2)) if one.name == "null/null/22216"]
    said = diagnosed(campaign_from_channels(case.day, []))
    assert said.verdict == "nothing_detectable", sentence_of(said)
    assert said.linearisation is not None and said.linearisation.used < 0.9 * said.linearisation.samples


@pytest.mark.parametrize("every", [pytest.param(8, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.study)])
def test_a_small_study_contradicts_no_figure_that_is_to_be_reached(tmp_path: Path, every: int) -> None:
    """Of 20 nulls, 28 singles at L = 5, 12 outside the library, 4 pairs: bounds of 95 % hold what is to be reached.

    An eighth of them refutes gross errors only.
    """
    wanted = cases(Mix(nulls=20, singles=1, levels=(5.0,), pairs=4, outside=1, literal=1, calibration=0))[::every]
    assert not run(wanted, tmp_path, jobs=2)
    missed = [(row.what, row.hits, row.n, row.bounds) for row in figures(joined(tmp_path)) if row.refuted]
    assert not missed
