"""Where a diagnosis does not decide, its file predicts a load that it has not seen as well as the best of its sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_campaign import driven

from daq.runs import open_runs
from model import ExtendedModel
from model.diagnosis import Campaign, DiagnosisOptions, diagnose
from model.wheel_soil import conditions_of
from processing import ProcessedRun, ProcessOptions
from wheelsoil.workflows import campaigns_of, models_of, process_runs

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
_SLIP = 0.2
"""From which on the criteria count on clay."""


def pull_error(model: ExtendedModel, runs: Sequence[ProcessedRun]) -> float:
    """Return R0 of the drawbar pull, N."""
    errors = []
    for run, conditions in zip(runs, conditions_of(runs, model.soil.unit_weight_n_m3), strict=True):
        rows = np.flatnonzero(run.used & (run.slip >= _SLIP))[::10]
        errors.append(run.drawbar_pull_n[rows] - model.predict(conditions.rows(rows)).drawbar_pull_n)
    return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))


@pytest.mark.slow
def test_a_load_that_was_not_driven_is_predicted_as_well_as_by_the_best_set() -> None:
    [campaign] = campaigns_of([CLAY], process_runs(open_runs([CLAY]), ProcessOptions(purpose="diagnose")))
    heavy = [run for run in campaign.runs if run.run.added_load_kg == 500.0]
    light: Campaign = replace(campaign, runs=tuple(run for run in campaign.runs if run not in heavy))
    found = diagnose([light], DiagnosisOptions(average=True))
    assert found.verdict == "one_of" and found.average is not None
    [model] = models_of(found, [light], "balanced", "")
    assert () in [one.causes for one in found.average.sets], "no cause is one of the sets"
    assert sum(one.probability for one in model.sets) + model.rest_probability == pytest.approx(1.0)
    assert ExtendedModel.from_mapping(model.to_mapping()).sets == model.sets

    alone = [replace(model, sets=(replace(one, probability=1.0),)) for one in model.sets if one.probability > 0]
    best, file = min(pull_error(one, heavy) for one in alone), pull_error(model, heavy)
    laboratory = pull_error(replace(model, sets=(), rest_probability=0.0), heavy)
    assert file < 1.05 * best
    assert file < 0.5 * laboratory, "110 N before the sets were kept"

    gain = found.average.gain
    assert gain is not None
    assert gain.extended["dp"].R0 < 0.75 * gain.base["dp"].R0
    assert model.provenance["held_out_R0_reduction_percent"] == pytest.approx(gain.reduction_percent)


def test_the_file_of_a_name_holds_what_acts_beside_it() -> None:
    effects = "vasilev:H_m=0.06 drawbar_pull_gain:relative=0.04"
    campaign, later = (driven(effects, seed=seed) for seed in (3, 4))
    listed = ("vasilev", "torque_gain", "drawbar_pull_gain", "grouser")
    found = diagnose([campaign], DiagnosisOptions(effects=listed, average=True))
    assert (found.verdict, [cause.name for cause in found.causes]) == ("named", ["slip_sinkage"])
    assert "drawbar_pull_gain" in found.grounds.beside and found.average is not None and found.gain is not None
    [model] = models_of(found, [campaign], "balanced", "")
    assert all("vasilev" in [effect.key for effect in one.effects] for one in model.sets)
    assert sum(one.probability for one in model.sets) + model.rest_probability == pytest.approx(1.0)

    gain = found.average.gain
    assert gain is not None and gain.base == found.gain.base
    assert model.provenance["held_out_R0_reduction_percent"] == pytest.approx(gain.reduction_percent)
    [alone] = models_of(replace(found, average=None), [campaign], "balanced", "")
    assert [effect.key for effect in alone.effects] == ["vasilev"]
    assert pull_error(model, later.runs) < pull_error(alone, later.runs)
