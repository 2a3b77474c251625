"""What a person should know of the zero that was taken off a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from daq.zero_file import Determination
from processing.transducer_zero.choose import RoleZero

_OLD_S = 86_400.0
_WARMER_K = 10.0
_SIGNIFICANT_SIGMAS = 3.0


def zero_notes(
    chosen: Mapping[str, RoleZero],
    roles: Sequence[str],
    span_ns: tuple[int, int],
    source: str,
    temperature_degc: float | None,
    without_angle: tuple[int, int] | None,
) -> list[str]:
    """Return sentences on the zero of a run.

    Parameters
    ----------
    chosen : mapping role -> RoleZero
    roles : sequence of str
        Roles of the transducer that the run has.
    span_ns : (first, last)
        Of the run.
    source : str
        Where the determinations were read.
    temperature_degc : float or None
        Of the transducer during the run.
    without_angle : (count, total) or None
        Samples of which only the stationary part was taken off, and of how many; None where they are too few to tell.
    """
    notes = []
    told: dict[str, list[str]] = {}
    for role, zero in chosen.items():
        how = " and ".join(f"{one.of.method} {_age(one.of, span_ns)}" for one in zero.used)
        told.setdefault(how, []).append(role)
    for how, those in told.items():
        notes.append(f"zero of {', '.join(those)} taken off, from {source}: {how}")
    doubts = [_doubts(one.of, span_ns, temperature_degc) for zero in chosen.values() for one in zero.used]
    notes += dict.fromkeys(doubt for each in doubts for doubt in each)
    for role, zero in chosen.items():
        change, sigma = zero.drift()
        if abs(change) > _SIGNIFICANT_SIGMAS * sigma:
            unit = "N m" if role == "driving_torque" else "N"
            notes.append(
                f"the zero of {role} moved by {change:+.1f} +- {sigma:.1f} {unit} from before the run to after it"
            )
    missing = [role for role in roles if role not in chosen]
    if missing:
        notes.append(f"{source} has no zero of {', '.join(missing)}")
    if without_angle:
        count, total = without_angle
        notes.append(
            f"of {count:,} of {total:,} transducer samples the wheel angle is not known: "
            "only the stationary zero is taken off"
        )
    return notes


def _doubts(one: Determination, span_ns: tuple[int, int], temperature_degc: float | None) -> list[str]:
    doubts = []
    if abs(_age_s(one, span_ns)) > _OLD_S:
        doubts.append(f"the zero was taken {_age(one, span_ns)}: take one before and after every run")
    there = one.temperature_degc
    if there is not None and temperature_degc is not None and abs(there - temperature_degc) > _WARMER_K:
        doubts.append(f"the zero was taken at {there:.0f} degC, and the run began at {temperature_degc:.0f} degC")
    if one.method == "standstill" and one.frame == "wheel":
        doubts.append("the zero is of a standstill in wheel axes: the outboard weight is the declared one")
    elif one.method == "standstill":
        doubts.append(
            "the zero is of a standstill: the transducer's rotating zero is not known, and its part at that wheel "
            "angle is taken off the mean of the forces"
        )
    return doubts


def _age_s(one: Determination, span_ns: tuple[int, int]) -> float:
    """Return how long before the run (negative: after its end) a zero was taken."""
    if one.time_ns > span_ns[1]:
        return (span_ns[1] - one.time_ns) * 1e-9
    return max(span_ns[0] - one.time_ns, 0) * 1e-9


def _age(one: Determination, span_ns: tuple[int, int]) -> str:
    seconds = _age_s(one, span_ns)
    if not seconds:
        return "during the run"
    size = abs(seconds)
    told = (
        f"{size / 60:.0f} min"
        if size < 2 * 3600
        else f"{size / 3600:.1f} h"
        if size < 48 * 3600
        else f"{size / 86_400:.0f} days"
    )
    return f"{told} {'before' if seconds > 0 else 'after'} the run"
