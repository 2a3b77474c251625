"""What has changed since an earlier report: soil, causes, pull, errors and data quality."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import hypot, isfinite, nan
from pathlib import Path
from typing import Any

from daq import ConfigError

SCHEMA = "wheelsoil/report/2"
_SIGMAS = 1.959964
_USUAL_NAMES = ("report.json",)


@dataclass(frozen=True)
class Stated:
    """A quantity of a report: its name and kind, value, half of its 95 % interval (NaN where it has none) and unit."""

    kind: str
    name: str
    value: float
    half95: float
    unit: str


@dataclass(frozen=True)
class Change:
    """A quantity in the last report and in this one; NaN where one of them does not have it.

    Attributes
    ----------
    beyond : bool
        Whether the two differ by more than the root sum square of their half intervals, or only one has it.
    """

    kind: str
    name: str
    unit: str
    last: float
    last_half95: float
    now: float
    now_half95: float

    @property
    def difference(self) -> float:
        """Now less last time."""
        return self.now - self.last

    @property
    def beyond(self) -> bool:
        """Whether they differ beyond their intervals; False where neither has one."""
        if isfinite(self.last) != isfinite(self.now):
            return self.kind == "cause"
        halves = [half for half in (self.last_half95, self.now_half95) if isfinite(half)]
        return bool(halves) and abs(self.difference) > hypot(*halves)


@dataclass(frozen=True)
class LastReport:
    """The numbers of an earlier report.

    Attributes
    ----------
    name : str
        Of its file.
    made_at, title : str
    """

    name: str
    made_at: str
    title: str
    stated: tuple[Stated, ...]


def load_last(path: Path) -> LastReport:
    """Read the numbers of an earlier report.

    Parameters
    ----------
    path : Path
        report.json, the page that it belongs to, or the folder that holds it.

    Raises
    ------
    ConfigError
        There is none, or it is of another program or an older schema.
    """
    file = _file_of(path)
    try:
        raw = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError.of("the last report cannot be read", file, found=str(error)[:200]) from None
    if not isinstance(raw, dict) or raw.get("schema") != SCHEMA or "sections" not in raw:
        found = str(raw.get("schema", "no schema")) if isinstance(raw, dict) else type(raw).__name__
        raise ConfigError.of(
            "this is no report of wheelsoil",
            file,
            found=found,
            expected=SCHEMA,
            next_step="give the JSON file that `wheelsoil report` wrote beside its page",
        )
    stated = tuple(stated_in(raw["sections"]))
    return LastReport(file.name, str(raw.get("made_at", "")), str(raw.get("title", "")), stated)


def _file_of(path: Path) -> Path:
    if (path / "store.json").is_file():
        raise ConfigError.of(
            "this is the store of a fleet, which keeps no reports",
            path,
            expected="report.json, its page or their folder",
            next_step="name the last report; `wheelsoil fleet report` shows what changed from campaign to campaign",
        )
    if path.is_dir():
        found = [path / name for name in _USUAL_NAMES if (path / name).is_file()]
        found = found or [file for file in sorted(path.glob("*.json")) if file.with_suffix(".html").is_file()]
        if len(found) != 1:
            raise ConfigError.of(
                "this folder holds no report, or several",
                path,
                found=", ".join(file.name for file in found) or "none",
                next_step="name the JSON file of the report",
            )
        return found[0]
    return path.with_suffix(".json") if path.suffix in (".html", ".pdf") else path


def stated_in(sections: Mapping[str, Any]) -> Iterator[Stated]:
    """Return what is compared of the sections of report.json."""
    fit, causes, runs = (sections.get(key) or {} for key in ("fit", "causes", "runs"))
    soils = fit.get("soils") or ()
    for soil in soils:
        where = soil["campaign"] if len(soils) > 1 else "soil"  # a single one is compared whatever its folder is called
        for name, value in soil["values"].items():
            sigma = _float(soil["sigmas"].get(name))
            yield Stated("soil", f"{where}.{name}", _float(value), _SIGMAS * sigma, "")
    for cause in causes.get("causes") or ():
        for parameter in cause["parameters"]:
            low, high = map(_float, parameter["interval95"])
            unit = "" if parameter["unit"] == "1" else parameter["unit"]
            yield Stated(
                "cause", f"{cause['name']}.{parameter['name']}", _float(parameter["value"]), (high - low) / 2, unit
            )
    pull = (fit.get("traction") or {}).get("pull")
    if pull:
        low, high = map(_float, pull["interval95"])
        yield Stated("pull", "pull_at_slip_0.2", _float(pull["pull_n"]), (high - low) / 2, "N")
    figures = (sections.get("glance") or {}).get("key_figures") or {}
    for key, figure in figures.items():
        if key.startswith("error.") and key.endswith(".calibrated_soil"):
            yield Stated("error", key, _float(figure["value"]), nan, figure["unit"])
    shares = [share for run in runs.values() if (share := _float(run.get("usable_share"))) == share]
    if shares:
        yield Stated("data", "usable_share", sum(shares) / len(shares), nan, "")


def changes_since(last: LastReport, sections: Mapping[str, Any]) -> list[Change]:
    """Return what differs between an earlier report and the sections of this one, beyond their intervals first."""
    before = {figure.name: figure for figure in last.stated}
    now = {figure.name: figure for figure in stated_in(sections)}
    found = []
    for name in dict.fromkeys([*now, *before]):
        old, new = before.get(name), now.get(name)
        stated = new or old
        assert stated is not None
        values = [(each.value, each.half95) if each else (nan, nan) for each in (old, new)]
        found.append(Change(stated.kind, name, stated.unit, *values[0], *values[1]))
    return sorted(found, key=lambda change: not change.beyond)


def _float(value: Any) -> float:
    return nan if value is None else float(value)
