"""What the simulation gets wrong and where: its residual against slip, load, speed, time, place and run."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq import OUTPUTS, ROLES, FloatArray
from model.diagnosis import Diagnosis, PlotData
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, grouped, section
from wheelsoil.report.figures import (
    EDGES,
    GREY_BAND,
    MEASURED,
    Trace,
    axes,
    band,
    binned,
    dots,
    line,
    parted_at_zero,
    points,
    repeated,
    set_axis_range,
    thinned_by_sign,
    thinned_rows,
)
from wheelsoil.report.figures import numbers as plotted
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.diagnosis_text import FINDING_NOTE, finding_note
from wheelsoil.wording.names import place_text, plain_name
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import number, signed
from wheelsoil.wording.verdict import several_terrains

_BINS = 12
_SHOWN = 12
_LEAST_SIGMAS = 6.0
"""Of the axes in noise sigmas; double-click shows what lies beyond."""
_READING = (
    "dots are measured − predicted (soil re-calibrated, no cause added), black is their median; grey holds 95 % of "
    "them if the simulation is right. Where the line leaves zero and stays away, it is wrong. Against slip in its "
    "unit, else in sigmas of the noise (σ)."
)

_READING_ORDERS = (
    "how much the channel swings at so many cycles a turn of the wheel, beyond what slip, load and soil explain; noise "
    "alone stays in the grey at 19 of 20 orders. A needle at 1, with its flanks, is a wheel that is not round or, in "
    "the pull, a zero that turns with it; at 2 an oval."
)

_AGAINST = (
    ("slip", "slip", "against slip"),
    ("vertical_load_n", "vertical load (N)", "against load"),
    ("ground_speed_mps", "ground speed (m/s)", "against speed"),
    ("time_s", "time in the run (s)", "against time"),
    ("line_position", "place along the line (ends: −1, 1)", "against place"),
    ("run", "run", "run by run"),
)

_QUARTILE = 0.6745


@section("misfit", "Residuals with calibrated soil")
def misfit(inputs: ReportInputs) -> Contents:
    """Build the section: the findings, and six panels for each measured channel."""
    found = inputs.diagnosis
    blocks: list[Block] = [_findings(found)]
    blocks += [
        Text(f"Inconsistent, {plain_name(item.channel)}, {item.rows} rows: {note_text(item.why)}.", "warning")
        for item in found.inconsistent
    ]
    numbers: dict[str, Any] = {
        "what_is_wrong": [
            {
                "channel": finding.channel,
                "where": place_text(finding.place),
                "size": finding.size,
                "statistic": finding.statistic,
                "slips": finding.place.slips,
                "campaign": finding.place.campaign,
                "of_rows": finding.of_rows,
            }
            for finding in found.what_is_wrong
        ],
        "median_there": [found.median_there(finding) for finding in found.what_is_wrong],
        "inconsistent": found.inconsistent,
    }
    names = [seen.campaign for seen in found.plot_data]
    channels = [c for c in OUTPUTS if any(c in seen.base for seen in found.plot_data)]
    for channel in channels:
        figures, shown = _panels(found.plot_data, channel, of_rows=bool(inputs.tables))
        blocks.append(Panels(figures, _READING, names))
        numbers[channel] = shown
    if orders := _wheel_orders(found.plot_data):
        blocks.append(Panels(orders, _READING_ORDERS, names))
        numbers["wheel_orders"] = {seen.campaign: seen.wheel_orders for seen in found.plot_data}
    return blocks, numbers


def _findings(found: Diagnosis) -> Block:
    if not found.what_is_wrong and several_terrains(found) is not None:
        return Text("Nothing stands out beside a soil that differs from run to run.", "warning")
    if not found.what_is_wrong:
        return Text("Nothing stands out: what is left looks like noise everywhere.", "good")
    of_rows = all(finding.of_rows for finding in found.what_is_wrong)
    rows = [
        [
            ROLES[finding.channel].name,
            place_text(finding.place),
            *([] if of_rows else [_with_unit(found.median_there(finding), finding.channel)]),
            _with_unit(finding.size, finding.channel),
            signed(finding.statistic, ".1f"),
        ]
        for finding in found.what_is_wrong[:_SHOWN]
    ]
    head = ["channel", "where", *(["mean there"] if of_rows else ["median there", "size of the shape"]), "sigmas"]
    note = "Mean there: of measured − predicted over these rows." if of_rows else FINDING_NOTE
    note = finding_note(note, found.what_is_wrong[:_SHOWN])
    return Table("Residuals of the simulation, largest first", head, rows, note, left=2)


def _with_unit(value: float, channel: str) -> str:
    return f"{number(value)} {ROLES[channel].unit_text}".rstrip() if np.isfinite(value) else "–"


def _panels(
    everything: tuple[PlotData, ...], channel: str, *, of_rows: bool = False
) -> tuple[list[Figure], dict[str, Any]]:
    views = [seen for seen in everything if channel in seen.base]
    figures = []
    numbers: dict[str, Any] = {}
    for key, across, title in _AGAINST:
        if key != "run" and not any(np.isfinite(getattr(seen, key)).any() for seen in views):
            continue  # rows of tables have no speed and no place
        shown = []
        for seen in views:
            traces, numbers[f"{seen.campaign}: {title}"] = _traces(seen, channel, key, of_rows=of_rows)
            shown.append((seen.campaign, traces))
        unit = OUTPUTS[channel].unit_text if key == "slip" else "σ"
        layout = axes(across, f"measured − predicted ({unit})", height=310)
        if key == "slip":
            set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
            set_axis_range(layout, "y", np.concatenate([_reach(seen, channel) for seen in views]))
        else:
            reach = _sigmas_shown([numbers[f"{seen.campaign}: {title}"] for seen in views])
            layout["yaxis"] |= {"range": [-reach, reach]}
        if key == "run":
            layout["xaxis"] |= {"order": list(dict.fromkeys(run for seen in views for run in seen.runs))}
        elif key != "slip":
            set_axis_range(layout, "x", np.concatenate([getattr(seen, key) for seen in views]))
        name = f"{OUTPUTS[channel].name.capitalize()} {title}"
        figures.append(grouped(f"misfit-{channel}-{key}", name, shown, layout))
    return figures, numbers


def _wheel_orders(everything: tuple[PlotData, ...]) -> list[Figure]:
    """Return a figure for each channel that swings once a turn of the wheel in some campaign."""
    figures = []
    for channel in dict.fromkeys(channel for seen in everything for channel in seen.wheel_orders):
        shown = []
        for seen in everything:
            if found := seen.wheel_orders.get(channel):
                nothing = np.zeros(len(found.order))
                shades = band(found.order, nothing, found.by_chance, "noise, 95 %", GREY_BAND)
                swing = line(found.order, found.swing, "swing", MEASURED, "solid", 2.2)
                shown.append((seen.campaign, [*shades, swing]))
        unit = OUTPUTS[channel].unit_text
        layout = axes("cycles a turn of the wheel", f"swing ({unit})", height=310)
        layout["yaxis"] |= {"zero": True}
        name = f"{OUTPUTS[channel].name.capitalize()} by wheel order"
        figures.append(grouped(f"wheel-order-{channel}", name, shown, layout))
    return figures


def _sigmas_shown(panels: list[dict[str, Any]]) -> float:
    """Return how far an axis in noise sigmas goes: as far as the medians do, at least to `_LEAST_SIGMAS`."""
    ends = [panel[key] if "run" in panel else panel["median"].median for panel in panels for key in ("lower", "upper")]
    far = np.abs(np.concatenate(ends))
    return max(_LEAST_SIGMAS, 1.1 * float(np.max(far[np.isfinite(far)], initial=0.0)))


def _reach(seen: PlotData, channel: str) -> FloatArray:
    """Return what has to fit into the panel against slip."""
    driven = seen.slip > 0
    noise = 2.2 * seen.base_sigma[channel][driven]
    return np.concatenate([(seen.measured[channel] - seen.base[channel])[driven], noise, -noise])


def _traces(seen: PlotData, channel: str, key: str, *, of_rows: bool) -> tuple[list[Trace], dict[str, Any]]:
    residual, sigma = seen.measured[channel] - seen.base[channel], seen.base_sigma[channel]
    if key == "slip":
        return _cloud(seen.slip, residual, sigma, None if of_rows else EDGES)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(sigma > 0, residual / sigma, np.nan)
    if key == "run":
        return _by_run(seen, scaled)
    values: FloatArray = getattr(seen, key)
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    edges: FloatArray = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
    edges[-1] = np.nextafter(edges[-1], np.inf)  # the greatest value belongs to the last bin
    return _cloud(values, scaled, np.ones(len(values)), edges)


def _cloud(
    x: FloatArray, residual: FloatArray, sigma: FloatArray, edges: FloatArray | None
) -> tuple[list[Trace], dict[str, Any]]:
    """Return samples and their medians in bins; without bins every row of a table, and the medians of its repeats."""
    if edges is None:
        curve, noise, name = repeated(x, residual), repeated(x, sigma), "rows"
        rows = np.arange(len(x))
    else:
        curve, noise, name = binned(x, residual, edges), binned(x, sigma, edges), "samples"
        over_slip = edges is EDGES
        rows = thinned_by_sign(x, residual) if over_slip else thinned_rows(x, residual, cells=30, per_cell=1)
        curve, noise = (parted_at_zero(curve), parted_at_zero(noise)) if over_slip else (curve, noise)
    traces = [
        *band(noise.centre, -2 * noise.median, 2 * noise.median, "noise, 95 %", GREY_BAND),
        dots(x[rows], residual[rows], name),
        line(curve.centre, curve.median, "median", MEASURED, "solid", 2.2),
    ]
    return traces, {"median": curve, "noise_sigma": noise.median}


def _by_run(seen: PlotData, scaled: FloatArray) -> tuple[list[Trace], dict[str, Any]]:
    of_run = [seen.run == i for i in range(len(seen.runs))]
    low, middle, high = np.array([_quartiles(scaled[rows]) for rows in of_run]).T.reshape(3, -1)
    names = list(seen.runs)
    medians = points(names, plotted(middle), "median and middle half", (MEASURED, "circle"), 8.0)
    reach = {"array": plotted(high - middle), "arrayminus": plotted(middle - low)}
    expected: Trace = {
        "kind": "column",
        "name": "middle half of noise",
        "x": names,
        "y": [2 * _QUARTILE] * len(names),
        "base": -_QUARTILE,
        "colour": GREY_BAND,
    }
    return [expected, medians | {"error_y": reach}], {"run": seen.runs, "lower": low, "median": middle, "upper": high}


def _quartiles(values: FloatArray) -> list[float]:
    return [float(v) for v in np.nanpercentile(values, [25, 50, 75])] if np.isfinite(values).any() else [np.nan] * 3
