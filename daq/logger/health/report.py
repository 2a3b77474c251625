"""The health report: status of every bus, message and signal, and the reasons for its level, the worst first."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum

from daq.clock import ClockFit
from daq.sources.can_source import BusStatus

NEXT_STEPS = {
    "bus_down": "ip link set {bus} up; check the adapter and its cable: recording continues by itself when it is back",
    "bus_off": "check bit rate, wiring and termination; ip link set {bus} type can restart-ms 100",
    "bus_returned": "check the plug and the adapter of {bus}, and repeat the run if it fell into it",
    "bus_silent": "check power and plugs of the senders on {bus}, and its bit rate: ip -details link show {bus}",
    "bus_error_passive": "check wiring, termination (60 ohm between the lines) and the bit rate of {bus}",
    "bus_error_warning": "check wiring, termination (60 ohm between the lines) and the bit rate of {bus}",
    "bus_no_ack": "check the plug of {bus}, and that another node is on and not listen-only",
    "bus_errors": "check wiring, screen and termination of {bus}; take nodes off one by one",
    "controller_overflow": "use an adapter with deeper buffers; end other programs",
    "kernel_drops": "sudo sysctl net.core.rmem_max=8388608, or raise receive_buffer_kb in [logger]; end other programs",
    "queue_drops": "record to a faster disk, or raise queue_mb in [logger]",
    "unknown_frames": "wheelsoil doctor vehicle.toml; give {bus} their DBC, or list it in [health] may_carry_unknown",
    "dbc_does_not_fit": "wheelsoil doctor vehicle.toml; check which DBC belongs to {bus}: "
    "the frames are recorded all the same",
    "source_stuck": "take the adapter out and put it in again, or restart the logger",
    "message_missing": "check the sender and its plug; if it may be silent, list it in [health] may_be_silent",
    "counter_jump": "look for drops of the bus; else check telemetry and gateway of the sender",
    "counter_repeated": "restart the sender",
    "frames_doubled": "look for two senders of this identifier, and for a loop between buses",
    "frames_missing": "look for drops of the bus; else check the sender",
    "rate_changed": "check the set-up of the sender",
    "role_unusable": "correct [signals] in vehicle.toml",
    "health_name_unknown": "correct [health] in vehicle.toml",
    "signal_stuck": "check the sensor and its cable; if it may stay the same, list it in [health] may_be_constant",
    "signal_constant": "check the sensor; if it may stay the same, list it in [health] may_be_constant",
    "signal_saturated": "check the measuring range of the sensor, its zero and its cable",
    "signal_out_of_range": "check the sensor; if the DBC is wrong, list the signal in [health] may_leave_range",
    "signal_not_available": "wait until the sender is ready; then check its sensor",
    "transducer_status": "wait until the transducer is ready; for a fault see its manual",
    "wheel_speed_zero": "check the wheel speed sensor, unless the wheel is braked to a stop",
    "ground_speed_zero": "check the receiver, unless the wheel is lifted or slips wholly",
    "gnss_no_fix": "check the antenna and the view of the sky; the run has no ground speed meanwhile",
    "gnss_clock_residual": "look at the load of the bus and at the receiver's output rate",
    "gnss_clock_drift": "check that gnss_time names the receiver's UTC; times between runs are fitted anyhow",
    "disk_low": "free the disk or record elsewhere: recording ends by itself at disk_reserve_mb",
    "disk_failed": "free or change the disk, and start the logger again; what was written before stays readable",
    "queue_filling": "end other programs that write; record to a faster disk",
    "inspection_skipped": "end other programs; lower decoded_rate_hz in [logger]",
    "inspection_failed": "restart the logger when there is time, and report the text",
    "folder_closed": "let the logger's user write to the folder: no other run or part can begin there",
    "file_gone": "look for the file, and repeat the run if it is gone; "
    "leave the folder alone while it is recorded into",
    "inspection_stuck": "restart the logger when there is time, and report it",
    "cpu_busy": "lower decoded_rate_hz in [logger]; give buses only the DBCs they need",
    "clock_stepped": "let the clock settle before the logger is started: chronyc waitsync",
}
"""Code of a reason -> what to do; ``{bus}`` is the bus of the reason.

The levels, the meaning with its thresholds and the usual cause of each code are in docs/health.md.
"""


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
        A key of `NEXT_STEPS`, e.g. ``"signal_stuck"``; stable, for programs and for docs/health.md.
    where : str
        The bus, the message or the signal, e.g. ``"can0: WFT_Forces.Fz"``.
    what : str
        One sentence with numbers.
    """

    code: str
    level: Level
    where: str
    what: str
    next_step: str


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


def reason(code: str, level: Level, where: str, what: str, *, bus: str = "", next_step: str = "") -> Reason:
    """Return a reason; without a next step the code's own, with the name of the bus put in."""
    return Reason(code, level, where, what, next_step or NEXT_STEPS[code].format(bus=bus or where))


def worst(reasons: Iterable[Reason]) -> Level:
    """Return the worst level, green where there is no reason."""
    return max((one.level for one in reasons), default=Level.GREEN)


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
        for one in found:
            old = self._standing.get((one.code, one.where))
            level, level_ns = one.level, now_ns
            if old is not None and old.level > level and now_ns - old.level_ns < STAYS_NS:
                level, level_ns = old.level, old.level_ns
            self._standing[one.code, one.where] = _Standing(one, now_ns, level, level_ns)
        self._standing = {key: one for key, one in self._standing.items() if now_ns - one.held_ns < STAYS_NS}
        standing = [replace(one.reason, level=one.level) for one in self._standing.values()]
        return tuple(sorted(standing, key=lambda one: (-one.level, one.code, one.where)))
