"""Every effect in the virtual test: it shows where it should and nowhere else, and the model undoes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from daq import Channel, RunInfo, VehicleConfig
from daq.can import load_database
from model.effects import EFFECTS
from model.simulation import VirtualRun
from model.wheel_soil import SOILS, Conditions, Reading, WheelSoilModel
from processing import ProcessedRun
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, simulated_roles
from wheelsoil.simulation.campaign import simulated_run

SEEN = ("drawbar_pull", "driving_torque", "vertical_load", "ground_speed", "wheel_speed", "latitude", "longitude")

pytestmark = pytest.mark.parametrize("key", list(EFFECTS))


@dataclass(frozen=True)
class Simulated:
    """One quiet run with an effect, or without any."""

    run: VirtualRun
    channels: Mapping[str, Channel]
    vehicle: VehicleConfig
    info: RunInfo
    processed: ProcessedRun


def options(key: str | None) -> SimulationOptions:
    literal = key is not None and EFFECTS[key].reading == "literal"
    return SimulationOptions(
        soil="sandy",
        effects={} if key is None else {key: sizes(key)},
        reading="literal" if literal else "balanced",
        runs=2,
        duration_s=30.0,
        seed=5,
        noise=0.0,
        tilt_deg=0.0,
        brakes="released",
        pass_number=(2,),
        inflation_kpa=(250.0,),
    )


def sizes(key: str) -> dict[str, float]:
    """Return a plain size of the effect."""
    return {p.name: p.start if p.start != p.neutral else p.neutral + p.prior_scale for p in EFFECTS[key].parameters}


database = cache(load_database)


@cache
def simulated(key: str | None, reading: Reading) -> Simulated:
    chosen = replace(options(key), reading=reading)
    run = simulated_run(chosen, 1)
    with pytest.MonkeyPatch.context() as patch:  # it is driven once, and the databases are read once
        patch.setattr("wheelsoil.simulation.campaign.simulated_run", lambda *_: run)
        patch.setattr("wheelsoil.simulation.campaign.load_database", database)
        channels, vehicle, info = simulated_roles(chosen, 1)
    return Simulated(run, channels, vehicle, info, process(channels, vehicle, info))


def pair(key: str) -> tuple[Simulated, Simulated]:
    """Return the run with the effect and the one without."""
    reading = options(key).reading
    return simulated(key, reading), simulated(None, reading)


def sensed(run: VirtualRun) -> dict[str, np.ndarray]:
    return {name: channel.values for sensor in run.sensors.values() for name, channel in sensor.items()}


def test_it_shows_where_it_should(key: str) -> None:
    with_it, without = (sensed(found.run) for found in pair(key))
    differ = {name for name in SEEN if not np.allclose(with_it[name], without[name], rtol=0, atol=1e-8)}
    if EFFECTS[key].kind == "physical":
        differ -= {"wheel_speed"}  # the driver coasts at the slip at which the wheel transmits no torque
    assert differ == set(EFFECTS[key].shows)


def test_only_physical_effects_are_in_the_truth(key: str) -> None:
    with_it, without = (found.run.truth for found in pair(key))
    same = np.array_equal(with_it.drawbar_pull_n, without.drawbar_pull_n)
    assert same == (EFFECTS[key].kind == "measurement")
    if same:
        assert np.array_equal(with_it.driving_torque_nm, without.driving_torque_nm)
    assert np.array_equal(with_it.vertical_load_n, without.vertical_load_n)


def test_nobody_is_told(key: str) -> None:
    with_it, without = pair(key)
    assert with_it.vehicle == without.vehicle
    assert with_it.info == without.info


def conditions(found: Simulated) -> Conditions:
    """Return the measured inputs as a diagnosis takes them; place and clock are those of the truth."""
    run, true = found.processed, found.run.truth.conditions
    at = (run.start_ns - found.run.start_ns) * 1e-9 - 0.25 + run.time_s

    def of_truth(values: np.ndarray) -> np.ndarray:
        return np.interp(at, found.run.truth.time_s, values)

    return replace(
        true,
        slip=run.slip,
        vertical_load_n=run.vertical_load_n,
        ground_speed_mps=run.ground_speed_mps,
        wheel_speed_radps=run.wheel_speed_radps,
        ground_acceleration_mps2=run.ground_acceleration_mps2,
        ground_jerk_mps3=np.gradient(run.ground_acceleration_mps2, 1 / run.rate_hz),
        wheel_acceleration_radps2=run.wheel_acceleration_radps2,
        line_position=of_truth(true.line_position),
        campaign_time=of_truth(true.campaign_time),
        body_pitch_rad=of_truth(true.body_pitch_rad),
    )


def residuals(found: Simulated, key: str | None, reading: Reading) -> np.ndarray:
    """Return measured less predicted drawbar pull (N) and torque (N m), shape (2, n); NaN where slip says little."""
    effects = [] if key is None else [EFFECTS[key]]
    values = {} if key is None else EFFECTS[key].keyed(sizes(key))
    run = found.processed
    said = WheelSoilModel(options(key).wheel, SOILS["sandy"], effects, reading).predict(conditions(found), values)
    left = np.stack([run.drawbar_pull_n - said.drawbar_pull_n, run.driving_torque_nm - said.driving_torque_nm])
    fair = run.used & (run.ground_speed_mps > 0.8) & (np.abs(run.slip) > 0.05)
    return np.where(fair, left, np.nan)


def test_the_model_undoes_it(key: str) -> None:
    """Truth, sensors, frames, processing, model: what is left is what is left without the effect."""
    with_it, without = pair(key)
    reading = options(key).reading
    own = residuals(without, None, reading)
    ignored = np.sqrt(np.nanmean((residuals(with_it, None, reading) - own) ** 2, axis=1))
    known = np.sqrt(np.nanmean((residuals(with_it, key, reading) - own) ** 2, axis=1))
    processing = np.sqrt(np.nanmean(own**2, axis=1))
    assert (known < np.maximum(0.2 * ignored, 0.25 * processing)).all()
    assert (ignored > 5.0).any()
