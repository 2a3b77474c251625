"""The reasons that stand: the worst first, and none so short that it cannot be read."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

from daq.health.codes import CODES
from daq.health.report import Level, Reason

STAYS_NS = 3_000_000_000
"""A reason stays this long after it was last seen, and as bad as it was."""
RECENT_NS = 10_000_000_000
"""What has happened in this time is happening now."""


def reason(code: str, level: Level, where: str, what: str, *, bus: str = "", next_step: str = "") -> Reason:
    """Return a reason; without a next step the code's own, with the name of the bus put in."""
    return Reason(code, level, where, what, next_step or CODES[code].next_step.format(bus=bus or where))


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
    """For how long things have been so."""

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
    seen_ns: int
    level: Level
    level_ns: int


class Board:
    """Keeps reasons from flickering."""

    def __init__(self) -> None:
        self._standing: dict[tuple[str, str], _Standing] = {}

    def update(self, now_ns: int, found: Iterable[Reason]) -> tuple[Reason, ...]:
        """Take what is found now and return what stands, the worst first."""
        for one in found:
            old = self._standing.get((one.code, one.where))
            level, level_ns = one.level, now_ns
            if old is not None and old.level > level and now_ns - old.level_ns < STAYS_NS:
                level, level_ns = old.level, old.level_ns
            self._standing[one.code, one.where] = _Standing(one, now_ns, level, level_ns)
        self._standing = {key: one for key, one in self._standing.items() if now_ns - one.seen_ns < STAYS_NS}
        standing = [replace(one.reason, level=one.level) for one in self._standing.values()]
        return tuple(sorted(standing, key=lambda one: (-one.level, one.code, one.where)))
