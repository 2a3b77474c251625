"""How good the data are: what was kept and why not all, clocks and latencies, losses on the way."""

from __future__ import annotations

import numpy as np

from processing.processed_run import ProcessedRun, Reason, Standstill
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import axes, bars
from wheelsoil.report.material import Material
from wheelsoil.report.words import count, number, signed

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
    Reason.TRANSDUCER: ("transducer status", "#882255", "x"),
    Reason.BY_HAND: ("left out by hand", "#999933", "+"),
}


def build(material: Material) -> Section:
    """Build the section from the runs' quality reports and the sources' losses."""
    tables = [_table(material), *_sensors(material.runs), *_zeros(material.runs)]
    blocks: list[Block] = [Panels([_shares_figure(material.runs)], _READING), *tables, *_notes(material.runs)]
    numbers = {
        run.run.id: {"samples": len(run), "rate_hz": run.rate_hz, "quality": run.quality} for run in material.runs
    }
    return Section(KEY, TITLE, blocks, numbers)


def _notes(runs: tuple[ProcessedRun, ...]) -> list[Text]:
    """Return each note once, with the runs it is about."""
    about: dict[str, list[str]] = {}
    for run in runs:
        for note in run.quality.notes:
            about.setdefault(note, []).append(run.run.id)
    return [
        Text(f"{'all runs' if len(ids) == len(runs) > 1 else ', '.join(ids)}: {note}.") for note, ids in about.items()
    ]


def _sensors(runs: tuple[ProcessedRun, ...]) -> list[Table]:
    """Return what each channel looked like before it was filtered, over all runs."""
    roles = list(dict.fromkeys(role for run in runs for role in run.quality.sensors))
    rows = []
    for role in roles:
        facts = [run.quality.sensors[role] for run in runs if role in run.quality.sensors]
        sources = dict.fromkeys(fact.sigma_source for fact in facts)
        rows.append(
            [
                role.replace("_", " "),
                number(float(np.median([fact.rate_hz for fact in facts])), 4),
                count(sum(fact.gaps for fact in facts)),
                number(float(np.max([fact.longest_gap_s for fact in facts])), 3),
                number(1e3 * facts[0].latency_s),
                number(float(np.median([fact.sigma for fact in facts])), 2),
                " or ".join(sources),
                _systematic([fact.systematic_sigma for fact in facts]),
            ]
        )
    head = [
        "channel",
        "rate (Hz)",
        "gaps",
        "longest gap (s)",
        "declared delay (ms)",
        "sigma (SI)",
        "sigma is",
        "sigma of the zero",
    ]
    note = (
        "Rate and sigma: median of the runs. Sigma is of one filtered sample. Sigma of the zero: of what was "
        "taken off, the same in all samples of a run, the largest of the runs of which it is known; the intervals of "
        "the fit do not hold it."
    )
    return [Table("Channels as they came", head, rows, note)] if rows else []


def _systematic(sigmas: list[float]) -> str:
    """Return the largest sigma that is known, and of how many runs none is."""
    known = [sigma for sigma in sigmas if np.isfinite(sigma)]
    largest = number(max(known, default=float("nan")), 2)
    return largest if len(known) in (0, len(sigmas)) else f"{largest} (unknown of {len(sigmas) - len(known)} runs)"


def _zeros(runs: tuple[ProcessedRun, ...]) -> list[Table]:
    """Return what the forces read while the vehicle stood still: the zeros of the transducer."""
    roles = [
        r for r in ("drawbar_pull", "driving_torque", "vertical_load") if any(r in s.levels for s in _stands(runs))
    ]
    rows = [
        [
            run.run.id,
            f"{stand.start_s:.1f}",
            f"{stand.duration_s:.1f}",
            *(_with_sigma(stand.levels.get(r, np.nan), stand.sigmas.get(r, np.nan), ".0f") for r in roles),
        ]
        for run in runs
        for stand in run.quality.standstills
    ]
    units = {"drawbar_pull": "N", "driving_torque": "N m", "vertical_load": "N"}
    head = ["run", "from (s)", "for (s)", *(f"{role.replace('_', ' ')} ({units[role]})" for role in roles)]
    taken = "after the zero of zero.toml was taken off" if any(run.quality.zeros for run in runs) else "as sent"
    note = f"On level ground drawbar pull and torque should read zero. Read {taken}; nothing else was subtracted."
    return [Table("Readings at standstill", head, rows, note)] if rows and roles else []


def _stands(runs: tuple[ProcessedRun, ...]) -> list[Standstill]:
    return [stand for run in runs for stand in run.quality.standstills]


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
                _late_or_early(1e3 * quality.residual_latency_s, 1e3 * quality.residual_latency_sigma_s),
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
        "ground speed off by (ms)",
        "ground / rim speed",
        "clock drift (ppm)",
        "clock residual (ms)",
        "frames lost",
    ]
    note = (
        "Ground speed off by: how late or early it is against the wheel speed, after the declared delays. "
        "Ground / rim speed: on hardly slipping samples; 1 when the rolling radius is right. "
        "± is one sigma; – is not known."
    )
    return Table("Runs", head, rows, note)


def _with_sigma(value: float, sigma: float, form: str) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{signed(value, form)} ± {sigma:{form}}" if np.isfinite(sigma) else signed(value, form)


def _late_or_early(value_ms: float, sigma_ms: float) -> str:
    """Return a delay as the terminal says it: a positive number and its direction."""
    said = _with_sigma(abs(value_ms), sigma_ms, ".0f")
    return f"{said} {'late' if value_ms >= 0 else 'early'}" if np.isfinite(value_ms) else said


def _or_dash(value: float | None, form: str) -> str:
    return "–" if value is None or not np.isfinite(value) else signed(value, form)
