"""What a figure shows at first, and that nothing measured is left out of it."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from wheelsoil.report.figures import MEASURED, RECOMMENDED, STYLES, axes, density, set_axis_range
from wheelsoil.report.sections import quality
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
    lines = [trace for trace in figure.data if trace["name"] == "Wong" and "symbol" in trace]
    highest = max(y for trace in lines for y in trace["y"])
    low, high = figure.layout["yaxis"]["range"]
    measured = material.pool.measured("dp")[material.pool.slip > 0]
    assert highest > np.percentile(measured, 99.5)
    assert low < highest < high


def test_colours_of_one_figure_differ_in_both_modes_and_are_no_state():
    script = (files("wheelsoil.report") / "figure.js").read_text()
    tokens = dict(re.findall(r'"(#\w+)": "(--[\w-]+)"', script))
    light, dark = (files("wheelsoil.web") / "static" / "tokens.css").read_text().split("prefers-color-scheme: dark")
    assert not {"--go", "--amber", "--stop"} & set(tokens.values())
    assert all(f"{name}:" in dark for name in tokens.values()) and all(f"{name}:" in light for name in tokens.values())
    in_light, in_dark = (dict(re.findall(r"(--[\w-]+): (#\w{6})\b", theme)) for theme in (light, dark))
    of_models = [RECOMMENDED, MEASURED, *(one.colour for one in STYLES.values())]
    reasons = [colour for _, colour, _ in quality._REASONS.values()]
    for colours, apart in ((of_models, 60.0), (reasons, 25.0)):
        for theme in (in_light, in_dark):
            mode = [theme.get(tokens.get(one, ""), one) for one in colours]
            rgb = [np.array([int(one[i : i + 2], 16) for i in (1, 3, 5)]) for one in mode]
            near = [
                (mode[i], mode[j]) for j in range(len(rgb)) for i in range(j) if np.linalg.norm(rgb[i] - rgb[j]) < apart
            ]
            assert near == []


def test_a_model_has_a_look_of_its_own():
    looks = (*STYLES.values(),)
    for part in ("colour", "dash", "symbol"):
        assert len({getattr(one, part) for one in looks}) == len(looks), part
