"""Figures of docs/paper.md as PNG in docs/images; needs a Chromium: ``python -m studies.paper.figures``."""

from __future__ import annotations

import shutil

import numpy as np
import plotly.graph_objects as go
from playwright.sync_api import sync_playwright
from plotly.subplots import make_subplots

from model.fit import MODELS
from studies.paper.study import LIKE_THE_PAPERS, NAMES, READINGS, ROOT, fitted, samples
from wheelsoil.report.figures import EDGES, binned, style

IMAGES = ROOT / "docs" / "images"
WIDTH, HEIGHT = 1120, 760
PULL_N = {"clay": [-800, 300], "sandy": [-100, 1100]}


def curves(soil: str, number: int) -> go.Figure:
    """Return the panels of the paper's figure for one soil: the measured pull, and that of one model in each."""
    run = LIKE_THE_PAPERS[soil]
    titles = [f"({letter}) {NAMES[model]}" for letter, model in zip("abcd", MODELS, strict=True)]
    figure = make_subplots(2, 2, subplot_titles=titles, horizontal_spacing=0.06, vertical_spacing=0.1)
    for panel, name in enumerate(MODELS):
        row, column = divmod(panel, 2)
        place = {"row": row + 1, "col": column + 1}
        for which, reading in READINGS.items():
            fit, runs = fitted(soil, run, reading)
            slip, measured, predicted = samples(fit.model(name), runs, 0.0)
            if reading == "balanced":
                cells = binned(slip, measured, EDGES)
                between = {"type": "data", "symmetric": False, "array": cells.upper - cells.median}
                between["arrayminus"] = cells.median - cells.lower
                marker = {"color": "#111", "size": 6}
                words = "measured, median and quartiles in bins of slip"
                figure.add_scatter(
                    x=cells.centre,
                    y=cells.median,
                    error_y=between,
                    mode="markers",
                    marker=marker,
                    name=words,
                    showlegend=panel == 0,
                    **place,
                )
            order = np.argsort(slip)
            line = binned(slip[order], predicted[order], EDGES)
            look = {"color": style(name).colour, "dash": "solid" if reading == "balanced" else "dot", "width": 2.5}
            figure.add_scatter(
                x=line.centre,
                y=line.median,
                mode="lines",
                line=look,
                name=f"model, {which}",
                showlegend=panel == 0,
                **place,
            )
    figure.update_xaxes(range=[0, 1])
    figure.update_xaxes(title_text="slip", row=2)
    figure.update_yaxes(zeroline=True, zerolinecolor="#bbb", range=PULL_N[soil])
    figure.update_yaxes(title_text="drawbar pull, N", col=1)
    figure.update_layout(
        template="plotly_white",
        font={"size": 15, "color": "#111"},
        title=f"As Fig. {number} of the paper: {soil} sample, {run}",
        legend={"orientation": "h", "y": -0.1, "x": 0.5, "xanchor": "center"},
        margin={"l": 70, "r": 20, "t": 90, "b": 60},
        width=WIDTH,
        height=HEIGHT,
    )
    return figure


def main() -> None:
    """Draw both figures."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for number, soil in ((4, "clay"), (5, "sandy")):
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, device_scale_factor=1.5)
            page.set_content(curves(soil, number).to_html(include_plotlyjs=True, config={"staticPlot": True}))
            page.wait_for_selector(".scatterlayer .trace path")
            page.locator(".plot-container").screenshot(path=IMAGES / f"paper_fig_{number}.png")
            page.close()
        browser.close()


if __name__ == "__main__":
    main()
