"""The facts of a processed run that a person wants to see first, as rows of text."""

from __future__ import annotations

from math import isfinite

import numpy as np

from daq import ROLES, moment
from processing import ProcessedRun, Reason, Segment, SensorFacts

_QUANTITIES = (
    ("slip", "slip", ".3f", 1.0),
    ("ground speed m/s", "ground_speed_mps", ".2f", 1.0),
    ("vertical load kN", "vertical_load_n", ".2f", 1e-3),
    ("drawbar pull kN", "drawbar_pull_n", ".2f", 1e-3),
    ("driving torque kNm", "driving_torque_nm", ".2f", 1e-3),
    ("sinkage mm", "sinkage_m", ".0f", 1e3),
)
_SIGMA_SOURCES = {"declared": "from the declared one", "estimated": "estimated", "standstill": "from standstill"}


def summary_table(run: ProcessedRun) -> list[tuple[str, str]]:
    """Return (what, value) rows in the order of a report; notes are in ``run.quality.notes``."""
    quality = run.quality
    counts = np.bincount(run.segment, minlength=len(Segment))
    rows = [
        ("run", run.run.id or "-"),
        ("start", moment(run.start_ns)),
        ("duration", f"{len(run) / run.rate_hz:.1f} s at {run.rate_hz:g} Hz, filtered at {run.cutoff_hz:.3g} Hz"),
        ("used", f"{100 * quality.shares.get(Reason.USED.name, 0.0):.1f} % of {len(run)} samples"),
        ("left out", _left_out(quality.shares)),
        (
            "segments",
            ", ".join(f"{kind.name.lower()} {counts[kind] / run.rate_hz:.1f} s" for kind in Segment if counts[kind]),
        ),
        *_ranges(run),
        ("ground speed against wheel speed", _latency(quality.residual_latency_s, quality.residual_latency_sigma_s)),
        ("ground speed / rim speed", _with_sigma(quality.speed_scale, quality.speed_scale_sigma, ".4f", "")),
        *_radius(run),
        *_clock(quality.clock),
    ]
    return rows + [
        (role, _sensor(facts, ROLES[role].unit_text, _outboard(run, role))) for role, facts in quality.sensors.items()
    ]


def _left_out(shares: dict[str, float]) -> str:
    parts = [
        f"{name.lower().replace('_', ' ')} {100 * share:.1f} %"
        for name, share in sorted(shares.items(), key=lambda item: -item[1])
        if name != Reason.USED.name
    ]
    return ", ".join(parts) or "nothing"


def _ranges(run: ProcessedRun) -> list[tuple[str, str]]:
    """Return 5th, 50th and 95th percentile of each quantity over the used samples."""
    rows = []
    for label, name, style, factor in _QUANTITIES:
        values = factor * getattr(run, name)[run.used]
        values = values[np.isfinite(values)]
        if len(values):
            low, middle, high = np.percentile(values, [5, 50, 95])
            rows.append((label, f"{low:{style}} / {middle:{style}} / {high:{style}} (5 / 50 / 95 %)"))
    return rows


def _latency(latency_s: float, sigma_s: float) -> str:
    if not isfinite(latency_s):
        return "latency not identifiable"
    return f"{abs(latency_s):.3f} ± {sigma_s:.3f} s {'late' if latency_s >= 0 else 'early'}"


def _with_sigma(value: float, sigma: float, style: str, unit: str) -> str:
    return f"{value:{style}} ± {sigma:{style}}{unit}" if isfinite(value) else "not identifiable"


def _radius(run: ProcessedRun) -> list[tuple[str, str]]:
    scale, sigma = run.quality.speed_scale, run.quality.speed_scale_sigma
    if not isfinite(scale):
        return []
    radius = run.rolling_m
    return [
        ("effective rolling radius", _with_sigma(scale * radius, sigma * radius, ".4f", f" m (given {radius:g} m)"))
    ]


def _clock(clock: dict[str, float]) -> list[tuple[str, str]]:
    if not clock:
        return []
    jitter_ms = 1e3 * clock["residual_s"]
    text = f"{clock['offset_s']:+.4f} s, drift {clock['drift_ppm']:+.2f} ppm, jitter {jitter_ms:.2f} ms"
    return [("host clock against GNSS", text)]


def _outboard(run: ProcessedRun, role: str) -> str:
    """Return what of the parts outboard of the transducer a force is corrected for; empty where it is not."""
    inertia = {
        "drawbar_pull": ("ground_speed", run.outboard_mass_kg, "kg"),
        "driving_torque": ("wheel_speed", run.outboard_inertia_kgm2, "kg m2"),
    }
    speed, size, unit = inertia.get(role, ("", 0.0, ""))
    return f"{size:g} {unit} outboard" if size and speed in run.quality.sensors else ""


def _sensor(facts: SensorFacts, unit: str, outboard: str) -> str:
    if not isfinite(facts.rate_hz):
        return f"{facts.samples} samples"
    gaps = f"{facts.gaps} gaps, longest {facts.longest_gap_s:.2f} s" if facts.gaps else "no gaps"
    zero = f", zero ± {facts.systematic_sigma:.3g} {unit}" if isfinite(facts.systematic_sigma) else ""
    excluded = f", {facts.distrusted:,} left out by the transducer's status" if facts.distrusted else ""
    sources = [_SIGMA_SOURCES[facts.sigma_source], *([f"the correction for {outboard}"] if outboard else [])]
    sigma = f"sigma {facts.sigma:.3g} {unit} after the filter ({' and '.join(sources)})"
    return f"{facts.rate_hz:.4g} Hz, {gaps}, {sigma}{zero}{excluded}"
