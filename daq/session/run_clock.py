"""The time of one run: the session's, moved to how the host's clock was set when the run began.

A machine without a clock of its own learns the date after the logger has started; the session's time then goes on
evenly, and the next run begins with the right date.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from daq.channel import Channel
from daq.clock import ClockFit
from daq.frames import FrameBatch
from daq.host_clock import HostClock


class RunClock:
    """Brings the session's times to those of a run that begins now.

    Parameters
    ----------
    clock : HostClock

    Attributes
    ----------
    shift_ns : int
        File time of the run less that of the session.
    """

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        clock.observe()
        self.shift_ns = clock.realtime_minus_monotonic_ns - clock.base_ns if clock.steps else 0

    @property
    def base_ns(self) -> int:
        """File time less monotonic time."""
        return self._clock.base_ns + self.shift_ns

    def now_ns(self) -> int:
        """Return file time."""
        return self._clock.now_ns() + self.shift_ns

    def frames(self, batch: FrameBatch) -> FrameBatch:
        """Return frames with the run's times."""
        if not self.shift_ns:
            return batch
        moved = FrameBatch(batch.frames.copy(), batch.buses)
        moved.frames["time_ns"] += self.shift_ns
        return moved

    def channels(self, decoded: Mapping[tuple[str, str], Channel]) -> Mapping[tuple[str, str], Channel]:
        """Return decoded channels with the run's times."""
        if not self.shift_ns:
            return decoded
        return {key: replace(channel, time_ns=channel.time_ns + self.shift_ns) for key, channel in decoded.items()}

    def steps(self) -> list[tuple[int, str]]:
        """Return every time the clock was set, in the run's time, and by how much."""
        return [(step.time_ns + self.shift_ns, f"{step.step_s:+.6f} s") for step in self._clock.steps]

    def told(self, fit: ClockFit | None) -> dict[str, str]:
        """Return the fit to GNSS time in the run's time, and every time the clock was set, for a metadata record."""
        told = {f"step.{number}": f"{step} at {at_ns}" for number, (at_ns, step) in enumerate(self.steps(), 1)}
        if fit is not None:
            offset_s, reference_ns = fit.offset_s + self.shift_ns * 1e-9, fit.reference_ns + self.shift_ns
            told |= replace(fit, offset_s=offset_s, reference_ns=reference_ns).as_metadata()
        return told
