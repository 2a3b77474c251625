"""The health report: status of every bus, message and signal, and the reasons for its level, the worst first."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum

from daq.clock import ClockFit
from daq.logger.health.codes import CODES
from daq.sources.can_source import BusStatus

STAYS_NS = 3_000_000_000
"""A reason is kept this long after it last held, with its level."""
RECENT_NS = 10_000_000_000
"""What has happened in this time is happening now."""


class Level(IntEnum):
    """Severity: red means that data are being lost or are wrong now."""

    GREEN = 0
    AMBER = 1
    RED = 2


@dataclass(frozen=True)
class Reason:
    """One reason for a level above green.

    Attributes
    ----------
    code : str
        A key of `daq.logger.health.codes.CODES`, e.g. ``"signal_stuck"``; stable, for programs.
    bus : str
        Or what else it is about: ``"host"``, ``"gnss"``, ``"recording"``, ...
    name : str
        Message or signal of the bus, e.g. ``"WFT_Forces.Fz"``; empty where it is about the whole.
    what : str
        One sentence with numbers.
    where : str
        Bus and name as people read them, e.g. ``"can0: WFT_Forces.Fz"``.
    """

    code: str
    level: Level
    bus: str
    name: str
    what: str
    next_step: str
    where: str


@dataclass(frozen=True)
class HostStatus:
    """Status of the machine and of the logger's process.

    Attributes
    ----------
    buses : mapping bus -> BusStatus
    queue_share : float
        How full the queue between the buses and the disk is, 0 to 1.
    skipped_frames : int
        Frames that were recorded, but not decoded, because the logger was behind.
    disk_free_bytes, disk_reserve_bytes : int
        Free space; where recording ends.
    disk_bytes_per_s : float
        How fast the recording grows; NaN until it is known.
    cpu_share : float
        Of one core, since the last report; NaN until it is known.
    clock_steps : int
        How often the host's clock was set.
    last_step_s : float
        By how much, the last time; NaN without a step.
    """

    buses: Mapping[str, BusStatus]
    queue_share: float = 0.0
    skipped_frames: int = 0
    disk_free_bytes: int = 0
    disk_reserve_bytes: int = 0
    disk_bytes_per_s: float = float("nan")
    cpu_share: float = float("nan")
    rss_bytes: int = 0
    clock_steps: int = 0
    last_step_s: float = float("nan")


@dataclass(frozen=True)
class BusHealth:
    """A bus now.

    Attributes
    ----------
    level : Level
        Worst level of the reasons at this bus.
    rate_hz : float
        Frames per second.
    load : float
        Share of the bit rate, 0 to 1; NaN where vehicle.toml states no bit rate.
    age_s : float
        Since the last frame; NaN before the first.
    error_frames : int
        Since the logger started.
    unknown_frames : int
        Frames that no DBC describes.
    """

    name: str
    level: Level
    status: BusStatus
    rate_hz: float
    load: float
    age_s: float
    error_frames: int
    unknown_frames: int


@dataclass(frozen=True)
class MessageHealth:
    """A DBC message now; counts are since the logger started.

    Attributes
    ----------
    rate_hz, usual_rate_hz : float
        Over the last second; frames over time of the last seconds without a gap (the DBC's cycle time, before
        anything is learned). NaN: not known.
    gaps : int
        Intervals well beyond the usual in which frames were lost.
    missing : int
        Frames that those intervals lack, by the learned rate.
    counter_jumps : int
        Frames that the rolling counter says are lost; 0 where there is no counter.
    """

    bus: str
    name: str
    level: Level
    rate_hz: float
    usual_rate_hz: float
    age_s: float
    frames: int
    gaps: int
    missing: int
    counter_jumps: int


@dataclass(frozen=True)
class SignalHealth:
    """A signal now.

    Attributes
    ----------
    bus, name, unit : str
        ``name`` is ``"Message.Signal"``; the unit is the DBC's.
    role : str
        Empty where vehicle.toml gives it none.
    value : float
        The last one.
    out_of_range, saturated : int
        Samples beyond the DBC's range, or at the end of what the bits can hold.
    stuck_s : float
        How long it has not changed, although it used to; 0 while it changes.
    """

    bus: str
    name: str
    unit: str
    role: str
    level: Level = Level.GREEN
    value: float = float("nan")
    out_of_range: int = 0
    saturated: int = 0
    stuck_s: float = 0.0


@dataclass(frozen=True)
class GnssHealth:
    """The receiver now.

    Attributes
    ----------
    fix : bool or None
        None where no role carries it.
    age_s : float
        Since the last valid fix.
    clock : ClockFit or None
        Host against GNSS time; None until it can be fitted.
    """

    level: Level
    fix: bool | None
    age_s: float
    clock: ClockFit | None


@dataclass(frozen=True)
class HealthReport:
    """Health of everything at one moment.

    Attributes
    ----------
    time_ns : int
        On the recording's time base.
    level : Level
        The worst reason's.
    reasons : tuple of Reason
        The worst first.
    gnss : GnssHealth or None
        None without GNSS roles.
    losses : mapping str -> int
        What `HealthMonitor.losses` counts.
    """

    time_ns: int
    level: Level
    reasons: tuple[Reason, ...]
    buses: tuple[BusHealth, ...]
    messages: tuple[MessageHealth, ...]
    signals: tuple[SignalHealth, ...]
    gnss: GnssHealth | None
    host: HostStatus
    losses: Mapping[str, int] = field(default_factory=dict)


def reason(code: str, level: Level, bus: str, what: str, *, name: str = "", next_step: str = "") -> Reason:
    """Return a reason; without a next step the code's own, with the name of the bus put in."""
    step = next_step or CODES[code].next_step.format(bus=bus)
    return Reason(code, level, bus, name, what, step, f"{bus}: {name}" if name else bus)


