"""Why samples are left out, in which shares, and what a person should know of the run."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot

import numpy as np
from numpy.typing import NDArray

from daq import REACTIONS
from processing.pipeline.latency import SpeedComparison
from processing.processed_run import Reason, Segment, SensorFacts, Standstill
from processing.timebase import FloatArray

_SIGN_SAMPLES = 50
_OPPOSED = 0.3
_LITTLE_SLIP = 0.3
_RING_DELAY_S = 0.015
"""One-sigma of what the estimate owes to a toothed ring, which at low speed is later than its declared delay."""
_NOTABLE_SCALE = 0.02
_NOTABLE_GAP_SHARE = 0.1


def combine_reasons(
    channels: Iterable[NDArray[np.uint8]],
    segments: NDArray[np.uint8],
    slip: FloatArray,
    vertical_load_n: FloatArray,
    *,
    slip_is_measured: bool = True,
) -> NDArray[np.uint8]:
    """Return the first `Reason` that holds for each sample; all arrays of shape (n,).

    Parameters
    ----------
    channels : iterable of uint8 arrays
        Reasons of each channel that a used sample must have.
    segments : uint8 array
    slip : float64 array
        NaN where both speeds are too small (or unknown, which the channels' reasons say).
    vertical_load_n : float64 array
        All NaN where not measured.
    slip_is_measured : bool
        Whether the run carries both speeds.
    """
    of_channels = np.stack(list(channels))
    hold = {
        why: (of_channels == why).any(axis=0)
        for why in (Reason.GAP, Reason.INVALID_FIX, Reason.TRANSDUCER, Reason.NOT_MEASURED, Reason.FILTER_EDGE)
    }
    hold[Reason.STANDSTILL] = segments == Segment.STANDSTILL
    hold[Reason.TOO_SLOW if slip_is_measured else Reason.SLIP_NOT_MEASURED] = ~np.isfinite(slip)
    hold[Reason.NEGATIVE_LOAD] = vertical_load_n <= 0
    hold[Reason.SLIP_OUT_OF_RANGE] = np.abs(slip) > 1
    out = np.zeros(len(slip), np.uint8)
    for why in sorted(hold, key=_precedence, reverse=True):
        out[hold[why]] = why
    return out


def _precedence(why: Reason) -> float:
    """Return the place of a reason: that of its number, but the transducer's own word comes before what it causes."""
    return Reason.INVALID_FIX + 0.5 if why is Reason.TRANSDUCER else float(why)


def shares_of(reason: NDArray[np.uint8]) -> dict[str, float]:
    """Return the share of samples per `Reason` name, those that occur and USED; they sum to 1."""
    counts = np.bincount(reason, minlength=len(Reason))
    return {why.name: float(counts[why] / len(reason)) for why in Reason if counts[why] or why is Reason.USED}


def sensor_notes(sensors: dict[str, SensorFacts]) -> list[str]:
    """Return sentences on channels whose stamps or samples are poor."""
    notes = []
    for role, facts in sensors.items():
        if facts.late:
            notes.append(f"{role}: samples left out because their stamps run backward: {facts.late}")
        if not facts.samples:
            notes.append(f"{role}: frames came, but never a usable value")
        elif not np.isfinite(facts.sigma):
            notes.append(f"{role}: too few samples to tell its noise; declare [sensors.{role}] sigma")
    return notes


def speed_notes(speeds: SpeedComparison, sensors: dict[str, SensorFacts]) -> list[str]:
    """Return sentences on ground speed against wheel speed.

    A late ground speed has one likely cause, a delay that is not declared; an early one has several, so that the
    sentence proposes no number.
    """
    notes = []
    latency_s, sigma_s = speeds.latency_s, speeds.latency_sigma_s
    if abs(latency_s) > 3 * hypot(_RING_DELAY_S, sigma_s):
        said = f"ground speed is {abs(latency_s):.3f} +- {sigma_s:.3f} s"
        declared_s = {role: sensors[role].latency_s for role in ("ground_speed", "wheel_speed")}
        if latency_s > 0:
            whole_s = declared_s["ground_speed"] + latency_s
            notes.append(
                f"{said} late against wheel speed beyond the declared delays: if the receiver's data sheet allows it, "
                f"declare [sensors.ground_speed] latency_s = {whole_s:.3f} in place of {declared_s['ground_speed']:g}"
            )
        else:
            notes.append(
                f"{said} early against wheel speed: the declared latency_s of ground speed "
                f"({declared_s['ground_speed']:g} s) may be too long, or that of wheel speed "
                f"({declared_s['wheel_speed']:g} s) too short, as a toothed ring is late at low speed; check both data "
                "sheets before changing either"
            )
    scale, scale_sigma = speeds.scale, speeds.scale_sigma
    if abs(scale - 1) > max(_NOTABLE_SCALE, 3 * scale_sigma):
        notes.append(
            f"ground speed is {scale:.4f} +- {scale_sigma:.4f} of rim speed where the wheel hardly slips: "
            "check [wheel] radius_m"
        )
    return notes


def run_notes(
    reason: NDArray[np.uint8],
    gaps: dict[str, NDArray[np.uint8]],
    standing: tuple[Standstill, ...],
    torque_nm: FloatArray,
    drawbar_pull_n: FloatArray,
    slip: FloatArray,
    acceleration_mps2: FloatArray,
    vertical_load_n: FloatArray,
) -> list[str]:
    """Return sentences on the run as a whole; `gaps` are the reasons of each channel."""
    notes = []
    if not standing:
        notes.append("no standstill: zeros could not be checked")
    notes += _zero_notes(standing)
    for role, channel in gaps.items():
        share = float(np.mean((channel == Reason.GAP) | (channel == Reason.NOT_MEASURED)))
        if share > _NOTABLE_GAP_SHARE:
            notes.append(f"{role} is missing for {share:.0%} of the run, and those samples are left out")
    load = vertical_load_n[np.isfinite(vertical_load_n)]
    if len(load) and np.median(load) <= 0:
        notes.append("the vertical load is negative most of the time: check its sign (positive is up on the wheel)")
    used = reason == Reason.USED
    notes += _opposed("torque", torque_nm, "acceleration", acceleration_mps2, used)
    # whatever the soil, more slip means more pull where there is little of it, braking included
    notes += _opposed("drawbar pull", drawbar_pull_n, "slip", slip, used & (np.abs(slip) < _LITTLE_SLIP))
    return notes


def _opposed(name: str, values: FloatArray, cause: str, of: FloatArray, rows: NDArray[np.bool_]) -> list[str]:
    """Return a sentence when a force falls with what makes it rise: its sign is wrong."""
    rows = rows & np.isfinite(values) & np.isfinite(of)
    if rows.sum() <= _SIGN_SAMPLES or not np.ptp(values[rows]) > 0 or not np.ptp(of[rows]) > 0:
        return []
    correlation = float(np.corrcoef(values[rows], of[rows])[0, 1])
    if correlation > -_OPPOSED:
        return []
    return [f"{name} and {cause} are opposed (correlation {correlation:.2f}): check the sign of the {name}"]


def _zero_notes(standing: tuple[Standstill, ...]) -> list[str]:
    notes = []
    for channel in REACTIONS.values():
        role = channel.role
        seen = [(s.levels[role], s.sigmas[role]) for s in standing if role in s.levels]
        if seen and all(abs(level) > 3 * sigma for level, sigma in seen):
            values = ", ".join(f"{level:.1f} +- {sigma:.1f}" for level, sigma in seen[:4])
            what = f"{channel.name} at standstill reads {values} {channel.unit_text}"
            notes.append(f"{what}: a zero, a slope or a held brake; not subtracted")
    return notes
