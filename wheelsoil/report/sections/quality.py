"""Quality of the runs, with what is excluded and why, and health of the sensors, clocks and recordings."""

from __future__ import annotations

import numpy as np

from daq import ROLES, TRANSDUCER_ROLES
from daq.recording import Event
from model.diagnosis import ROLLING_RADIUS_SHARE, rolled
from processing import ProcessedRun, Reason
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, section
from wheelsoil.report.figures import axes, bars
from wheelsoil.report.inputs import ReportInputs, Source
from wheelsoil.wording.losses import losses_as_texts
from wheelsoil.wording.notes import noted_of_runs
from wheelsoil.wording.numbers import count, number, signed
from wheelsoil.workflows.key_figures import Z95

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
    Reason.STEERED: ("steered", "#44AA99", "\\"),
    Reason.SENSOR_FAULT: ("no measurement", "#661100", "|"),
    Reason.FIRM_GROUND: ("on firm ground", "#6699CC", "."),
    Reason.SET_ASIDE: ("run set aside", "#888888", "-"),
}

_GRADE_LABELS = {"good": "● good", "fair": "▲ fair", "poor": "■ poor"}

_MOST_EVENTS = 40


@section("quality", "Quality of the runs")
def quality(inputs: ReportInputs) -> Contents:
    """Build the section from the runs' quality reports."""
    notes = [Text(f"{text}.") for text in noted_of_runs([(run.run.id, run.quality.notes) for run in inputs.runs])]
    blocks: list[Block] = [
        Panels([_shares_figure(inputs.runs)], _reading(inputs)),
        _runs_table(inputs),
        *(Text(f"Set aside: {run.run}: {run.reason}. Next: {run.next_step}.", "warning") for run in inputs.set_aside),
        *notes,
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
        for run, grade in zip(inputs.runs, inputs.grades, strict=True)
    }
    return blocks, numbers


def _reading(inputs: ReportInputs) -> str:
    lacking = f", and nothing of {inputs.not_fitted} because a signal is missing" if inputs.not_fitted else ""
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
    layout = axes("share of samples (%)", "", height=150 + 28 * len(runs))
    layout["xaxis"] |= {"range": [0, 100]}
    layout["yaxis"] |= {"order": names}
    return Figure("shares", "Used and excluded samples", data, layout)


def _runs_table(inputs: ReportInputs) -> Table:
    rows = []
    for run, grade in zip(inputs.runs, inputs.grades, strict=True):
        # The two reasons that exclude most samples.
        shares = {why: share for why, share in run.quality.shares.items() if why != Reason.USED.name and share > 0}
        most = sorted(shares, key=lambda why: -shares[why])[:2]
        rows.append(
            [
                run.run.id,
                _GRADE_LABELS[grade.level],
                f"{_length_s(run):.1f}",
                f"{100 * float(np.mean(run.used)) if len(run) else 0:.1f}",
                f"{100 * grade.usable_share:.1f}" if np.isfinite(grade.usable_share) else "–",
                f"{grade.highest_slip:.2f}" if np.isfinite(grade.highest_slip) else "–",
                ", ".join(f"{_REASONS[Reason[why]][0]} ({100 * shares[why]:.1f} %)" for why in most) or "nothing",
            ]
        )
    head = ["run", "grade", "length (s)", "used (%)", "used in motion (%)", "slip up to", "main exclusion reasons"]
    note = (
        "Used in motion: share of the samples without standstill, speeds too low for slip, and edges of the filter. "
        "Good from 80 % on with slip beyond 0.5; below 50 % poor; hardly driven (slip below 0.1) fair."
    )
    return Table("Runs", head, rows, note, left=2, words=("main exclusion reasons",))


def _length_s(run: ProcessedRun) -> float:
    return float(run.time_s[-1]) if len(run) else 0.0


@section("sensors", "Sensors, clocks and losses")
def sensors(inputs: ReportInputs) -> Contents:
    """Build the section from the runs' quality reports and their recordings."""
    coasted = _coasted(inputs)
    blocks: list[Block] = [
        *_channels_table(inputs.runs),
        _clocks(inputs),
        *_losses(inputs.sources),
        *_events(inputs),
        *_zeros(inputs.runs),
        *([_coasted_table(inputs, coasted)] if coasted else []),
    ]
    numbers = {
        run.run.id: {
            "sensors": run.quality.sensors,
            "clock": run.quality.clock,
            "residual_latency_s": run.quality.residual_latency_s,
            "residual_latency_sigma_s": run.quality.residual_latency_sigma_s,
            "speed_scale": run.quality.speed_scale,
            "speed_scale_sigma": run.quality.speed_scale_sigma,
            "standstills": run.quality.standstills,
            "recording": inputs.source_of(run),
            "events_at_s": [time_s for time_s, _ in _timed(run, inputs.source_of(run))],
        }
        for run in inputs.runs
    }
    of_tests = [{"test": name, "radius": radius, "interval95": ends} for name, (radius, *ends) in coasted]
    radii = {"rolling_radius_mm": of_tests} if coasted else {}
    return blocks, {"runs": numbers, "channels": channels_of(inputs.runs), **radii}


