"""What sensors do to the truth, undone by the model: `sensed` against `inputs` and `observation`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from effects_support import WHEEL

from model.effects import EFFECTS, MEASUREMENT, Effect
from model.effects.base import Signals
from model.wheel_soil import SOIL_PARAMETERS, SOILS, Conditions, Reaction, SoilState, WheelState
from model.wheel_soil.stresses import slip_of_ratio

RATE_HZ = 200.0
TIME = np.arange(0.0, 30.0, 1.0 / RATE_HZ)
INNER = slice(200, -200)
LATE = "speed_latency"
SOIL = SoilState(*(getattr(SOILS["clay"], name) for name in SOIL_PARAMETERS))
Chosen = list[tuple[Effect, Mapping[str, float]]]


def driven() -> Signals:
    """Return a smooth run that drives and brakes."""
    speed = 3.0 + 1.2 * np.sin(0.5 * TIME) + 0.5 * np.sin(1.1 * TIME)
    ratio = 0.8 + 0.4 * np.sin(0.7 * TIME)
    return Signals(
        time_s=TIME,
        drawbar_pull_n=900.0 * np.sin(0.3 * TIME),
        driving_torque_nm=600.0 + 500.0 * np.cos(0.4 * TIME),
        vertical_load_n=9e3 + 800.0 * np.sin(2.0 * TIME),
        ground_speed_mps=speed,
        wheel_speed_radps=speed / (ratio * WHEEL.radius_m),
        campaign_time=TIME / 100.0 - 0.2,
        body_pitch_rad=5e-3 * np.sin(0.9 * TIME),
        direction=-1.0,
    )


def conditions(signals: Signals) -> Conditions:
    """Return what an analyst makes of signals, with the declared radius."""
    rim = WHEEL.radius_m * signals.wheel_speed_radps
    acceleration = np.gradient(signals.ground_speed_mps, 1.0 / RATE_HZ)
    return Conditions(
        slip=slip_of_ratio(signals.ground_speed_mps / rim),
        vertical_load_n=signals.vertical_load_n,
        ground_speed_mps=signals.ground_speed_mps,
        wheel_speed_radps=signals.wheel_speed_radps,
        ground_acceleration_mps2=acceleration,
        ground_jerk_mps3=np.gradient(acceleration, 1.0 / RATE_HZ),
        campaign_time=signals.campaign_time,
        body_pitch_rad=signals.body_pitch_rad,
        direction=signals.direction,
    )


def sized(effects: tuple[type[Effect], ...], share: float) -> Chosen:
    """Return effects in the order of the chain, each so many prior scales off neutral."""
    return [
        (e(), {p.name: share * p.prior_scale for p in e.parameters}) for e in sorted(effects, key=lambda e: e.stage)
    ]


def round_trip(chosen: Chosen) -> tuple[Conditions, Conditions, Signals, Reaction]:
    """Return the true and the recovered inputs, what is read, and what the model says is read."""
    truth = driven()
    seen = truth
    for effect, values in chosen:
        seen = effect.sensed(seen, values)
    true, recovered = conditions(truth), conditions(seen)
    for effect, values in reversed(chosen):
        recovered = effect.inputs(recovered, values)
    state = WheelState(true, SOIL, WHEEL.radius_m, WHEEL.width_m, np.nan, np.nan)
    reaction = Reaction(truth.drawbar_pull_n, truth.driving_torque_nm)
    for effect, values in chosen:
        reaction = effect.resultants(reaction, state, values)
    for effect, values in chosen:
        reaction = effect.observation(reaction, state, values)
    return true, recovered, seen, reaction


@pytest.mark.parametrize("share", [0.7, -0.7])
@pytest.mark.parametrize(
    "effects", [*((e,) for e in MEASUREMENT), MEASUREMENT], ids=[*(e.key() for e in MEASUREMENT), "all"]
)
def test_the_model_undoes_what_the_sensor_does(effects: tuple[type[Effect], ...], share: float) -> None:
    true, recovered, seen, reaction = round_trip(sized(effects, share))
    exact = EFFECTS[LATE] not in effects
    for name, size in (("slip", 1.0), ("vertical_load_n", 1e4), ("ground_speed_mps", 1.0)):
        off = np.abs(getattr(recovered, name) - getattr(true, name))[INNER].max()
        assert off < size * (1e-12 if exact else 2e-3), name
    np.testing.assert_allclose(reaction.drawbar_pull, seen.drawbar_pull_n, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(reaction.driving_torque, seen.driving_torque_nm, rtol=1e-12, atol=1e-9)
    assert any(np.any(getattr(seen, n) != getattr(driven(), n)) for n in Signals.__dataclass_fields__)


def test_a_late_speed_is_one_of_the_past() -> None:
    """Late: while the vehicle gains speed too little is shown; without the series' terms the sign would be free."""
    truth = driven()
    (effect, values), *_ = sized((EFFECTS[LATE],), 0.7)
    seen = effect.sensed(truth, values)
    gains = conditions(truth).ground_acceleration_mps2 > 0.3
    assert values["extra_delay_s"] > 0 and np.all((seen.ground_speed_mps < truth.ground_speed_mps)[INNER][gains[INNER]])
    untouched = np.abs(conditions(seen).slip - conditions(truth).slip)[INNER].max()
    wrong = effect.inputs(conditions(seen), {"extra_delay_s": -values["extra_delay_s"]})
    assert np.abs(wrong.slip - conditions(truth).slip)[INNER].max() > untouched > 0.02


def test_a_bias_does_not_show_at_standstill() -> None:
    standing = replace(driven(), ground_speed_mps=np.zeros(len(TIME)))
    seen = EFFECTS["speed_bias"]().sensed(standing, {"offset_mps": 0.2})
    assert not seen.ground_speed_mps.any()
