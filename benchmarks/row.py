"""One line of the benchmark table."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A measured figure beside what it is held against; `reached` is None where nothing is demanded."""

    what: str
    ours: str
    peer: str
    ratio: str
    to_reach: str
    reached: bool | None

    def line(self) -> str:
        """Return the row as a line of a Markdown table."""
        mark = {True: "yes", False: "**no**", None: "-"}[self.reached]
        return f"| {self.what} | {self.ours} | {self.peer} | {self.ratio} | {self.to_reach} | {mark} |"


def median_seconds(function: Callable[[], object], repeats: int = 5) -> float:
    """Return the median wall time of `repeats` calls after one warm-up call."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)
