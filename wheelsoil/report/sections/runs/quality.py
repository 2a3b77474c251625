"""Quality of the runs: used and excluded samples of each, with the exclusion reasons."""

from __future__ import annotations

import numpy as np

from processing import ProcessedRun, Reason
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import axes, bars
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.notes import runs_by_text

KEY = "quality"
TITLE = "Quality of the runs"

_REASONS = {
    Reason.USED: ("used", "#0072B2", ""),
    Reason.GAP: ("gap in the data", "#111111", "x"),
    Reason.INVALID_FIX: ("invalid GNSS fix", "#D55E00", "/"),
    Reason.NOT_MEASURED: ("not measured", "#CC79A7", "\\"),
    Reason.STANDSTILL: ("standstill", "#bdbdbd", ""),
    Reason.TOO_SLOW: ("too slow for slip", "#E69F00", "."),
    Reason.FILTER_EDGE: ("edge of the filter", "#56B4E9", "-"),
    Reason.NEGATIVE_LOAD: ("negative load", "#F0E442", "+"),
    Reason.SLIP_OUT_OF_RANGE: ("slip out of range", "#009E73", "|"),
    Reason.TRANSDUCER: ("transducer status", "#882255", "x"),
    Reason.BY_HAND: ("excluded by hand", "#999933", "+"),
    Reason.SLIP_NOT_MEASURED: ("slip not measured", "#AA4499", "/"),
}


def build(material: ReportInputs) -> Section:
    """Build the section from the runs' quality reports."""
    blocks: list[Block] = [
        Panels([_shares_figure(material.runs)], _reading(material)),
        _table(material),
        *_notes(material.runs),
    ]
    numbers = {
        run.run.id: {
            "samples": len(run),
            "rate_hz": run.rate_hz,
            "length_s": _length_s(run),
            "used_share": float(np.mean(run.used)) if len(run) else 0.0,
            "grade": grade,
            "quality": run.quality,
        }
        for run, grade in zip(material.runs, material.grades, strict=True)
    }
    return Section(KEY, TITLE, blocks, numbers)


def _notes(runs: tuple[ProcessedRun, ...]) -> list[Text]:
    """Return each note once, with the runs it concerns."""
    about = runs_by_text(runs, lambda run: run.quality.notes)
    return [
        Text(f"{'all runs' if len(ids) == len(runs) > 1 else ', '.join(ids)}: {note}.") for note, ids in about.items()
    ]


def _reading(material: ReportInputs) -> str:
    lacking = f", and nothing of {material.not_fitted} because a signal is missing" if material.not_fitted else ""
    return (
        "each bar is one run with all samples of the common time base; only the blue part is fitted"
        f"{lacking}. A long part of gaps or invalid fixes means a failure of the bus or the GNSS, not of the model."
    )


def _shares_figure(runs: tuple[ProcessedRun, ...]) -> Figure:
    names = [run.run.id for run in runs]
    data = []
    for reason, (label, colour, pattern) in _REASONS.items():
        shares = [100 * float(np.mean(run.reason == reason)) if len(run) else 0.0 for run in runs]
        if any(shares):
            data.append(bars(names, shares, label, colour, pattern))
    layout = axes("share of samples (%)", "", height=150 + 28 * len(runs), barmode="stack")
    layout["xaxis"] |= {"range": [0, 100]}
    layout["yaxis"] |= {"autorange": "reversed", "type": "category"}
    return Figure("shares", "Used and excluded samples", data, layout)


def _table(material: ReportInputs) -> Table:
    rows = []
    for run, grade in zip(material.runs, material.grades, strict=True):
        rows.append(
            [
                run.run.id,
                _GRADE_LABELS[grade.level],
                f"{_length_s(run):.1f}",
                f"{100 * float(np.mean(run.used)) if len(run) else 0:.1f}",
                f"{100 * grade.usable_share:.1f}" if np.isfinite(grade.usable_share) else "–",
                f"{grade.highest_slip:.2f}" if np.isfinite(grade.highest_slip) else "–",
                _exclusion_reasons(run),
            ]
        )
    head = ["run", "grade", "length (s)", "used (%)", "used in motion (%)", "slip up to", "main exclusion reasons"]
    note = (
        "Used in motion: share of the samples without standstill, speeds too low for slip, and edges of the filter. "
        "Good from 80 % on with slip beyond 0.5; below 50 % poor; hardly driven (slip below 0.1) fair."
    )
    return Table("Runs", head, rows, note, left=2)


_GRADE_LABELS = {"good": "● good", "fair": "▲ fair", "poor": "■ poor"}


def _exclusion_reasons(run: ProcessedRun) -> str:
    """Return the two reasons that exclude most samples."""
    shares = {why: share for why, share in run.quality.shares.items() if why != Reason.USED.name and share > 0}
    most = sorted(shares, key=lambda why: -shares[why])[:2]
    return ", ".join(f"{_REASONS[Reason[why]][0]} ({100 * shares[why]:.1f} %)" for why in most) or "nothing"


def _length_s(run: ProcessedRun) -> float:
    return float(run.time_s[-1]) if len(run) else 0.0
