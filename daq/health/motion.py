"""Whether the vehicle moves, by the two speeds it knows; and when they contradict each other."""

from __future__ import annotations

import math
from collections.abc import Mapping

from daq.health.board import Since, reason
from daq.health.report import Level, Reason

MOVING_MPS = 0.5
_RESTING_MPS = 0.1
_CONTRADICTED_MPS = 1.0
_STANDING_S, _ALL_SLIP_S = 1.0, 3.0
_PLAUSIBLE_RADIUS_M = 0.5


class Motion:
    """Follows the speeds from report to report.

    Parameters
    ----------
    radius_m : float or None
        Of the wheel; a usual one where vehicle.toml tells none, as only walking pace matters here.
    """

    def __init__(self, radius_m: float | None) -> None:
        self._radius_m = radius_m or _PLAUSIBLE_RADIUS_M
        self._since = Since()
        self._last_ns: int | None = None
        self.ground_mps = self.rim_mps = math.nan
        self.moved_s = {"ground_speed": 0.0, "wheel_speed": 0.0}
        """For how long the vehicle has moved, by what each speed says."""

    @property
    def resting(self) -> bool:
        """Whether the vehicle stands, as far as is known."""
        known = [abs(speed) for speed in (self.ground_mps, self.rim_mps) if math.isfinite(speed)]
        return bool(known) and max(known) < _RESTING_MPS

    def take(self, now_ns: int, values: Mapping[str, float]) -> None:
        """Take the last values of the roles, SI; NaN or absent where there is none."""
        self.ground_mps = values.get("ground_speed", math.nan)
        self.rim_mps = values.get("wheel_speed", math.nan) * self._radius_m
        elapsed_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        for role, speed in (("ground_speed", self.ground_mps), ("wheel_speed", self.rim_mps)):
            if abs(speed) > MOVING_MPS:
                self.moved_s[role] += elapsed_s

    def reasons(self, now_ns: int, where: Mapping[str, str]) -> list[Reason]:
        """Return the contradictions.

        Parameters
        ----------
        now_ns : int
        where : mapping role -> str
            The signals, as people read them.
        """
        found = []
        stands = self.rim_mps == 0 and abs(self.ground_mps) > _CONTRADICTED_MPS
        if self._since.held_s("wheel", now_ns, stands) > _STANDING_S:
            what = f"is exactly 0 while the ground speed is {self.ground_mps:.1f} m/s"
            found.append(reason("wheel_speed_zero", Level.AMBER, where["wheel_speed"], what))
        spins = self.ground_mps == 0 and abs(self.rim_mps) > _CONTRADICTED_MPS
        if self._since.held_s("ground", now_ns, spins) > _ALL_SLIP_S:
            what = f"is exactly 0 while the rim runs at {self.rim_mps:.1f} m/s"
            found.append(reason("ground_speed_zero", Level.AMBER, where["ground_speed"], what))
        return found