def channels_of(runs: tuple[ProcessedRun, ...]) -> dict[str, dict[str, float]]:
    """Return what each channel looked like before it was filtered, over all runs."""
    roles = list(dict.fromkeys(role for run in runs for role in run.quality.sensors))
    found = {}
    for role in roles:
        facts = [run.quality.sensors[role] for run in runs if role in run.quality.sensors]
        found[role] = {
            "rate_hz": float(np.median([fact.rate_hz for fact in facts])),
            "gaps": sum(fact.gaps for fact in facts),
            "longest_gap_ms": 1e3 * float(np.max([fact.longest_gap_s for fact in facts])),
            "latency_ms": 1e3 * facts[0].latency_s,
            "sigma": float(np.median([fact.sigma for fact in facts])),
            "late": sum(fact.late for fact in facts),
            "distrusted": sum(fact.distrusted for fact in facts),
        }
    return found


def _channels_table(runs: tuple[ProcessedRun, ...]) -> list[Table]:
    rows = []
    for role, found in channels_of(runs).items():
        facts = [run.quality.sensors[role] for run in runs if role in run.quality.sensors]
        rows.append(
            [
                ROLES[role].name,
                number(found["rate_hz"], 4),
                count(int(found["gaps"])),
                number(found["longest_gap_ms"]),
                number(found["latency_ms"]),
                f"{number(found['sigma'], 2)} {ROLES[role].unit_text}".rstrip(),
                " or ".join(dict.fromkeys(fact.sigma_source for fact in facts)),
                _systematic([fact.systematic_sigma for fact in facts]),
                count(int(found["late"] + found["distrusted"])),
            ]
        )
    head = [
        "channel",
        "rate (Hz)",
        "gaps",
        "longest gap (ms)",
        "declared delay (ms)",
        "sigma",
        "sigma is",
        "sigma of the zero",
        "samples distrusted",
    ]
    note = (
        "Rate and sigma: median of the runs. Sigma refers to one filtered sample; for pull and torque it includes the "
        "correction for the parts outboard of the transducer. Sigma of the zero: of the subtracted zero, equal in all "
        "samples of a run, the largest known one of the runs; the intervals of the fit do not include it. "
        "Distrusted: the time stamp ran backward, or the transducer's status was not 0."
    )
    return [Table("Channels as recorded", head, rows, note, words=("sigma is",))] if rows else []


def _systematic(sigmas: list[float]) -> str:
    """Return the largest known sigma, and the number of runs without one."""
    known = [sigma for sigma in sigmas if np.isfinite(sigma)]
    largest = number(max(known, default=float("nan")), 2)
    return largest if len(known) in (0, len(sigmas)) else f"{largest} (unknown of {len(sigmas) - len(known)} runs)"


