"""How good the data are: what was kept and why not all, clocks and latencies, losses on the way."""

from __future__ import annotations

import numpy as np

from processing.processed_run import ProcessedRun, Reason
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import axes, bars
from wheelsoil.report.material import Material

KEY = "quality"
TITLE = "Data quality"

_LOOKS = {
    Reason.USED: ("used", "#0072B2", ""),
    Reason.GAP: ("gap in the data", "#111111", "x"),
    Reason.INVALID_FIX: ("invalid GNSS fix", "#D55E00", "/"),
    Reason.NOT_MEASURED: ("not measured", "#CC79A7", "\\"),
    Reason.STANDSTILL: ("standstill", "#bdbdbd", ""),
    Reason.TOO_SLOW: ("too slow for slip", "#E69F00", "."),
    Reason.FILTER_EDGE: ("edge of the filter", "#56B4E9", "-"),
    Reason.NEGATIVE_LOAD: ("negative load", "#F0E442", "+"),
    Reason.SLIP_OUT_OF_RANGE: ("slip out of range", "#009E73", "|"),
}


def build(material: Material) -> Section:
    """Build the section from the runs' quality reports and the sources' losses."""
    blocks: list[Block] = [Panels([_shares_figure(material.runs)], _READING), _table(material)]
    for run in material.runs:
        blocks += [Text(f"{run.run.id}: {note}") for note in run.quality.notes]
    numbers = {
        run.run.id: {"samples": len(run), "rate_hz": run.rate_hz, "quality": run.quality} for run in material.runs
    }
    return Section(KEY, TITLE, blocks, numbers)


_READING = (
    "each bar is one run, its whole length the samples of the common time base; only the blue part is fitted. "
    "A long orange or black part means that the GNSS or the bus failed, not the model."
)


def _shares_figure(runs: tuple[ProcessedRun, ...]) -> Figure:
    names = [run.run.id for run in runs]
    data = []
    for reason, (label, colour, pattern) in _LOOKS.items():
        shares = [100 * float(np.mean(run.reason == reason)) if len(run) else 0.0 for run in runs]
        if any(shares):
            data.append(bars(names, shares, label, colour, pattern))
    layout = axes("share of samples (%)", "", height=150 + 28 * len(runs), barmode="stack")
    layout["xaxis"] |= {"range": [0, 100]}
    layout["yaxis"] |= {"autorange": "reversed", "type": "category"}
    return Figure("shares", "What became of the samples", data, layout)


def _table(material: Material) -> Table:
    rows = []
    for run in material.runs:
        quality, source = run.quality, material.source_of(run)
        rows.append(
            [
                run.run.id,
                f"{run.time_s[-1] if len(run) else 0:.1f}",
                f"{100 * float(np.mean(run.used)) if len(run) else 0:.1f}",
                _with_sigma(1e3 * quality.residual_latency_s, 1e3 * quality.residual_latency_sigma_s, ".0f"),
                _with_sigma(quality.speed_scale, quality.speed_scale_sigma, ".4f"),
                _or_dash(quality.clock.get("drift_ppm"), ".1f"),
                _or_dash(1e3 * quality.clock.get("residual_s", np.nan), ".2f"),
                _or_dash(source.dropped_frames if source else None, "d"),
            ]
        )
    head = [
        "run",
        "length (s)",
        "used (%)",
        "speed late by (ms)",
        "ground / rim speed",
        "clock drift (ppm)",
        "clock residual (ms)",
        "frames lost",
    ]
    note = (
        "Speed late by: what is left of the ground speed's delay against the wheel speed after the declared delays. "
        "Ground / rim speed: on hardly slipping samples; 1 when the rolling radius is right. "
        "± is one sigma; – is not known."
    )
    return Table("Runs", head, rows, note)


def _with_sigma(value: float, sigma: float, form: str) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{value:{form}} ± {sigma:{form}}" if np.isfinite(sigma) else f"{value:{form}}"


def _or_dash(value: float | None, form: str) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:{form}}"
