"""Figures of docs/real_data.md as PNG in docs/images; needs a Chromium: ``python -m studies.real_data.figures``."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from playwright.sync_api import sync_playwright
from plotly.subplots import make_subplots

from daq import FloatArray
from model.diagnosis import DiagnosisOptions, PlotData, diagnose_bench
from model.diagnosis.single_wheel import Weighed, Weighing, compare_wheels, driven_rows, skid_law
from studies.real_data.study import CHANNELS, HERE, bench, plate_tests, weighed

IMAGES = HERE.parents[1] / "docs" / "images"
WIDTH, HEIGHT = 1120, 460
LOOKS = {
    "measured": ("#111111", "solid"),
    "wong": ("#7f7f7f", "dash"),
    "vasilev": ("#0072B2", "dot"),
    "interface_friction": ("#D55E00", "solid"),
    "stress_peak_shift": ("#009E73", "dashdot"),
    "shear_softening": ("#CC79A7", "longdash"),
    "extended": ("#D55E00", "solid"),
}
NAMES = {
    "wong": "Wong, soil re-calibrated",
    "vasilev": "slip sinkage (Vasil'ev)",
    "interface_friction": "interface friction",
    "stress_peak_shift": "stress peak shift",
    "shear_softening": "shear softening",
}
PULL, SINKAGE = "drawbar pull, N", "sinkage, mm"


def canvas(titles: tuple[str, str]) -> go.Figure:
    """Return two panels beside each other."""
    figure = make_subplots(1, 2, subplot_titles=titles, horizontal_spacing=0.09)
    figure.update_layout(
        template="plotly_white",
        font={"size": 15, "color": "#111"},
        legend={"orientation": "h", "y": -0.2, "x": 0.5, "xanchor": "center"},
        margin={"l": 70, "r": 20, "t": 50, "b": 60},
        width=WIDTH,
        height=HEIGHT,
    )
    return figure


def axes(figure: go.Figure, labels: tuple[str, str], across: str = "slip") -> None:
    """Label both panels."""
    for column, label in enumerate(labels, 1):
        figure.update_yaxes(title_text=label, row=1, col=column, zeroline=True, zerolinecolor="#bbb")
        figure.update_xaxes(title_text=across, row=1, col=column)


def grouped(slip: FloatArray, run: NDArray[np.intp], values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means over repeats, by rising slip."""
    kinds = np.unique(run)
    x, y = (np.array([v[run == k].mean() for k in kinds]) for v in (slip, values))
    order = np.argsort(x)
    return x[order], y[order]


def dots(
    figure: go.Figure, x: FloatArray, y: FloatArray, column: int, name: str, colour: str = "#111111", **more: Any
) -> None:
    """Draw measured rows."""
    marker = {"color": colour, "size": 8, **more}
    figure.add_scatter(
        x=x, y=y, mode="markers", name=name, legendgroup=name, marker=marker, showlegend=column == 1, row=1, col=column
    )


def curve(figure: go.Figure, x: FloatArray, y: FloatArray, column: int, name: str, look: str, **more: Any) -> None:
    """Draw what a model says."""
    colour, dash = LOOKS[look]
    line = {"color": colour, "dash": dash, "width": 2.5}
    figure.add_scatter(
        x=x,
        y=y,
        mode="lines",
        name=name,
        legendgroup=name,
        line=line,
        showlegend=column == 1,
        row=1,
        col=column,
        **more,
    )


def members(seen: PlotData, keys: tuple[str, ...], title: tuple[str, str]) -> go.Figure:
    """Draw drawbar pull and sinkage, measured and as each candidate says."""
    figure = canvas(title)
    for column, (channel, factor) in enumerate((("dp", 1.0), ("z", 1e3)), 1):
        dots(figure, seen.slip, factor * seen.measured[channel], column, "measured")
        x, y = grouped(seen.slip, seen.run, factor * seen.base[channel])
        curve(figure, x, y, column, NAMES["wong"], "wong")
        for key in keys:
            x, y = grouped(seen.slip, seen.run, factor * seen.implied[key][channel])
            curve(figure, x, y, column, NAMES[key], key)
    axes(figure, (PULL, SINKAGE))
    return figure


def extension(weighing: Weighing, best: Weighed, title: tuple[str, str]) -> go.Figure:
    """Draw the extension with the 95 % band of its posterior, against the base."""
    problem, figure = weighing.problem, canvas(title)
    null = weighing.of_set(())
    assert best.posterior is not None
    assert null.posterior is not None
    for column, (channel, factor) in enumerate((("dp", 1.0), ("z", 1e3)), 1):
        low, high = (
            grouped(
                problem.slip,
                problem.group,
                factor * quantile(best.posterior.predicted[channel], best.posterior.weights, q),
            )
            for q in (0.025, 0.975)
        )
        band(figure, low[0], low[1], high[1], column, "95 % of the extension")
        dots(figure, problem.slip, factor * problem.measured(channel), column, "measured")
        for weighed_set, name, look in (
            (null, NAMES["wong"], "wong"),
            (best, "slip sinkage and interface friction", "extended"),
        ):
            posterior = weighed_set.posterior
            assert posterior is not None
            mean = posterior.weights @ posterior.predicted[channel]
            curve(figure, *grouped(problem.slip, problem.group, factor * mean), column, name, look)
    axes(figure, (PULL, SINKAGE))
    return figure