def _zeros(runs: tuple[ProcessedRun, ...]) -> list[Table]:
    """Return the force readings at standstill, which show the zeros of the transducer."""
    roles = [
        role
        for role in TRANSDUCER_ROLES
        if any(role in stand.levels for run in runs for stand in run.quality.standstills)
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
    head = ["run", "from (s)", "for (s)", *(f"{ROLES[role].name} ({ROLES[role].unit_text})" for role in roles)]
    taken = "after subtraction of the zero in zero.toml" if any(run.quality.zeros for run in runs) else "as sent"
    note = f"On level ground drawbar pull and torque should read zero. Read {taken}; nothing else was subtracted."
    return [Table("Readings at standstill", head, rows, note)] if rows and roles else []


def _coasted(inputs: ReportInputs) -> list[tuple[str, list[float]]]:
    """Return the radius of each test of the diagnosis in which the wheel coasted, and its 95 % interval, mm."""
    tests = inputs.diagnosed.static if inputs.diagnosed else ()
    radii = [
        (f"run {test.run}" if test.run else f"by hand, {test.ground_speed_mps} m/s", rolled(test)) for test in tests
    ]
    return [(name, [1e3 * (found[0] + z * found[1]) for z in (0.0, -Z95, Z95)]) for name, found in radii if found]


def _coasted_table(inputs: ReportInputs, coasted: list[tuple[str, list[float]]]) -> Table:
    slip = number(1e3 * inputs.vehicle.wheel.rolling_m, 4) if inputs.vehicle.wheel else "–"
    rows = [[name, *(number(size, 4) for size in sizes), slip] for name, sizes in coasted]
    head = ["coasting", "ground / wheel speed (mm)", "from (mm)", "to (mm)", "radius of the slip (mm)"]
    note = f"95 % interval, with {100 * ROLLING_RADIUS_SHARE:g} % by which the radius on soil may differ (one sigma)."
    return Table("Rolling radius on firm ground", head, rows, note)


def _clocks(inputs: ReportInputs) -> Table:
    rows = [
        [
            run.run.id,
            _late_or_early(1e3 * run.quality.residual_latency_s, 1e3 * run.quality.residual_latency_sigma_s),
            _with_sigma(run.quality.speed_scale, run.quality.speed_scale_sigma, ".4f"),
            _or_dash(run.quality.clock.get("offset_s"), ".3f"),
            _or_dash(run.quality.clock.get("drift_ppm"), ".1f"),
            _or_dash(1e3 * run.quality.clock.get("residual_s", np.nan), ".2f"),
        ]
        for run in inputs.runs
    ]
    head = [
        "run",
        "ground speed delay (ms)",
        "ground / rim speed",
        "host - GNSS time (s)",
        "drift (ppm)",
        "residual (ms)",
    ]
    note = (
        "Ground speed delay: late or early relative to the wheel speed, after the declared delays. "
        "Ground / rim speed: on samples with little slip; 1 if the rolling radius is correct. "
        "± is one sigma; – is unknown."
    )
    return Table("Clocks and speeds", head, rows, note)


def _losses(sources: tuple[Source, ...]) -> list[Block]:
    """Return frame counts, losses and the end of each recording."""
    rows = [
        [
            source.run_id,
            count(source.frames) if source.frames is not None else "–",
            count(source.dropped_frames) if source.dropped_frames is not None else "not counted",
            "a log" if source.exit_status is None else source.exit_status or "cut off",
            "; ".join([*source.loss, *source.gaps]) or "nothing",
            ", ".join(f"{key} {text}" for key, text in source.clock_steps.items()) or "was not set",
        ]
        for source in sources
    ]
    note = (
        "Frames lost: by the kernel or the logger's queue, before they were recorded; “not counted” if the recorder "
        "had no counter. Unreadable: damaged, or not recorded between two parts of the run."
    )
    head = ["run", "frames", "frames lost", "recording ended", "unreadable", "clock of the host"]
    words = ("recording ended", "unreadable", "clock of the host")
    blocks: list[Block] = [Table("Recordings", head, rows, note, words=words)] if rows else []
    counted = [[source.run_id, key, text] for source in sources for key, text in losses_as_texts(source.losses).items()]
    if counted:
        blocks.append(Table("Losses counted by the logger", ["run", "where", "frames"], counted, left=2))
    return blocks


def _events(inputs: ReportInputs) -> list[Table]:
    """Return marks and faults during recording, with the time in seconds of the run."""
    rows = [
        [run.run.id, f"{time_s:.1f}", event.severity if event.name != "mark" else "mark", event.text]
        for run in inputs.runs
        for time_s, event in _timed(run, inputs.source_of(run))
    ]
    note = f"The first {_MOST_EVENTS} of {count(len(rows))}; report.json has all." if len(rows) > _MOST_EVENTS else ""
    head = ["run", "at (s)", "kind", "what"]
    return [Table("Marks and events", head, rows[:_MOST_EVENTS], note, left=4)] if rows else []


def _timed(run: ProcessedRun, source: Source | None) -> list[tuple[float, Event]]:
    return [(1e-9 * (event.time_ns - run.start_ns), event) for event in (source.events if source else ())]


def _with_sigma(value: float, sigma: float, form: str) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{signed(value, form)} ± {sigma:{form}}" if np.isfinite(sigma) else signed(value, form)


def _late_or_early(value_ms: float, sigma_ms: float) -> str:
    """Return a delay as a positive number and its direction."""
    delay = _with_sigma(abs(value_ms), sigma_ms, ".0f")
    return f"{delay} {'late' if value_ms >= 0 else 'early'}" if np.isfinite(value_ms) else delay


def _or_dash(value: float | None, form: str) -> str:
    return "–" if value is None or not np.isfinite(value) else signed(value, form)
