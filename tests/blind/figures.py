"""Figures of the study, each with its number of cases and its 95 % bound."""

from __future__ import annotations

import itertools
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
class Aim:
    """What a figure is to reach.

    Attributes
    ----------
    least, most : float
    gate : bool
        The unfavourable Clopper-Pearson bound has to reach it; else the figure itself.
    of_oracle : bool
        `least` is a share of what the oracle reaches.
    """

    least: float = 0.0
    most: float = np.inf
    gate: bool = False
    of_oracle: bool = False

    def __str__(self) -> str:
        if self.of_oracle:
            return f">= {self.least:g} of the oracle's"
        if self.least and np.isfinite(self.most):
            return f"{self.least:g} to {self.most:g}"
        side, limit = ("lower", f">= {self.least:g}") if self.least else ("upper", f"<= {self.most:g}")
        return f"{side} bound {limit}" if self.gate else limit


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Attributes
    ----------
    what : str
    aim : Aim, optional
    hits, n : int
        Of a share; `value` instead where it is none.
    value : float or None
    beside : str
        What is printed beside it.
    oracle : float or None
    """

    what: str
    aim: Aim | None = None
    hits: int = 0
    n: int = 0
    value: float | None = None
    beside: str = ""
    oracle: float | None = None

    @property
    def reached(self) -> float | None:
        """The figure itself."""
        if self.value is not None:
            return self.value
        return self.hits / self.n if self.n else None

    @property
    def passes(self) -> bool | None:
        """Whether what is to be reached is reached; a gate by its unfavourable bound, so that few cases do not pass.

        None where nothing is to be reached, or there is no case of a figure that is no gate.
        """
        if self.aim is None:
            return None
        if self.aim.gate:
            low, high = self.bounds
            return (
                low >= self.aim.least and high <= self.aim.most if np.isfinite(self.aim.most) else low >= self.aim.least
            )
        return None if self.reached is None else self._least <= self.reached <= self.aim.most

    @property
    def refuted(self) -> bool:
        """Whether even the favourable bound does not reach it: for a few cases, of which nothing else can be said."""
        if self.aim is None or self.value is not None or not self.n:
            return False
        low, high = self.bounds
        return high < self._least or low > self.aim.most

    @property
    def _least(self) -> float:
        assert self.aim is not None
        if not self.aim.of_oracle:
            return self.aim.least
        return 0.0 if self.oracle is None else self.aim.least * self.oracle

    @property
    def bounds(self) -> tuple[float, float]:
        """Clopper-Pearson, 95 %."""
        return clopper_pearson(self.hits, self.n)


def share(what: str, aim: Aim | None, lines: Iterable[Line], hit: Callable[[Line], bool], beside: str = "") -> Figure:
    """Count the lines that hit."""
    hits = [bool(hit(line)) for line in lines]
    return Figure(what, aim, sum(hits), len(hits), beside=beside)


NULLS_NAMED = Aim(most=0.0185, gate=True)
"""At most 1 of 300."""
FALSE_UNEXPLAINED = Aim(most=0.0194, gate=True)
"""At most 5 of 600."""
NAMES_RIGHT = Aim(least=0.95, gate=True)
"""At least 148 of 150."""
ALL_NAMES_RIGHT = Aim(least=0.90, gate=True)
"""Over all campaigns, listed causes or not; .96 is aimed at."""
LISTED_OR_NOT = ("null", "single", "pair", "outside", "left_out")
"""Kinds of campaigns in the mix of which the share of unlisted causes is fixed."""


def named_causes(lines: Sequence[Line]) -> tuple[int, int]:
    """Return how many of the named causes are hidden ones, and how many are named."""
    stated = [name in families(line) for line in lines for name in said(line) if line["kind"] != "left_out"]
    stated += [False for line in of(lines, "left_out") for _ in said(line)]
    return sum(stated), len(stated)


def right_foreign_verdict(line: Line) -> bool:
    """Return whether the verdict on a foreign wheel is right: `unexplained`, or a set that holds what is akin to it."""
    from blind.foreign import FOREIGN

    wheel = FOREIGN[line["members"][0]["key"]]
    names = [cause["name"] for cause in line["causes"]]
    if line["verdict"] == "named":
        names = said(line)
        return wheel.may_be_named and len(names) == 1 and names[0] in wheel.families
    akin = line["verdict"] == "one_of" and bool(set(names) & set(wheel.families))
    return line["verdict"] == "unexplained" or akin


@dataclass(frozen=True)
class Bin:
    """Stated probabilities of one bin, and how often they were right."""

    low: float
    high: float
    n: int
    stated: float
    hits: int

    @property
    def bounds(self) -> tuple[float, float]:
        """Clopper-Pearson, 95 %, of the share that is right."""
        return clopper_pearson(self.hits, self.n)


EDGES = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)


def reliability(lines: Iterable[Line], edges: Sequence[float] = EDGES) -> list[Bin]:
    """Return the reliability of every stated probability: of each family, and of no cause at all.

    `unexplained` takes back the probabilities of its candidates, and states none.
    """
    stated = [
        (c["probability"], c["name"] in families(line) if c["name"] != "none" else not line["members"])
        for line in lines
        for c in (line["candidates"] if line["verdict"] != "unexplained" else ())
    ]
    out = []
    for low, high in itertools.pairwise(edges):
        own = [(p, hit) for p, hit in stated if low <= p < high or (high == edges[-1] and p == high)]
        mean = float(np.mean([p for p, _ in own])) if own else float("nan")
        out.append(Bin(low, high, len(own), mean, sum(hit for _, hit in own)))
    return out


def families(line: Line) -> list[str]:
    """Return the families that are hidden."""
    return [member.get("family", "") for member in line["members"]]


def said(line: Line) -> list[str]:
    """Return the families that the engine names."""
    return [c["name"] for c in line["causes"] if line["verdict"] == "named" and not c.get("barred")]


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


RIGHT = {
    "nothing": ("nothing",),
    "maybe": ("nothing", "one_of right"),
    "one of": ("one_of right", "named right"),
    "named": ("named right",),
}
"""Verdicts of the oracle that are right for what the data can tell."""


def oracle_verdict(line: Line) -> float:
    """Return how often the oracle's verdict is right for what the data can tell."""
    tells = tellable(line["members"][0]) if line["members"] else "nothing"
    return float(sum(line["oracle"]["verdicts"][verdict] for verdict in RIGHT[tells]))


def most_probable_set(line: Line) -> list[str]:
    """Return the families of the most probable set, in order; none where no set is kept."""
    return sorted(line["sets"][0]["causes"]) if line["sets"] else []


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