def quantile(values: FloatArray, weights: FloatArray, q: float) -> FloatArray:
    """Return weighted quantiles of each column."""
    found = np.empty(values.shape[1])
    for i, column in enumerate(values.T):
        order = np.argsort(column)
        found[i] = np.interp(q, np.cumsum(weights[order]) - 0.5 * weights[order], column[order])
    return found


def band(figure: go.Figure, x: FloatArray, low: FloatArray, high: FloatArray, column: int, name: str) -> None:
    """Draw a band."""
    figure.add_scatter(
        x=np.concatenate([x, x[::-1]]),
        y=np.concatenate([high, low[::-1]]),
        fill="toself",
        fillcolor="rgba(213,94,0,0.15)",
        line={"width": 0},
        mode="lines",
        name=name,
        legendgroup=name,
        showlegend=column == 1,
        hoverinfo="skip",
        row=1,
        col=column,
    )


def carried_over() -> go.Figure:
    """Draw what the smooth wheel foretells of the grousered one."""
    figure = canvas(("Grousered wheel: drawbar pull", "Grousered wheel: sinkage"))
    found = compare_wheels(bench("smooth"), bench("grousered"), DiagnosisOptions(channels=("dp", "z"), most_causes=2))
    rows = driven_rows(bench("grousered")).rows
    for column, (channel, factor) in enumerate((("dp", 1.0), ("z", 1e3)), 1):
        mean, spread = factor * found.predicted[channel], factor * found.predicted_sigma[channel]
        band(figure, found.slip, mean - 1.96 * spread, mean + 1.96 * spread, column, "95 %, by the smooth wheel")
        curve(figure, found.slip, mean, column, "predicted by the smooth wheel's soil and causes", "extended")
        values = {"dp": rows.drawbar_pull_n, "z": rows.sinkage_m}[channel]
        dots(figure, rows.slip, factor * values, column, "measured")
    axes(figure, (PULL, SINKAGE))
    return figure


def skids_and_plates() -> go.Figure:
    """Draw the law of braked wheels, and the plate tests."""
    figure = canvas(("Braked wheels: Z0 + H2 s²", "Plate tests, by diameter"))
    for wheel, colour, symbol in (("smooth", "#0072B2", "circle"), ("grousered", "#D55E00", "diamond")):
        one = bench(wheel)
        chosen = one.rows.slip < 0.02
        dots(
            figure, one.rows.slip[chosen], 1e3 * one.rows.sinkage_m[chosen], 1, f"{wheel} wheel", colour, symbol=symbol
        )
        law = skid_law(one)
        assert law is not None
        x = np.linspace(-1, 0, 60)
        y = 1e3 * (law.static_sinkage_m + law.H2_m * x**2)
        figure.add_scatter(x=x, y=y, mode="lines", line={"color": colour, "width": 2}, showlegend=False, row=1, col=1)
    shown = set()
    for _, depth, force, radius_m in sorted(plate_tests(), key=lambda plate: plate[3]):
        size, pressure = round(2e3 * radius_m), force / (np.pi * radius_m**2)
        colour = {60: "#009E73", 80: "#CC79A7", 100: "#111111"}[size]
        figure.add_scatter(
            x=1e3 * depth,
            y=1e-3 * pressure,
            mode="lines",
            line={"color": colour, "width": 1.8},
            name=f"plate of {size} mm",
            legendgroup=str(size),
            showlegend=size not in shown,
            row=1,
            col=2,
        )
        shown.add(size)
    axes(figure, (SINKAGE, "pressure, kPa"))
    figure.update_xaxes(title_text="sinkage, mm", range=[0, 32], row=1, col=2)
    figure.update_yaxes(range=[0, 62], row=1, col=2)
    return figure


def main() -> None:
    """Draw all figures."""
    smooth = bench("smooth")
    blind = diagnose_bench([smooth], DiagnosisOptions(channels=CHANNELS["dp"], most_causes=1)).plot_data[0]
    seen = weighed(smooth, CHANNELS["dp,z"])
    figures = {
        "real_data_drawbar_pull_only": members(
            blind,
            ("interface_friction", "stress_peak_shift", "vasilev"),
            ("Drawbar pull: fitted", "Sinkage: implied, never seen"),
        ),
        "real_data_with_sinkage": extension(
            seen, seen.sets[0], ("Drawbar pull: fitted with sinkage", "Sinkage: fitted")
        ),
        "real_data_carried_over": carried_over(),
        "real_data_skids_and_plates": skids_and_plates(),
    }
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for name, figure in figures.items():
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, device_scale_factor=1.5)
            page.set_content(figure.to_html(include_plotlyjs=True, config={"staticPlot": True}))
            page.wait_for_selector(".main-svg")
            page.locator(".plot-container").screenshot(path=IMAGES / f"{name}.png")
            page.close()
        browser.close()


if __name__ == "__main__":
    main()
