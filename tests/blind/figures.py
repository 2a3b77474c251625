"""Figures of the study, each with its number of cases and its 95 % bound."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

Line = dict[str, Any]
"""Truth and answer of one case, joined."""

LEVELS = (0.5, 1.0, 2.0, 5.0)
NAMES = ("named", "one_of")


def clopper_pearson(hits: int, n: int) -> tuple[float, float]:
    """Return the two-sided 95 % bounds of a share."""
    if not n:
        return 0.0, 1.0
    bounds = binomtest(hits, n).proportion_ci(0.95, method="exact")
    return float(bounds.low), float(bounds.high)


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Attributes
    ----------
    what, to_reach : str
    hits, n : int
        Of a share; `value` instead where it is none.
    value : float or None
    beside : str
        What is printed beside it (the oracle's).
    """

    what: str
    to_reach: str
    hits: int = 0
    n: int = 0
    value: float | None = None
    beside: str = ""

    @property
    def reached(self) -> float | None:
        """The figure itself."""
        if self.value is not None:
            return self.value
        return self.hits / self.n if self.n else None

    @property
    def may_reach(self) -> bool:
        """Whether the bounds do not contradict what is to be reached."""
        low, high = self.bounds
        wanted = [float(x) for x in re.findall(r"\d*\.\d+", self.to_reach.partition(",")[0])]
        if self.to_reach.startswith("0 of"):
            return self.hits <= 2
        if "oracle" in self.to_reach:
            return high >= wanted[0] * float(self.beside.split()[-1])
        if " to " in self.to_reach:
            return high >= wanted[0] and low <= wanted[1]
        if not wanted:
            return True
        return high >= wanted[0] if self.to_reach.startswith(">=") else low <= wanted[0]

    @property
    def bounds(self) -> tuple[float, float]:
        """Clopper-Pearson, 95 %."""
        return clopper_pearson(self.hits, self.n)


def share(what: str, to_reach: str, lines: Iterable[Line], hit: Callable[[Line], bool], beside: str = "") -> Figure:
    """Count the lines that hit."""
    hits = [bool(hit(line)) for line in lines]
    return Figure(what, to_reach, sum(hits), len(hits), beside=beside)


def families(line: Line) -> list[str]:
    """Return the families that are hidden."""
    return [member["family"] for member in line["members"]]


def said(line: Line, least: float = 0.0) -> list[str]:
    """Return the families that the engine names with more than this probability."""
    return [c["name"] for c in line["causes"] if line["verdict"] == "named" and c["probability"] > least]


def candidates(line: Line, *, none: bool) -> list[str]:
    """Return the engine's candidates, likeliest first."""
    ordered = sorted(line["candidates"], key=lambda c: -c["probability"])
    return [c["name"] for c in ordered if none or c["name"] != "none"]


def tellable(member: Line) -> str:
    """Return what the data can tell (diagnosis.md 12)."""
    if member["d"] < 2:
        return "nothing"
    if member["d"] < 5:
        return "maybe"
    return "named" if member["d_sep"] > 5 else "one of"


def right_verdict(line: Line) -> bool:
    """Return whether the verdict is right for what the data can tell."""
    if not line["members"]:
        return line["verdict"] == "nothing_detectable"
    [member] = line["members"]
    truth = member["family"]
    contained = line["verdict"] == "one_of" and truth in [c["name"] for c in line["causes"]]
    named = line["verdict"] == "named" and said(line) == [truth]
    nothing = line["verdict"] == "nothing_detectable"
    return {"nothing": nothing, "maybe": nothing or contained, "one of": contained or named, "named": named}[
        tellable(member)
    ]


def loose_verdict(line: Line) -> bool:
    """Return the same, where a right name is never wrong."""
    return right_verdict(line) or (bool(line["members"]) and said(line) == families(line))


@dataclass(frozen=True)
class Interval:
    """One stated interval of a hidden parameter."""

    family: str
    inside: bool
    z: float


def intervals(lines: Iterable[Line], source: str = "") -> list[Interval]:
    """Return the stated intervals of hidden parameters; `source` "given_truth": of the fit given the true cause."""
    found = []
    for line in lines:
        answer = line.get(source) if source else line
        for member in line["members"]:
            for cause in answer["causes"] if answer else ():
                if cause["name"] == member["family"] and cause["form"] in ("", member["key"]):
                    found += _interval(member, cause)
    return found


def _interval(member: Line, cause: Line) -> list[Interval]:
    names = ("c1", "c2") if member["key"] == "stress_peak_shift" else (member["parameter"],)
    out = []
    for parameter in cause["parameters"]:
        low, high = parameter["interval95"]
        if parameter["name"] in names and low is not None and np.isfinite(low) and np.isfinite(high):
            sigma = max((high - low) / 3.92, 1e-12)
            z = (parameter["value"] - member["size"]) / sigma
            out.append(Interval(member["family"], low <= member["size"] <= high, z))
    return out


def pull_r0(line: Line, source: str = "") -> float | None:
    """Return the held-out R0 of drawbar pull after the extension."""
    answer = line.get(source) if source else line
    gain = answer.get("gain") if answer else None
    return gain["held_out"]["extended"].get("R0_N") if gain else None


def of(lines: Sequence[Line], kind: str) -> list[Line]:
    """Return the lines of a kind."""
    return [line for line in lines if line["kind"] == kind]


def level(line: Line) -> float:
    """Return the L that a single was made for."""
    return float(line["hidden"][0][1])
