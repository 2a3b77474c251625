"""A plan says before a run is driven what it will be able to tell."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from short_campaign import driven, looked, noise_of

from daq import ConfigError, DataError, RunInfo, VehicleConfig
from model import StepCode
from model.diagnosis import DiagnosisOptions, Plan, plan_for, plan_of, planned_campaign, usual_runs
from model.diagnosis.findings.isolability import isolability
from model.diagnosis.planning.plan import CampaignPlan, plan_from_linearised
from model.diagnosis.time_series import linearise_campaigns
from model.wheel_soil import SOILS, Wheel
from wheelsoil.to_json import to_json
from wheelsoil.wording.diagnosis_json import plan_json

EFFECTS = ("vasilev", "slope", "drawbar_pull_zero", "crosstalk", "torque_zero")
OPTIONS = DiagnosisOptions(effects=EFFECTS)
CLAY = CampaignPlan(Wheel(0.47, 0.318), SOILS["clay"], usual_runs(4), duration_s=20.0)


@lru_cache(maxsize=4)
def planned(runs: int = 4, one_way: bool = False, one_load: bool = False, advise: bool = False) -> Plan:
    infos = usual_runs(runs)
    if one_load:
        infos = tuple(info.model_copy(update={"added_load_kg": 0.0}) for info in infos)
    if one_way:
        infos = tuple(info.model_copy(update={"direction": "out"}) for info in infos)
    return plan_of([planned_campaign(replace(CLAY, runs=infos))], OPTIONS, advise=advise)


def test_what_is_planned_is_what_the_driven_runs_then_tell() -> None:
    campaign = planned_campaign(CLAY)
    before = isolability(linearise_campaigns([campaign], OPTIONS, [noise_of(driven())]).grams)
    after = isolability(looked(driven(), *EFFECTS).grams)
    np.testing.assert_allclose(before.deviation, after.deviation, rtol=0.4)
    np.testing.assert_allclose(before.separation, after.separation, rtol=0.4)
    assert before.confounded(0.9) == after.confounded(0.9)


def test_one_direction_hides_a_slope_behind_a_zero() -> None:
    both, one = planned(), planned(one_way=True)
    slope = both.isolability.keys.index("slope")
    assert one.isolability.separation[slope] < 0.3 * both.isolability.separation[slope]
    assert "slope" in one.not_identifiable and "slope" not in both.not_identifiable
    assert one.minimum_separable["slope"].value > 3 * both.minimum_separable["slope"].value


def test_more_runs_tell_smaller_effects() -> None:
    few, many = planned(), planned(8)
    for key in EFFECTS:
        assert many.minimum_detectable[key].value < few.minimum_detectable[key].value
        assert many.minimum_separable[key].value >= 0.9 * many.minimum_detectable[key].value


def test_look_alikes_come_with_what_would_part_them() -> None:
    told = planned(one_load=True, advise=True)
    groups = {frozenset(a.families): a.next_runs for a in told.confounded}
    group = next(g for g in groups if "drawbar_pull_zero" in g and "crosstalk" in g)
    assert groups[group][0].step.code == StepCode.LIFTED_ZERO
    read = json.loads(to_json(plan_json(told)))
    assert [e["key"] for e in read["effects"]] == list(EFFECTS)
    assert np.array(read["cosine"]).shape == (5, 5)


def test_driven_runs_can_be_asked_the_same() -> None:
    seen = looked(driven(), *EFFECTS)
    told = plan_from_linearised(seen, OPTIONS.name_at, {"vasilev": [0.2]}, advise=False)
    double = plan_from_linearised(seen, OPTIONS.name_at, {"vasilev": [0.4]}, advise=False)
    assert double.isolability.deviation[0] == pytest.approx(2 * told.isolability.deviation[0])
    assert double.minimum_separable["vasilev"].value == pytest.approx(told.minimum_separable["vasilev"].value)


def test_a_plan_that_cannot_be_driven_is_said() -> None:
    with pytest.raises(ConfigError, match="no run is planned"):
        planned_campaign(replace(CLAY, runs=()))
    with pytest.raises(ConfigError, match="too short"):
        planned_campaign(replace(CLAY, duration_s=5.0))
    heavy = (RunInfo(id="heavy", added_load_kg=60_000.0),)
    with pytest.raises(DataError, match="cannot carry"):
        planned_campaign(replace(CLAY, runs=heavy))


def test_a_plan_is_for_any_vehicle_file() -> None:
    small = VehicleConfig.model_validate(
        {
            "vehicle": {"mass_kg": 360.0},
            "wheel": {"radius_m": 0.25, "width_m": 0.2, "tyre": "smooth"},
            "signals": {"drawbar_pull": "Hub.Fx", "sinkage": "Laser.z"},
        }
    )
    plan = plan_for(small, SOILS["sandy"], duration_s=20.0)
    run = planned_campaign(plan).runs[0]
    assert np.median(run.vertical_load_n) == pytest.approx(800.0, rel=0.1)
    assert np.isfinite(run.sinkage_m).all() and np.isnan(run.driving_torque_nm).all()
    assert (plan.tyre, len(plan.runs)) == ("smooth", 6)
    assert np.median(planned_campaign(replace(plan, runs=plan.runs[1:2])).runs[0].vertical_load_n) == pytest.approx(
        918, rel=0.1
    )
    with pytest.raises(ConfigError, match="wheel is not described"):
        plan_for(VehicleConfig(), SOILS["clay"])


def test_planned_runs_rest_before_and_after_and_keep_their_sigmas() -> None:
    run = planned_campaign(replace(CLAY, sigmas={"dp": 25.0}, channels=("dp",))).runs[0]
    assert len(run.quality.standstills) == 2
    assert (run.drawbar_pull_sigma_n == 25.0).all() and np.isnan(run.driving_torque_nm).all()
    used = run.used
    assert (run.ground_speed_mps[used] >= 0.5).all() and np.isfinite(run.slip[used]).all()
