"""The table of results: a row is a figure beside a peer or a mark, and says whether the mark is reached."""

from __future__ import annotations

import os
import platform
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version

from benchmarks.peer_environment import PEERS

HEAD = """\
# Benchmarks

How to read this:

- Times are **CPU time** (all threads and child processes) unless the row says *wall*; medians of several calls, of
  one for the report. What is compared takes turns in one run. Memory is that of all processes of a command.
- A row of `diagnose` gives its verdict; a wrong one misses the mark.
- **Ratio** = our speed over the peer's: above 1x wheelsoil is faster. For sizes: our size over the peer's, below 1x is
  smaller.
- **no**: the mark is missed, and nothing else follows from it: these are measurements. `stated`: no mark is set.
- `make bench` writes every row to `out/bench/results.md`, those with a mark to `out/bench/marks.md`; `make bench-keep`
  also renews `benchmarks/results.md` by the latter.
"""
COLUMNS = "| what | ours | peer | ratio | mark | reached |\n|---|---|---|---|---|---|\n"


@dataclass(frozen=True)
class Mark:
    """What a figure has to reach: at least, or at most, a value in a unit."""

    value: float
    unit: str
    least: bool

    def reached(self, figure: float) -> bool:
        """Return whether the figure reaches the mark; one that is not a number does not."""
        return figure >= self.value if self.least else figure <= self.value

    def __str__(self) -> str:
        return f"{'>=' if self.least else '<='} {self.value:g}{'' if self.unit == 'x' else ' '}{self.unit}"


def at_least(value: float, unit: str) -> Mark:
    """Return the mark of a figure that should be large."""
    return Mark(value, unit, least=True)


def at_most(value: float, unit: str) -> Mark:
    """Return the mark of a figure that should be small."""
    return Mark(value, unit, least=False)


@dataclass(frozen=True)
class Row:
    """A measured figure; `reached` is None where no mark is set."""

    what: str
    ours: str
    peer: str = "-"
    ratio: str = "-"
    mark: str = "stated"
    reached: bool | None = None

    def line(self) -> str:
        """Return the row as a line of a Markdown table."""
        reached = {True: "yes", False: "**no**", None: "-"}[self.reached]
        return f"| {self.what} | {self.ours} | {self.peer} | {self.ratio} | {self.mark} | {reached} |"


def judged(what: str, ours: str, figure: float, mark: Mark, peer: str = "-", ratio: str = "-") -> Row:
    """Return the row of a figure that is held against a mark; `ours` is the figure as text."""
    return Row(what, ours, peer, ratio, str(mark), mark.reached(figure))


def with_verdict(row: Row, verdict: str, *, right: bool) -> Row:
    """Return the row of a diagnosis with its verdict; a wrong one misses every mark, and is one where none is set."""
    ours = f"{row.ours}, {verdict}"
    if right:
        return replace(row, ours=ours)
    mark = "a right verdict" if row.reached is None else f"{row.mark}, a right verdict"
    return replace(row, ours=f"{ours} (wrong)", mark=mark, reached=False)


def compared(
    what: str,
    ours_s: Sequence[float],
    peer: str,
    peer_s: Sequence[float],
    as_text: Callable[[float], str],
    mark: Mark | None = None,
    remark: str = "",
) -> Row:
    """Return the row of a peer beside us: the medians, as `as_text` writes them, and how many times faster we are.

    The remark stands behind our figure.
    """
    mine_s, other_s = statistics.median(ours_s), statistics.median(peer_s)
    ratio = other_s / mine_s
    ours, theirs = f"{as_text(mine_s)}{remark}", f"{peer}: {as_text(other_s)}"
    if mark is None:
        return Row(what, ours, theirs, times(ratio))
    return judged(what, ours, ratio, mark, theirs, times(ratio))


def compared_with_start(
    what: str,
    ours_s: Sequence[float],
    start_s: Sequence[float],
    peer: str,
    peer_s: Sequence[float],
    most: float,
    as_text: Callable[[float], str],
) -> Row:
    """Return the row of a process of ours beside what it may take: its start, and `most` times what the peer takes."""
    allowed_s = [start + most * seconds for start, seconds in zip(start_s, peer_s, strict=True)]
    beside = f"start of a process and {most} x {peer}"
    return compared(what, ours_s, beside, allowed_s, as_text, at_least(1, "x"))


def times(ratio: float) -> str:
    """Return a ratio with three digits."""
    return f"{ratio:.2f}x" if ratio < 10 else f"{ratio:.1f}x" if ratio < 100 else f"{ratio:.0f}x"


def rate_of(count: int, what: str = "frames") -> Callable[[float], str]:
    """Return what writes the seconds that `count` things take as millions of them a second."""
    return lambda seconds: f"{count / seconds / 1e6:.3g} M{what}/s"


def page(rows: Sequence[Row], load: float) -> str:
    """Return a page of rows; `load` is that of the machine before the measurement."""
    machine = f"{os.cpu_count()} cores, Python {platform.python_version()}, {platform.machine()}"
    missed = sum(row.reached is False for row in rows)
    marks = sum(row.reached is not None for row in rows)
    peers = [f"{name} {version(name)}" for name in ("python-can", "cantools", "mcap")]
    peers += [peer.replace("==", " ") for peer in PEERS]
    summary = (
        f"{marks - missed} of {marks} marks reached. {machine}; load before the measurement {load:.1f}.\n"
        f"Peers: {', '.join(peers)}."
    )
    return f"{HEAD}\n{summary}\n\n{COLUMNS}" + "\n".join(row.line() for row in rows) + "\n"
