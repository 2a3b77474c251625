"""The demo's envelope: what may be hidden, and that it is opened honestly."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest
from diagnosis_samples import diagnosis

from model.diagnosis import Detectable
from model.effects import EFFECTS
from model.wheel_soil import Wheel
from wheelsoil.simulation import SimulationOptions
from wheelsoil.workflows.demo import NONE, Hidden, draw_hidden, open_envelope

WHEEL = Wheel(0.47, 0.318)
SINKAGE = Hidden("vasilev", {"H_m": 0.055})


def test_every_draw_can_be_simulated_and_every_family_comes_up():
    drawn = [draw_hidden(seed, WHEEL) for seed in range(600)]
    for hidden in drawn:
        SimulationOptions(effects=hidden.effects)
    families = Counter(hidden.family for hidden in drawn)
    missing = {effect.name for effect in EFFECTS.values() if not effect.needs.roles} - set(families)
    assert missing == {"closed_form_sinkage"}
    assert 0.04 < families[NONE] / len(drawn) < 0.13
    forms = {hidden.key for hidden in drawn}
    assert {"vasilev", "lyasko", "ding"} <= forms


def test_both_directions_come_up_where_there_are_two():
    values = [h.values["relative"] for h in (draw_hidden(s, WHEEL) for s in range(2000)) if h.key == "wheel_radius"]
    assert min(values) < 0 < max(values)
    assert all(0.6 * 0.03 - 1e-5 <= abs(v) <= 1.6 * 0.03 + 1e-5 for v in values)


def test_a_seed_is_an_envelope():
    assert draw_hidden(5, WHEEL) == draw_hidden(5, WHEEL)
    assert len({str(draw_hidden(seed, WHEEL)) for seed in range(20)}) > 10


@pytest.mark.parametrize(
    ("hidden", "verdict", "outcome"),
    [
        (SINKAGE, "named", "found"),
        (SINKAGE, "one_of", "in the set"),
        (SINKAGE, "unexplained", "not named"),
        (SINKAGE, "nothing_detectable", "not seen"),
        (Hidden("slope", {"angle_rad": 0.03}), "named", "wrong"),
        (Hidden("slope", {"angle_rad": 0.03}), "one_of", "wrong"),
        (Hidden(NONE), "named", "wrong"),
        (Hidden(NONE), "unexplained", "wrong"),
        (Hidden(NONE), "nothing_detectable", "right"),
    ],
)
def test_it_says_what_came_of_it(hidden, verdict, outcome):
    opened = open_envelope(hidden, diagnosis(verdict))
    assert opened.outcome == outcome
    if hidden.key != NONE:
        assert hidden.text in opened.sentence


def test_sizes_are_compared_where_the_form_is_the_same():
    opened = open_envelope(SINKAGE, diagnosis("named"))
    (row,) = opened.parameters
    assert row == {
        "name": "H_m",
        "unit": "m",
        "truth": 0.055,
        "value": 0.051,
        "interval95": (0.04, 0.06),
        "inside": True,
    }
    assert "0.051 (0.04 to 0.06), which contains the true value" in opened.sentence
    beyond = open_envelope(replace(SINKAGE, values={"H_m": 0.07}), diagnosis("named"))
    assert "does not contain the true value" in beyond.sentence
    other_form = open_envelope(Hidden("ding", {"n1": 0.3}), diagnosis("named"))
    assert other_form.outcome == "found"
    assert other_form.parameters == ()


def test_the_least_detectable_size_is_stated():
    found = replace(diagnosis("nothing_detectable"), minimum_detectable={"slope": Detectable("angle_rad", 0.05, "rad")})
    opened = open_envelope(Hidden("slope", {"angle_rad": 0.03}), found)
    assert "detectable from angle_rad = 0.05 rad on" in opened.sentence
