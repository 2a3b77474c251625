"""What changed from the last but one to the last campaign of the same vehicle or terrain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from math import hypot, isfinite
from typing import Any, Literal

import pyarrow as pa
from pyarrow import dataset

from wheelsoil.fleet.earlier_campaign import OF_A_CAUSE, causes_stated
from wheelsoil.fleet.holdings import Holdings
from wheelsoil.workflows.last_report import Change as SizeChange
from wheelsoil.workflows.last_report import changes_between

_PULL = "pull_at_slip_0_2_n"
_COLUMNS = ("wheel", "state", "vehicle", "transducer", "terrain", "start", "wheel_radius_m", "tread", _PULL)
_EDGES = ("pull_at_slip_0_2_lower95_n", "pull_at_slip_0_2_upper95_n")
_COMPARED = ("vehicle", "transducer", "terrain", "wheel_radius_m", "tread", "verdict", "causes")


@dataclass(frozen=True)
class PullChange:
    """Drawbar pull at slip 0.2 of both campaigns, N.

    `half95_n` is half the 95 % interval of the difference; None where one has no interval.
    """

    before_n: float
    now_n: float
    half95_n: float | None

    @property
    def is_beyond(self) -> bool:
        """Whether they differ by more than the interval."""
        return self.half95_n is not None and abs(self.now_n - self.before_n) > self.half95_n


@dataclass(frozen=True)
class Change:
    """The last campaign of a vehicle or a terrain, and the one before it; of several wheels one.

    Attributes
    ----------
    of, name : "vehicle" or "terrain", str
    start, start_before : datetime
    differs : mapping what -> (before, now)
        Vehicle, transducer, terrain, wheel, verdict and causes that are not the same.
    sizes : tuple of SizeChange
        Sizes of causes that both have and that differ beyond their intervals.
    pull : PullChange or None
        None where one of them has no pull at slip 0.2.
    """

    of: Literal["vehicle", "terrain"]
    name: str
    campaign: str
    before: str
    start: datetime
    start_before: datetime
    differs: dict[str, tuple[Any, Any]]
    pull: PullChange | None
    sizes: tuple[SizeChange, ...] = ()
    wheel: str = ""


def changes_of(holdings: Holdings) -> tuple[Change, ...]:
    """Return what changed since the last campaign of each vehicle and each terrain, the latest first.

    Campaigns without a date, and those that failed, do not count.
    """
    rows: list[dict[str, Any]] = holdings.table("campaigns", (*_COLUMNS, *_EDGES)).to_pylist()
    dated = [row for row in rows if row["start"] is not None and row["state"] == "done"]
    dated.sort(key=lambda row: (row["start"], row["campaign"]))
    kinds: tuple[Literal["vehicle", "terrain"], ...] = ("vehicle", "terrain")
    pairs = [(of, *pair) for of in kinds for pair in _last_two(dated, of)]
    shown = pa.array(sorted({row["campaign"] for _, *pair in pairs for row in pair}), pa.string())
    wanted = dataset.field("campaign").isin(shown)
    stated: dict[tuple[str, str], list[dict[str, Any]]] = {}
    of_verdicts = wanted & dataset.field("role").isin(["named", "one_of"])
    for row in holdings.where("causes", ("campaign", "wheel", *OF_A_CAUSE), of_verdicts).to_pylist():
        stated.setdefault(_key(row), []).append(row)
    diagnoses = holdings.where("diagnoses", ("campaign", "wheel", "verdict"), wanted).to_pylist()
    verdicts = {_key(row): row["verdict"] for row in diagnoses}
    found = []
    for of, before, now in pairs:
        for row in (before, now):
            row["verdict"] = verdicts.get(_key(row), "")
            row["causes"] = tuple(dict.fromkeys(str(cause["family"]) for cause in stated.get(_key(row), ())))
        differs = {what: (before[what], now[what]) for what in _COMPARED if before[what] != now[what]}
        names = now["campaign"], before["campaign"], now["start"], before["start"]
        both = (causes_stated(stated.get(_key(row), ())) for row in (before, now))
        sizes = tuple(size for size in changes_between(*both) if size.beyond and isfinite(size.difference))
        found.append(Change(of, now[of], *names, differs, _pull(before, now), sizes, now["wheel"] or ""))
    return tuple(sorted(found, key=lambda change: change.start, reverse=True))


def _last_two(dated: Iterable[dict[str, Any]], of: str) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return the last campaign of each vehicle or terrain and the latest of an earlier time, each wheel by itself."""
    last: dict[tuple[str, str], dict[str, Any]] = {}
    before: dict[tuple[str, str], dict[str, Any]] = {}
    for row in dated:
        if not row[of]:
            continue
        name = row[of], row["wheel"] or ""
        if name in last and last[name]["start"] < row["start"]:
            before[name] = last[name]
        last[name] = row
    return [(before[name], last[name]) for name in last if name in before]


def _key(row: Mapping[str, Any]) -> tuple[str, str]:
    return row["campaign"], row["wheel"] or ""


def _pull(before: Mapping[str, Any], now: Mapping[str, Any]) -> PullChange | None:
    if before[_PULL] is None or now[_PULL] is None:
        return None
    edges = [[row[edge] for edge in _EDGES] for row in (before, now)]
    known = all(edge is not None for pair in edges for edge in pair)
    half = hypot(*((high - low) / 2 for low, high in edges)) if known else None
    return PullChange(before[_PULL], now[_PULL], half)
