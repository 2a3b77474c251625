"""What has changed since an earlier report or campaign: soil, causes, pull, errors and data quality."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import hypot, isfinite, nan
from pathlib import Path
from typing import Any, Literal

from daq import OUTPUTS, ConfigError, VehicleConfig
from wheelsoil.wording.names import SOIL_UNITS
from wheelsoil.workflows.key_figures import CALIBRATED_SOIL, Z95

SCHEMA = "wheelsoil/report/2"
LEAST_COMPARED = 0.05
"""Posterior probability below which a cause is separable from the others, and not compared."""
_USUAL_NAME, _STORE_HEAD = "report.json", "store.json"
_KINDS = ("cause", "pull", "soil", "error", "data")
_OF_A_VEHICLE = ("vehicle", "mass", "wheel", "wheel radius r", "wheel width b", "transducer")


@dataclass(frozen=True)
class Stated:
    """A quantity of a report: its name and kind, value, half of its 95 % interval (NaN where it has none) and unit.

    Attributes
    ----------
    name : tuple of str
        Family and parameter of a cause, ground and parameter of a soil, else its key; what JSON joins by dots.
    compared : bool
        False of a cause that a rule bars or that is improbable: it is compared only with one that is neither.
    barred : bool
        Of a probable cause that a rule bars: it is compared with one that is barred, too.
    """

    kind: str
    name: tuple[str, ...]
    value: float
    half95: float
    unit: str
    compared: bool = True
    barred: bool = False


@dataclass(frozen=True)
class Change:
    """A quantity in the last report and in this one; NaN where one of them does not have it.

    Attributes
    ----------
    beyond : bool
        Whether the two differ by more than the root sum square of their half intervals, or only one has it.
    undiagnosed : "", "last time" or "this time"
        Of a cause: when there was no diagnosis, so that nothing can be said of it.
    """

    kind: str
    name: tuple[str, ...]
    unit: str
    last: float
    last_half95: float
    now: float
    now_half95: float
    undiagnosed: str = ""

    @property
    def difference(self) -> float:
        """Now less last time."""
        return self.now - self.last

    @property
    def beyond(self) -> bool:
        """Whether they differ beyond their intervals; False where neither has one."""
        if isfinite(self.last) != isfinite(self.now):
            return self.kind == "cause" and not self.undiagnosed
        halves = [half for half in (self.last_half95, self.now_half95) if isfinite(half)]
        return bool(halves) and abs(self.difference) > hypot(*halves)


@dataclass(frozen=True)
class LastReport:
    """The numbers of an earlier report, or of a campaign in a store.

    Attributes
    ----------
    name : str
        Of its file, or of the campaign.
    made_at : str
        When the report was made, or the campaign's first run began.
    title : str
    kind : "report" or "campaign"
    subject : mapping str -> str
        Vehicle, wheel, transducer and soil that it is of, as far as it says so; see `subject_of`.
    driven : str
        When the runs were driven, as the report writes it; "" where it does not.
    diagnosed : bool
        Whether it has a diagnosis.
    """

    name: str
    made_at: str
    title: str
    stated: tuple[Stated, ...]
    kind: Literal["report", "campaign"] = "report"
    subject: Mapping[str, str] = field(default_factory=dict)
    driven: str = ""
    diagnosed: bool = True


def subject_of(vehicle: VehicleConfig) -> dict[str, str]:
    """Return what tells a vehicle from another: a name, and sizes and a serial number for those of one name."""
    own, wheel = vehicle.vehicle, vehicle.wheel
    sizes = (wheel.id, f"{wheel.radius_m:g} m", f"{wheel.width_m:g} m") if wheel else ("", "", "")
    texts = (own.name, f"{own.mass_kg:g} kg" if own.mass_kg else "", *sizes, vehicle.transducer.serial)
    return {name: text for name, text in zip(_OF_A_VEHICLE, texts, strict=True) if text}


def store_meant(place: str) -> str | None:
    """Return the address of the store that is meant by the place of the last report; None where it is a report.

    An address with ``://`` and the file store.json mean a store; a folder does where it holds no report.
    """
    if "://" in place:
        return place
    path = Path(place)
    if path.name == _STORE_HEAD and not path.with_suffix(".html").is_file():
        return str(path.parent)
    return place if (path / _STORE_HEAD).is_file() and not _reports_in(path) else None


def load_last(path: Path, wheel: str = "") -> LastReport:
    """Read the numbers of an earlier report.

    The path is that of report.json, the page that it belongs to, or the folder that holds it. `wheel` is which one of a
    vehicle's report: report-FL.json is beside that. `ConfigError` where there is none, or it is of another program or
    an older schema.
    """
    file = _file_of(path)
    of_wheel = file.with_stem(f"{file.stem}-{wheel}")
    file = of_wheel if wheel and of_wheel.is_file() else file
    try:
        raw = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        step = "give the JSON file that `wheelsoil report` wrote beside its page"
        raise ConfigError.of("the last report cannot be read", file, str(error)[:200], "report.json", step) from None
    if isinstance(raw, dict) and raw.get("wheels"):
        step = "give that of one wheel beside it (REPORT-ID.json), or report all wheels against this one"
        raise ConfigError.of("the last report is of all wheels of a vehicle", file, next_step=step)
    if not isinstance(raw, dict) or raw.get("schema") != SCHEMA or "sections" not in raw:
        found = str(raw.get("schema", "no schema")) if isinstance(raw, dict) else type(raw).__name__
        raise ConfigError.of(
            "this is no report of wheelsoil",
            file,
            found=found,
            expected=SCHEMA,
            next_step="give the JSON file that `wheelsoil report` wrote beside its page",
        )
    try:
        stated = tuple(stated_in(raw["sections"]))
        facts = dict((raw["sections"].get("provenance") or {}).get("facts") or ())
        head = (raw.get("head") or {}).get("facts") or ()
        starts = [run.get("start_utc") for run in (raw["sections"].get("runs") or {}).values()]
        dated = any(start not in (None, "–") for start in starts)  # a dash in older reports
        driven = next((str(text) for label, text in head if dated and not label), "")
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        found = f"{type(error).__name__}: {error}"[:200]
        step = "make it anew with `wheelsoil report`"
        raise ConfigError.of("the last report is damaged", file, found, "sections as it wrote them", step) from None
    subject = {name: str(facts[name]) for name in (*_OF_A_VEHICLE, "soil") if facts.get(name)}
    return LastReport(
        file.name,
        str(raw.get("made_at", "")),
        str(raw.get("title", "")),
        stated,
        subject=subject,
        driven=driven,
        diagnosed="causes" in raw["sections"],
    )


def _file_of(path: Path) -> Path:
    if not path.is_dir():
        return path.with_suffix(".json") if path.suffix in (".html", ".pdf") else path
    found = _reports_in(path)
    # That of a vehicle: report.json beside report-FL.json.
    found = [file for file in found if all(f"{each.stem}-".startswith(f"{file.stem}-") for each in found)] or found
    if len(found) != 1:
        raise ConfigError.of(
            "this folder holds no report, or several",
            path,
            found=", ".join(file.name for file in found) or "none",
            next_step="name the JSON file of the report",
        )
    return found[0]


def _reports_in(folder: Path) -> list[Path]:
    """Return report.json, or else every JSON file that lies beside its page."""
    usual = folder / _USUAL_NAME
    if usual.is_file():
        return [usual]
    return [file for file in sorted(folder.glob("*.json")) if file.with_suffix(".html").is_file()]


def stated_in(sections: Mapping[str, Any]) -> Iterator[Stated]:
    """Return what is compared of the sections of report.json."""
    fit, causes, runs, quality = (sections.get(key) or {} for key in ("fit", "causes", "runs", "quality"))
    soils = fit.get("soils") or ()
    for soil in soils:
        where = soil["campaign"] if len(soils) > 1 else "soil"  # a single one is compared whatever its folder is called
        for name, value in soil["values"].items():
            sigma = _float(soil["sigmas"].get(name))
            yield Stated("soil", (where, name), _float(value), Z95 * sigma, SOIL_UNITS.get(name, ""))
    barred = frozenset(causes.get("barred") or ())
    for cause in causes.get("causes") or ():
        probable, is_barred = _float(cause.get("probability", 1.0)) >= LEAST_COMPARED, cause["name"] in barred
        sizes = [(each, *map(_float, each["interval95"])) for each in cause["parameters"]]
        yield from sizes_with_interval(
            Stated(
                "cause",
                (cause["name"], each["name"]),
                _float(each["value"]),
                half_interval(_float(each["value"]), low, high),
                "" if each["unit"] == "1" else each["unit"],
                probable and not is_barred,
                probable and is_barred,
            )
            for each, low, high in sizes
        )
    pull = (fit.get("traction") or {}).get("pull")
    if pull:
        low, high = map(_float, pull["interval95"])
        yield Stated("pull", ("pull_at_slip_0.2",), _float(pull["pull_n"]), (high - low) / 2, "N")
    figures = (sections.get("glance") or {}).get("key_figures") or {}
    for channel in OUTPUTS:
        if figure := figures.get(f"error.{channel}.{CALIBRATED_SOIL}"):
            yield Stated("error", ("error", channel, CALIBRATED_SOIL), _float(figure["value"]), nan, figure["unit"])
    shares = [share for run in runs.values() if (share := _float(run.get("usable_share"))) == share]
    if shares:
        yield Stated("data", ("usable_share",), sum(shares) / len(shares), nan, "")
    sizes = [(run["samples"], run["used_share"]) for run in quality.values() if run.get("samples")]
    if sizes:
        used, samples = sum(count * share for count, share in sizes), sum(count for count, _ in sizes)
        yield Stated("data", ("used_share",), used / samples, nan, "")


def half_interval(value: float, low: float, high: float) -> float:
    """Return half of an interval; all of it where the value is at an end, as that of a parameter at its bound is."""
    return (high - low) / (1 if value in (low, high) else 2)


def sizes_with_interval(sizes: Iterable[Stated]) -> list[Stated]:
    """Return those of a cause's parameters that have an interval, all where none has.

    The terms of a sum that alone is determined have none.
    """
    every = list(sizes)
    return [size for size in every if isfinite(size.half95)] or every


def changes_since(last: LastReport, sections: Mapping[str, Any]) -> list[Change]:
    """Return what differs between an earlier report and the sections of this one, beyond their intervals first.

    Causes come before the pull and the soil. Of the quality of the data only what both have, of causes those that one
    of the two compares, or that a rule bars in both.
    """
    undiagnosed = "last time" if not last.diagnosed else "" if "causes" in sections else "this time"
    changes = changes_between(last.stated, tuple(stated_in(sections)))
    changes = [replace(change, undiagnosed=undiagnosed if change.kind == "cause" else "") for change in changes]
    return sorted(changes, key=lambda change: not change.beyond)


def changes_between(earlier: Iterable[Stated], later: Iterable[Stated]) -> list[Change]:
    """Return what differs between two reports or campaigns; see `changes_since`."""
    of_both = (tuple(earlier), tuple(later))
    families = {each.name[0] for of_one in of_both for each in of_one if each.kind == "cause" and each.compared}
    families |= set.intersection(*({each.name[0] for each in of_one if each.barred} for of_one in of_both))
    before, now = (
        {each.name: each for each in of_one if each.kind != "cause" or each.name[0] in families} for of_one in of_both
    )
    both = before.keys() & now.keys()
    found = []
    for name in dict.fromkeys([*now, *before]):
        old, new = before.get(name), now.get(name)
        stated = new or old
        assert stated is not None
        if stated.kind == "data" and name not in both:
            continue
        values = [(each.value, each.half95) if each else (nan, nan) for each in (old, new)]
        found.append(Change(stated.kind, name, stated.unit, *values[0], *values[1]))
    return sorted(found, key=lambda change: (not change.beyond, _KINDS.index(change.kind)))


def _float(value: Any) -> float:
    return nan if value is None else float(value)
