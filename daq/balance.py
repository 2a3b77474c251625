"""The balance that every reader of a file closes: what came in is what came out and what was lost, by name."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from daq.limits import MOST_KINDS

UNACCOUNTED = "not accounted for: report this with the file"
_OTHERS = "of other kinds"


@dataclass
class Loss:
    """What a reader could not use, of one kind.

    Attributes
    ----------
    first : str
        Where the first of them is, and what is in it; empty where that tells nothing.
    """

    count: int = 0
    first: str = ""

    def __str__(self) -> str:
        return f"{self.count:,}" + (f"; the first is {self.first}" if self.first else "")


@dataclass
class Balance:
    """Counts what a reader takes from a file and what became of it.

    Attributes
    ----------
    unit : str
        What is counted: lines, rows, messages, objects, frames, bytes.
    came : int or None
        Counted where it comes in, not summed up from the rest. None as long as the reader counts nothing.
    out : int
        Of them in the samples or frames that were returned.
    aside : mapping str -> int
        What holds no data: headers, comments, empty lines.
    losses : mapping str -> Loss
        By kind. Of both, kinds beyond `MOST_KINDS` are counted together.
    """

    unit: str = ""
    came: int | None = None
    out: int = 0
    aside: dict[str, int] = field(default_factory=dict)
    losses: dict[str, Loss] = field(default_factory=dict)

    def come(self, unit: str, count: int) -> None:
        """Count what comes in."""
        self.unit = unit
        self.came = (self.came or 0) + count

    def put_aside(self, kind: str, count: int) -> None:
        """Count what holds no data."""
        if count:
            kind = _capped(kind, self.aside)
            self.aside[kind] = self.aside.get(kind, 0) + count

    def lose(self, kind: str, count: int = 1, first: str = "") -> None:
        """Count what is lost, and keep the first example."""
        if count:
            loss = self.losses.setdefault(_capped(kind, self.losses), Loss())
            loss.first = loss.first or ("" if loss.count else first)
            loss.count += count

    def lost(self, kind: str) -> int:
        """Return how many of a kind are lost."""
        return self.losses[kind].count if kind in self.losses else 0

    @property
    def open(self) -> int:
        """What came in and is neither out nor aside nor lost."""
        gone = self.out + sum(self.aside.values()) + sum(loss.count for loss in self.losses.values())
        return (self.came or 0) - gone

    def close(self) -> None:
        """Name what is left open; no reader ends without this.

        Raises
        ------
        AssertionError
            The reader counted nothing that came in.
        """
        assert self.came is not None, "this reader counts nothing that comes in"
        if self.open:
            self.lose(UNACCOUNTED, self.open)

    def sentence(self, out: str) -> str:
        """Return the balance as one line; `out` is what came out: "1,204 lines = 1,200 frames + 3 headers + ..."."""
        parts = [f"{self.out:,} {out}", *(f"{count:,} {kind}" for kind, count in self.aside.items())]
        parts += [f"{loss.count:,} {kind}" for kind, loss in self.losses.items()]
        return f"{self.came or 0:,} {self.unit} = " + " + ".join(parts)


def _capped(kind: str, known: Collection[str]) -> str:
    return kind if kind in known or len(known) < MOST_KINDS else _OTHERS
