"""What the simulation gets wrong and where: its residual against slip, load, speed, time, place and run."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.diagnosis.result import Diagnosis, Seen
from wheelsoil.diagnosis_words import CHANNEL_NAMES, CHANNEL_UNITS, FINDING_UNITS, plain_name
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import GREY_BAND, MEASURED, Trace, axes, band, dots, line, look_at, words
from wheelsoil.report.figures import numbers as plotted
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.sections.against_slip import EDGES
from wheelsoil.report.thinning import binned, thinned_rows
from wheelsoil.report.words import number, signed

KEY = "misfit"
TITLE = "What is wrong, and where"

_BINS = 12
_SHOWN = 12
_READING = (
    "dots are measured less simulated, with the soil re-calibrated and no cause added, the black line their median in "
    "bins; grey holds 95 % of the dots if the simulation is right. Where the line leaves zero and stays away it is "
    "wrong, and the panel where the line is plainest says with what that goes."
)


def build(material: Material) -> Section:
    """Build the section: the findings, and six panels for each measured channel."""
    found = material.diagnosis
    blocks: list[Block] = [_findings(found), *_inconsistent(found)]
    numbers: dict[str, Any] = {"what_is_wrong": found.what_is_wrong, "inconsistent": found.inconsistent}
    names = [seen.campaign for seen in found.seen]
    channels = [c for c in CHANNEL_NAMES if any(c in seen.base for seen in found.seen)]
    for channel in channels:
        figures, shown = _panels(found.seen, channel)
        blocks.append(Panels(figures, _READING, names))
        numbers[channel] = shown
    return Section(KEY, TITLE, blocks, numbers)


def _findings(found: Diagnosis) -> Block:
    if not found.what_is_wrong:
        return Text("Nothing stands out: what is left looks like noise everywhere.", "good")
    rows = [
        [
            plain_name(one.channel),
            one.where,
            f"{number(one.size)} {FINDING_UNITS.get(one.channel, '')}".rstrip(),
            signed(one.statistic, ".1f"),
        ]
        for one in found.what_is_wrong[:_SHOWN]
    ]
    note = (
        "Mean of measured less simulated there, and how many of its standard deviations that is; the standard "
        "deviation allows for correlated noise, errors of speed and load, and the soil."
    )
    return Table("Where the simulation is off, worst first", ["channel", "where", "by", "sigmas"], rows, note, left=2)


def _inconsistent(found: Diagnosis) -> list[Block]:
    return [
        Text(f"Inconsistent, {plain_name(one.channel)}, {one.rows} rows: {one.why}.", "warning")
        for one in found.inconsistent
    ]


def _panels(everything: tuple[Seen, ...], channel: str) -> tuple[list[Figure], dict[str, Any]]:
    views = [seen for seen in everything if channel in seen.base]
    figures = []
    numbers: dict[str, Any] = {}
    for key, across, title in _AGAINST:
        data: list[Trace] = []
        groups: list[str] = []
        for seen in views:
            traces, numbers[f"{seen.campaign}: {title}"] = _traces(seen, channel, key)
            data += traces
            groups += [seen.campaign] * len(traces)
        layout = axes(across, f"measured − simulated ({CHANNEL_UNITS[channel]})", height=310)
        look_at(layout, "y", np.concatenate([_reach(seen, channel) for seen in views]))
        if key == "run":
            layout["xaxis"] |= {"type": "category"}
        name = f"{CHANNEL_NAMES[channel].capitalize()} {title}"
        figures.append(Figure(f"misfit-{channel}-{key}", name, data, layout, groups))
    return figures, numbers


def _reach(seen: Seen, channel: str) -> FloatArray:
    """Return what has to fit into a panel."""
    noise = 2.2 * seen.base_sigma[channel]
    return np.concatenate([seen.measured[channel] - seen.base[channel], noise, -noise])


def _traces(seen: Seen, channel: str, key: str) -> tuple[list[Trace], dict[str, Any]]:
    residual, sigma = seen.measured[channel] - seen.base[channel], seen.base_sigma[channel]
    return _by_run(seen, residual, sigma) if key == "run" else _cloud(getattr(seen, key), residual, sigma, key)


_AGAINST = (
    ("slip", "slip", "against slip"),
    ("vertical_load_n", "vertical load (N)", "against load"),
    ("ground_speed_mps", "ground speed (m/s)", "against speed"),
    ("time_s", "time in the run (s)", "against time"),
    ("line_position", "place along the line (−1 to 1)", "against place"),
    ("run", "run", "run by run"),
)


def _cloud(x: FloatArray, residual: FloatArray, sigma: FloatArray, key: str) -> tuple[list[Trace], dict[str, Any]]:
    edges = EDGES if key == "slip" else _edges(x)
    curve, noise = binned(x, residual, edges), binned(x, sigma, edges)
    rows = thinned_rows(x, residual, cells=30, per_cell=1)
    traces = [
        *band(noise.centre, -2 * noise.median, 2 * noise.median, "noise, 95 %", GREY_BAND),
        dots(x[rows], residual[rows], "samples"),
        line(curve.centre, curve.median, "median", MEASURED, "solid", 2.2),
    ]
    return traces, {"median": curve, "noise_sigma": noise.median}


def _edges(x: FloatArray) -> FloatArray:
    known = x[np.isfinite(x)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    edges: FloatArray = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
    edges[-1] = np.nextafter(edges[-1], np.inf)  # the greatest value belongs to the last bin
    return edges


def _by_run(seen: Seen, residual: FloatArray, sigma: FloatArray) -> tuple[list[Trace], dict[str, Any]]:
    of_run = [seen.run == i for i in range(len(seen.runs))]
    low, middle, high = np.array([_quartiles(residual[rows]) for rows in of_run]).T.reshape(3, -1)
    noise = np.array([_quartiles(sigma[rows])[1] for rows in of_run])
    names = [words(name) for name in seen.runs]
    bars: Trace = {
        "type": "scatter",
        "mode": "markers",
        "name": "median and middle half",
        "x": names,
        "y": plotted(middle),
        "error_y": {
            "type": "data",
            "symmetric": False,
            "array": plotted(high - middle),
            "arrayminus": plotted(middle - low),
            "color": MEASURED,
        },
        "marker": {"color": MEASURED, "size": 8},
    }
    expected: Trace = {
        "type": "bar",
        "name": "middle half of noise",
        "x": names,
        "y": plotted(2 * _QUARTILE * noise),
        "base": plotted(-_QUARTILE * noise),
        "marker": {"color": GREY_BAND},
        "width": 0.5,
    }
    shown = {"run": seen.runs, "lower": low, "median": middle, "upper": high, "noise_sigma": noise}
    return [expected, bars], shown


_QUARTILE = 0.6745


def _quartiles(values: FloatArray) -> list[float]:
    return [float(v) for v in np.nanpercentile(values, [25, 50, 75])] if np.isfinite(values).any() else [np.nan] * 3
