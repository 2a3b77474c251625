"""The catch-all sees an error of the ground speed or of the load that no cause of the library has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import at_speed, linearised

from daq import INPUTS
from model.diagnosis import Campaign, DiagnosisOptions, Kind, Shape, diagnose
from model.diagnosis.findings.adequacy import kinds_of
from model.diagnosis.time_series.basis import SPEED_MPS, basis, input_shapes
from model.diagnosis.time_series.linearise import Linear, Simulation
from model.diagnosis.time_series.samples import Samples
from model.wheel_soil import prior_of
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, simulated_roles
from wheelsoil.wording.verdict import sentence_of

LISTED = ("vasilev", "speed_bias", "speed_latency", "wheel_radius", "load_gain", "torque_gain", "drawbar_pull_gain")


@pytest.fixture(scope="module")
def seen() -> tuple[Simulation, Samples, Linear]:
    return linearised(2)


def test_the_hats_together_are_one_error_of_the_speed(seen: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = seen
    hats = [shape for shape in input_shapes(linear) if shape.shape.channel == "v"]
    assert len(hats) == 4
    assert {shape.height for shape in hats} == {SPEED_MPS}
    together = np.sum([shape.columns for shape in hats], axis=0)
    step = 0.004
    fast, slow = (at_speed(simulation, samples, sign * step).value for sign in (1.0, -1.0))
    slope = (fast - slow) / (2.0 * step)  # a speed that reads too much has the model say so much more
    known = np.isfinite(slope) & (np.abs(np.asarray(linear.conditions.slip)) > 0.1)
    error = np.abs(together + SPEED_MPS * slope)[known]
    assert np.quantile(error, 0.95) < 0.05 * np.std(together[known])


def other_loads(samples: Samples, load_n: np.ndarray) -> Samples:
    return replace(samples, conditions=replace(samples.conditions, vertical_load_n=load_n))


def test_errors_of_the_load_are_a_zero_and_what_grows_with_it(seen: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = seen
    shapes = {found.shape.kind: found for found in input_shapes(linear)}
    load = np.asarray(samples.conditions.vertical_load_n)
    growing = load - load.mean()
    for kind, off in (
        (Kind.LOAD_ERROR, 0.02 * load.mean() + 0.0 * load),
        (Kind.LOAD_ERROR_WITH_LOAD, 0.1 * growing),
    ):
        shape = shapes[kind]
        moved = at_speed(simulation, other_loads(samples, load + off), 0.0).centre - linear.centre
        scale = np.abs(off).max() / shape.height
        known = np.isfinite(moved)
        error = np.abs(scale * shape.columns + moved)[known]
        assert np.quantile(error, 0.95) < 0.1 * np.std(moved[known]), kind


@pytest.mark.parametrize("load_n", [11e3, 10987.654321])
def test_one_load_has_nothing_that_grows_with_it(seen: tuple[Simulation, Samples, Linear], load_n: float) -> None:
    _, samples, linear = seen
    one = replace(linear.conditions, vertical_load_n=np.full(linear.value.shape[1], load_n))
    kinds = {shape.kind for shape in basis(samples, replace(linear, conditions=one)).catch_all.by_rank}
    assert Kind.LOAD_ERROR in kinds
    assert not kinds & {Kind.LOAD_ERROR_WITH_LOAD, Kind.ZERO_WITH_LOAD}


def test_kinds_of_inputs_and_forces_are_apart(seen: tuple[Simulation, Samples, Linear]) -> None:
    _, samples, linear = seen
    shapes = basis(samples, linear).catch_all.by_rank
    inputs = {i for i, shape in enumerate(shapes) if shape.channel in INPUTS}
    kinds = [set(kind.tolist()) for kind in kinds_of(shapes)]
    assert all(kind <= inputs or not kind & inputs for kind in kinds)
    assert sorted(len(kind) for kind in kinds if kind <= inputs) == [1, 1, 4]


def misread_speed(bump_mps: float) -> Campaign:
    """Return a campaign whose receiver reads too much about 1.6 m/s, and nothing too much elsewhere."""
    options = SimulationOptions(soil="clay", seed=3, runs=6, draw_soil=True)
    runs = []
    for index in range(options.runs):
        channels, vehicle, info = simulated_roles(options, index)
        speed = channels["ground_speed"]
        off = bump_mps * np.exp(-(((speed.values - 1.6) / 0.35) ** 2))
        channels = {**channels, "ground_speed": replace(speed, values=speed.values + off)}
        runs.append(process(channels, vehicle, info))
    soil = options.laboratory_soil
    return Campaign("clay", tuple(runs), options.wheel, soil, prior_of(soil, options.terrain))


@pytest.mark.parametrize(
    "bump_mps", [pytest.param(0.15, marks=pytest.mark.slow), pytest.param(-0.15, marks=pytest.mark.study)]
)
def test_a_receiver_that_is_off_at_some_speeds_is_no_listed_cause(bump_mps: float) -> None:
    found = diagnose([misread_speed(bump_mps)], DiagnosisOptions(effects=LISTED))
    assert found.verdict == "unexplained", sentence_of(found)
    told = [one for one in found.what_is_wrong if one.channel == "ground_speed"]
    worst = max(told, key=lambda one: abs(one.statistic))
    assert isinstance(worst.place, Shape) and worst.place.range
    assert worst.place.range[0] < 1.6 < worst.place.range[1]
    assert np.sign(worst.size) == np.sign(bump_mps)
    assert "as a sensor error" in sentence_of(found)
