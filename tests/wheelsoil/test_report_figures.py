"""What a figure shows at first, and that nothing measured is left out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wheelsoil.report.figures import STYLES, axes, density, set_axis_range
from wheelsoil.report.sections.against_slip import drawbar_pull


def view_of(values: np.ndarray, also: np.ndarray) -> tuple[float, float]:
    layout = axes("x", "y")
    set_axis_range(layout, "y", values, also=also, margin=0.0)
    low, high = layout["yaxis"]["range"]
    return low, high


def test_every_sample_is_in_a_cell_or_stands_for_one_beyond_them():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0.0, 1.0, 3000), rng.uniform(-300.0, 300.0, 3000)
    y[1500] = 3000.0
    cells, lone = density(x, y, (0.0, 1.0), "samples")
    assert sum(map(sum, cells["z"])) >= 0.98 * 3000
    assert max(lone["y"]) == 3000.0
    assert min(lone["y"]) < cells["y0"]


def test_models_belong_to_the_first_view():
    measured = np.linspace(-100.0, 100.0, 1001)
    assert view_of(measured, np.array([250.0]))[1] == pytest.approx(250.0, abs=1.5)
    low, high = view_of(measured, np.array([-5000.0, 5000.0]))
    assert high - low == pytest.approx(2 * 198.0, abs=3.0), "at most twice what was measured, which stays legible"
    assert view_of(measured, np.array([5000.0])) == pytest.approx((-99.0, 99.0 + 198.0), abs=1.5)


def test_a_model_that_is_far_off_is_seen_to_be(material):
    wong = material.fit.model("wong")
    off = tuple(replace(p, drawbar_pull_n=p.drawbar_pull_n + 500.0) for p in wong.predictions)
    models = (replace(wong, predictions=off), *material.fit.models[1:])
    moved = replace(material, campaign=replace(material.fit, models=models))
    figure = drawbar_pull.build(moved).blocks[0].figures[0]
    lines = [trace for trace in figure.data if trace["name"] == "Wong" and "marker" in trace]
    highest = max(y for trace in lines for y in trace["y"])
    low, high = figure.layout["yaxis"]["range"]
    measured = material.pool.measured("dp")[material.pool.slip > 0]
    assert highest > np.percentile(measured, 99.5)
    assert low < highest < high


def test_a_model_has_a_look_of_its_own():
    looks = (*STYLES.values(),)
    for part in ("colour", "dash", "symbol"):
        assert len({getattr(one, part) for one in looks}) == len(looks), part
