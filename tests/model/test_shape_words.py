"""Every shape of the catch-all reads on its own, behind any channel; a hat over slip knows the slips that it covers."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_support import linearised

from model.diagnosis import Kind, Rows, Shape
from model.diagnosis.time_series.basis import basis
from wheelsoil.wording.names import place_text


@pytest.fixture(scope="module")
def shapes() -> tuple[Shape, ...]:
    _, samples, linear = linearised(2)
    return basis(samples, linear).catch_all.by_rank


def test_a_campaign_that_drives_and_brakes_has_every_kind_of_shape(shapes: tuple[Shape, ...]) -> None:
    one_way = {Kind.CONSTANT_DRIVING, Kind.CONSTANT_BRAKING}
    assert {shape.kind for shape in shapes} == set(Kind) - one_way


def test_a_shape_of_driving_or_braking_is_of_that_alone() -> None:
    _, samples, linear = linearised(2)
    found, drives = basis(samples, linear), np.asarray(linear.conditions.slip) > 0
    for i, shape in enumerate(found.catch_all.shapes):
        for of, there in (("driving", drives), ("braking", ~drives)):
            if shape.kind.endswith(of):
                assert np.abs(found.columns[:, there, i]).max() > 0 == np.abs(found.columns[:, ~there, i]).max()


def test_every_shape_reads_on_its_own(shapes: tuple[Shape, ...]) -> None:
    said = {shape: place_text(shape) for shape in shapes if shape.channel == "dp"}
    assert len(set(said.values())) == len(said), "what differs reads differently"
    assert not any(re.search(r" - \d", text) for text in said.values()), "a minus sign is none of a dash"
    assert "braking, slip -0.05 to -0.15" in said.values()
    assert "growing with load, driving" in said.values()


def test_a_sample_that_a_channel_lacks_costs_none_of_its_shapes(shapes: tuple[Shape, ...]) -> None:
    _, samples, linear = linearised(2)
    value = linear.value.copy()
    value[:, 0] = np.nan
    found = basis(samples, replace(linear, value=value))
    assert {shape.kind for shape in found.catch_all.by_rank} == {shape.kind for shape in shapes}
    assert np.isfinite(found.columns).all()


@pytest.mark.parametrize("kind", Kind)
def test_every_kind_has_its_words(kind: Kind) -> None:
    assert place_text(Shape(kind, "dp", (0.5, 2.0), run="run 1"))


def test_a_campaigns_name_stays_before_it() -> None:
    assert place_text(Shape(Kind.LOAD_DRIVING, "dp", campaign="a: b")) == "a: b: growing with load, driving"
    assert place_text(Shape(Kind.TIME_IN_RUN, "dp", (0.0, 20.0), run="run: 1")) == "run: 1, 0 to 20 s"
    assert place_text(Rows(-0.2, 512.0, 3, "table")) == "table, slip -0.20, load 512 N, braking (3 rows)"
    assert place_text(Rows(0.2, 512.0, 1, "")).endswith("driving (1 row)")


def test_the_outer_hats_over_slip_go_on(shapes: tuple[Shape, ...]) -> None:
    slips = {shape.range: shape.slips for shape in shapes if shape.channel == "dp" and shape.slips}
    assert slips[0.05, 0.2] == (0.0, 0.2)
    assert slips[0.05, 0.4] == (0.05, 0.4)
    assert slips[0.65, 0.95] == (0.65, 1.0)
    assert slips[-0.3, -0.6] == (-1.0, -0.3)
    assert len(slips) == 9
