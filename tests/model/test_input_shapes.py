"""The catch-all sees an error of the ground speed or of the load that no cause of the library has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import simulated_campaign

from model.diagnosis.campaign import Campaign, DiagnosisOptions
from model.diagnosis.diagnose import diagnose
from model.diagnosis.input_shapes import LOAD_SHARE, SPEED_MPS, input_shapes
from model.diagnosis.linearise import Linear, Point, Simulation, linearise
from model.diagnosis.samples import Samples, samples_of
from model.diagnosis.soil_space import soil_space
from model.soil_prior import prior_of
from processing.pipeline import process
from wheelsoil.virtual_campaign import simulated_roles
from wheelsoil.virtual_options import SimulationOptions


@pytest.fixture(scope="module")
def seen() -> tuple[Simulation, Samples, Linear]:
    campaign = simulated_campaign(runs=2)
    samples = samples_of(campaign, DiagnosisOptions().channels)
    samples = samples[np.arange(len(samples)) % 4 == 0]
    simulation = Simulation(campaign.wheel, campaign.soil, soil_space(campaign.soil_prior), (), "balanced")
    return simulation, samples, at_speed(simulation, samples, 0.0)


def at_speed(simulation: Simulation, samples: Samples, offset_mps: float) -> Linear:
    point = Point(np.zeros(len(simulation.space)), {}, np.full(len(samples), offset_mps))
    return linearise(simulation, samples, point)


def test_the_hats_together_are_one_error_of_the_speed(seen: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = seen
    hats = [shape for shape in input_shapes(linear) if shape.label.startswith("v|")]
    assert len(hats) == 4
    assert {shape.height for shape in hats} == {SPEED_MPS}
    together = np.sum([shape.columns for shape in hats], axis=0)
    step = 0.004
    fast, slow = (at_speed(simulation, samples, sign * step).value for sign in (1.0, -1.0))
    slope = (fast - slow) / (2.0 * step)
    known = np.isfinite(slope) & (np.abs(np.asarray(linear.conditions.slip)) > 0.1)
    error = np.abs(together - SPEED_MPS * slope)[known]
    assert np.quantile(error, 0.95) < 0.05 * np.std(together[known])


def test_an_error_of_the_load_is_its_share_of_the_load(seen: tuple[Simulation, Samples, Linear]) -> None:
    simulation, samples, linear = seen
    shapes = {shape.label: shape for shape in input_shapes(linear)}
    load = np.asarray(samples.conditions.vertical_load_n)
    assert shapes["w|everywhere"].height == pytest.approx(LOAD_SHARE * load.mean())
    more = replace(samples, conditions=replace(samples.conditions, vertical_load_n=load + LOAD_SHARE * load.mean()))
    moved = at_speed(simulation, more, 0.0).centre - linear.centre
    known = np.isfinite(moved)
    error = np.abs(shapes["w|everywhere"].columns - moved)[known]
    assert np.quantile(error, 0.95) < 0.1 * np.std(moved[known])
    growing = shapes["w|growing with load"]
    assert np.mean(growing.columns[0] * (load - load.mean()) * linear.load[0]) > 0
    assert growing.height == pytest.approx(LOAD_SHARE * np.abs(load - load.mean()).max() / 0.15)


def test_one_load_has_nothing_that_grows_with_it(seen: tuple[Simulation, Samples, Linear]) -> None:
    _, _, linear = seen
    one = replace(linear.conditions, vertical_load_n=np.full(linear.value.shape[1], 11e3))
    assert "w|growing with load" not in {shape.label for shape in input_shapes(replace(linear, conditions=one))}


def slow_receiver(bump_mps: float) -> Campaign:
    """Return a campaign whose receiver is off at some speeds: by the same where it is slow, by nothing where fast."""
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


def test_a_receiver_that_is_off_at_some_speeds_is_no_listed_cause() -> None:
    found = diagnose([slow_receiver(0.15)], DiagnosisOptions())
    assert found.verdict == "unexplained", found.sentence
    assert "ground_speed" in {one.channel for one in found.what_is_wrong}