def worst(reasons: Iterable[Reason]) -> Level:
    """Return the worst level, green where there is no reason."""
    return max((entry.level for entry in reasons), default=Level.GREEN)


class Recent:
    """How much a count has grown in the last seconds."""

    def __init__(self) -> None:
        self._count = 0
        self._steps: deque[tuple[int, int]] = deque()
        self.last_ns: int | None = None

    def take(self, now_ns: int, count: int) -> int:
        """Take the count of now; return by how much it grew in the last `RECENT_NS`."""
        if count > self._count:
            self._steps.append((now_ns, count - self._count))
            self.last_ns = now_ns
        self._count = count
        while self._steps and now_ns - self._steps[0][0] >= RECENT_NS:
            self._steps.popleft()
        return sum(grown for _, grown in self._steps)


class Since:
    """For how long named conditions have held."""

    def __init__(self) -> None:
        self._since: dict[str, int] = {}

    def held_s(self, name: str, now_ns: int, holds: bool) -> float:
        """Return for how long `name` has held without a break, 0 when it does not."""
        if not holds:
            self._since.pop(name, None)
            return 0.0
        return (now_ns - self._since.setdefault(name, now_ns)) * 1e-9


@dataclass
class _Standing:
    reason: Reason
    held_ns: int
    level: Level
    level_ns: int


class Board:
    """Holds reasons for a minimum time, so that they do not flicker."""

    def __init__(self) -> None:
        self._standing: dict[tuple[str, str], _Standing] = {}

    def update(self, now_ns: int, found: Iterable[Reason]) -> tuple[Reason, ...]:
        """Take the reasons of now and return the reasons in force, the worst first."""
        for new in found:
            old = self._standing.get((new.code, new.where))
            level, level_ns = new.level, now_ns
            if old is not None and old.level > level and now_ns - old.level_ns < STAYS_NS:
                level, level_ns = old.level, old.level_ns
            self._standing[new.code, new.where] = _Standing(new, now_ns, level, level_ns)
        self._standing = {key: entry for key, entry in self._standing.items() if now_ns - entry.held_ns < STAYS_NS}
        standing = [replace(entry.reason, level=entry.level) for entry in self._standing.values()]
        return tuple(sorted(standing, key=lambda entry: (-entry.level, entry.code, entry.where)))
