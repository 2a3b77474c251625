"""What a person may choose about processing, checked at the door."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite

from daq import ConfigError, Fault, nearest

SLIP_ROLES = ("wheel_speed", "ground_speed")
FORCE_ROLES = ("vertical_load", "drawbar_pull")

NEEDED_ROLES: dict[str, tuple[str, ...]] = {
    "process": SLIP_ROLES,
    "fit": SLIP_ROLES + FORCE_ROLES,
    "fit_torque": (*SLIP_ROLES, *FORCE_ROLES, "driving_torque"),
    "sinkage": (*SLIP_ROLES, *FORCE_ROLES, "driving_torque"),
    "diagnose": SLIP_ROLES + FORCE_ROLES,
}
"""Roles that each purpose cannot do without; every other role is used where it is there."""

LOOK = "look"
"""The purpose that shows what is there: it needs some role, and no role in particular."""

HIGHEST_AUTOMATIC_CUTOFF_HZ = 5.0


@dataclass(frozen=True)
class ProcessOptions:
    """Choices for `processing.pipeline.process`.

    Attributes
    ----------
    rate_hz : float
        Rate of the time base.
    cutoff_hz : float or None
        -3 dB frequency of the common low-pass, at most a tenth of `rate_hz`; None: a fifth of the slowest
        channel's rate, at most 5 Hz.
    min_speed_mps : float or None
        Slip is formed where ground speed or rim speed is at least this; None: 0.5 m/s, less for a slow vehicle (see
        `processing.pipeline.kinematics.pace_of`).
    max_gap_s : float or None
        Longest hole between samples that the filter may bridge; None: one standard deviation of its kernel.
        A channel's own 1.75 sampling intervals are always bridged.
    purpose : str
        Key of `NEEDED_ROLES`, or `LOOK`.
    """

    rate_hz: float = 100.0
    cutoff_hz: float | None = None
    min_speed_mps: float | None = None
    max_gap_s: float | None = None
    purpose: str = "process"

    def __post_init__(self) -> None:
        numbers = {name: getattr(self, name) for name in ("rate_hz", "cutoff_hz", "min_speed_mps", "max_gap_s")}
        faults = [
            Fault(f"{name} must be a positive number", found=str(value))
            for name, value in numbers.items()
            if value is not None and not (isfinite(value) and value > 0)
        ]
        if not faults and not 1 <= self.rate_hz <= 10_000:
            faults.append(Fault("rate_hz is out of range", found=f"{self.rate_hz:g}", expected="1 to 10000"))
        if not faults and self.cutoff_hz is not None and self.cutoff_hz > self.rate_hz / 10:
            faults.append(
                Fault(
                    "cutoff_hz is too high for the time base",
                    found=f"{self.cutoff_hz:g} Hz at {self.rate_hz:g} Hz",
                    expected=f"at most {self.rate_hz / 10:g} Hz",
                    next_step="lower the cut-off or raise the rate",
                )
            )
        known = (*NEEDED_ROLES, LOOK)
        if self.purpose not in known:
            faults.append(Fault(f"no purpose is called {self.purpose!r}", expected=nearest(self.purpose, known)))
        ConfigError.stop_if_any(faults)


def require_roles(available: Iterable[str], purpose: str, *, rotating: bool = False, where: str = "[signals]") -> None:
    """Check that every role a purpose (key of `NEEDED_ROLES`) needs is there.

    If the transducer is `rotating`, it reports in wheel axes: forces need each other and the wheel angle.

    Raises
    ------
    ConfigError
        Names every missing role at once.
    """
    have = set(available)
    needed = set(NEEDED_ROLES[purpose])
    if rotating and have & set(FORCE_ROLES):
        needed |= {*FORCE_ROLES, "wheel_angle"}
    ConfigError.stop_if_any(_missing(role, purpose, sorted(have), where) for role in sorted(needed - have))


def _missing(role: str, purpose: str, have: list[str], where: str) -> Fault:
    return Fault(
        f"no signal has the role {role!r}, which {purpose.replace('_', ' with ')} needs",
        where=where,
        found=", ".join(have) or "no roles at all",
        next_step=f'add {role} = "Message.Signal" to [signals] of vehicle.toml',
    )
