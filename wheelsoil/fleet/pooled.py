"""What the campaigns of a store say together: passports of transducers, soils (docs/decisions/pooling.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa

from daq import ALL_WHEELS
from model.diagnosis import Information
from model.diagnosis.pooling import (
    OF_THE_TRANSDUCER,
    Observation,
    Passport,
    Point,
    SoilDeparture,
    passport_of,
    soil_departure,
)
from wheelsoil.fleet import Damage, Store
from wheelsoil.fleet.changes import Change, changes_of
from wheelsoil.fleet.holdings import Holdings, read
from wheelsoil.to_json import streamed

_YEAR_S = 365.25 * 86400
_SURPRISING = 0.01
"""Probability, over all campaigns, from which on a soil differs from its laboratory."""
_AT_ONCE = 5_000
"""Campaigns whose evidence, some 20 kB each, is in memory together; more only if one transducer has more."""
_ROWS = 256
TABLES = ("evidence", "campaigns", "causes", "diagnoses")
"""What is read of a store."""
_LISTS = ("soil", "effects", "parameters", "units", "scales", "neutrals", "one_sided", "about")


@dataclass(frozen=True)
class NamedError:
    """An error of the measurement that the diagnosis of one campaign names.

    `serial`, `start` and, of several wheels, the `wheel` are as far as known.
    """

    campaign: str
    serial: str
    start: datetime | None
    effect: str
    parameter: str
    unit: str
    value: float
    lower95: float
    upper95: float
    probability: float
    wheel: str = ""

    @property
    def is_transducers(self) -> bool:
        """Whether it is an error of the transducer, and not of speed or wheel."""
        return self.effect in OF_THE_TRANSDUCER


@dataclass(frozen=True)
class Pooled:
    """What a store's campaigns say together.

    Attributes
    ----------
    passports : tuple of Passport
        One for each serial; their years are those since 1970.
    soils : tuple of SoilDeparture
        That differ from their laboratory, the most surprising one first.
    nameless, dateless : tuple of str
        Campaigns without a transducer's serial, or without a date.
    named : tuple of NamedError
        By single campaigns, the latest first.
    changes : tuple of Change
        Since the last campaign of the same vehicle or terrain.
    damaged : tuple of Damage
        What was set aside.
    """

    passports: tuple[Passport, ...]
    soils: tuple[SoilDeparture, ...]
    nameless: tuple[str, ...]
    dateless: tuple[str, ...]
    named: tuple[NamedError, ...] = ()
    changes: tuple[Change, ...] = ()
    damaged: tuple[Damage, ...] = ()

    @property
    def transducers(self) -> tuple[str, ...]:
        """All of them by serial; "" for those without one that a campaign names an error of."""
        return tuple(sorted({passport.sensor for passport in self.passports} | self._named_ones))

    @property
    def wrong(self) -> tuple[str, ...]:
        """Those that are not sound by their passport, or by what one of their campaigns names."""
        flagged = {passport.sensor for passport in self.passports if passport.decision != "nothing"}
        return tuple(sorted(flagged | self._named_ones))

    @property
    def _named_ones(self) -> set[str]:
        return {error.serial for error in self.named if error.is_transducers}


def pool(store: Store) -> Pooled:
    """Pool what the store's tables have; no recording is read."""
    found, damaged = read(store, TABLES, pooled_of)
    return replace(found, damaged=damaged)


def pooled_of(holdings: Holdings) -> Pooled:
    """Pool the evidence of the campaigns that can be read; that of `_AT_ONCE` campaigns is in memory together."""
    listed = holdings.table("evidence", ("transducer", "start", "wheel")).to_pylist()
    together = {row["campaign"] for row in listed if row["wheel"] == ALL_WHEELS}
    rows = [(row["campaign"], row["transducer"], row["start"]) for row in listed if row["wheel"] != ALL_WHEELS]
    nameless = tuple(dict.fromkeys(campaign for campaign, serial, _ in rows if not serial))
    dateless = tuple(dict.fromkeys(campaign for campaign, serial, start in rows if serial and start is None))
    surprising = _SURPRISING / max(sum(campaign not in together for campaign, *_ in rows) + len(together), 1)
    errors: dict[str, dict[str, float]] = {}
    passports: dict[str, Passport] = {}
    far: list[SoilDeparture] = []
    for serials in _in_turn(Counter(row["transducer"] for row in listed)):
        by_serial: dict[str, list[Observation]] = {}
        for serial, observation in _observations(holdings, serials):
            by_serial.setdefault(serial, []).append(observation)
        for serial, own in sorted(by_serial.items(), key=lambda item: (not item[0], item[0])):
            if serial:
                passports[serial] = passport_of(serial, own)
            for each in own:
                known = _known(passports[serial], each.years) if serial else errors.get(each.campaign, {})
                at_wheel = {f"{effect}@{each.wheel}": size for effect, size in known.items()}
                errors.setdefault(each.campaign, {}).update(at_wheel)
                if each.wheel == ALL_WHEELS or each.campaign not in together:
                    far += [soil for soil in [soil_departure(each, known)] if soil.p_value < surprising]
    ordered = [passports[serial] for serial in sorted(passports)]
    far.sort(key=lambda soil: (soil.p_value, soil.campaign))
    return Pooled(tuple(ordered), tuple(far), nameless, dateless, _named(holdings), changes_of(holdings))


def _named(holdings: Holdings) -> tuple[NamedError, ...]:
    from pyarrow import dataset

    columns = [field.name for field in fields(NamedError) if field.name not in ("serial", "start", "effect")]
    wanted = (dataset.field("role") == "named") & (dataset.field("kind") == "measurement")
    wanted = wanted & dataset.field("value").is_valid()
    rows = holdings.where("causes", (*columns, "family", "at_wheel"), wanted).to_pylist()
    if not rows:
        return ()
    together = campaigns_together(holdings)
    known: dict[str, dict[str, tuple[str, datetime | None]]] = {}
    for row in holdings.table("campaigns", ("wheel", "transducer", "start")).to_pylist():
        known.setdefault(row["campaign"], {})[row["wheel"] or ""] = row["transducer"] or "", row["start"]
    found = []
    for row in rows:
        wheel, own, effect = row.pop("wheel"), known.get(row["campaign"], {}), row.pop("family")
        at, of_transducer = row.pop("at_wheel") or "", effect in OF_THE_TRANSDUCER
        if wheel != ALL_WHEELS and row["campaign"] in together:
            continue
        for place in [at] if at or not of_transducer else own or [""]:  # at all wheels it is each transducer's
            serial, start = own.get(place) or ("", next((start for _, start in own.values()), None))
            found.append(NamedError(serial=serial, start=start, effect=effect, wheel=place, **row))
    return tuple(sorted(found, key=lambda error: (-(error.start.timestamp() if error.start else 0.0), error.campaign)))


def campaigns_together(holdings: Holdings) -> set[str]:
    """Return the campaigns whose wheels are diagnosed together: that counts, and not what one of them shows."""
    from pyarrow import dataset

    found = holdings.where("diagnoses", ("campaign",), dataset.field("wheel") == ALL_WHEELS)
    return set(found["campaign"].to_pylist())


def _in_turn(counts: Mapping[str | None, int]) -> Iterator[list[str | None]]:
    """Yield the transducers whose evidence is read together; last what has none: what wheels say together."""
    some: list[str | None] = []
    total = 0
    for serial, count in sorted(counts.items(), key=lambda item: (not item[0], item[0] or "")):
        if some and total + count > _AT_ONCE:
            yield some
            some, total = [], 0
        some.append(serial)
        total += count
    if some:
        yield some


def _observations(holdings: Holdings, serials: Sequence[str | None]) -> Iterator[tuple[str, Observation]]:
    """Yield the campaigns of some transducers, with "" for one without a serial or a date."""
    from pyarrow import dataset

    serial = dataset.field("transducer")
    wanted = serial.isin(pa.array([number for number in serials if number is not None], pa.string()))
    wanted = wanted | serial.is_null() if None in serials else wanted
    alike: dict[tuple[Any, ...], tuple[Any, ...]] = {}  # what most campaigns have in common is held once
    scanned = (
        each.to_batches(filter=wanted, batch_size=_ROWS, batch_readahead=1, fragment_readahead=1)
        for each in holdings.datasets("evidence")
    )
    for batch in chain.from_iterable(scanned):
        matrices = batch["matrix"]
        for i, row in enumerate(batch.drop_columns(["matrix"]).to_pylist()):
            lists = {name: alike.setdefault(tuple(row[name]), tuple(row[name])) for name in _LISTS}
            size = 1 + len(row["soil"]) + len(row["effects"])
            matrix = np.array(matrices[i].values, float).reshape(size, size)
            information = Information(matrix=matrix, samples=row["samples"], **lists)
            dated = row["start"] is not None
            years = row["start"].timestamp() / _YEAR_S if dated else 0.0
            observation = Observation(row["campaign"], years, information, row["wheel"] or "")
            yield (row["transducer"] or "") if dated else "", observation


def _known(passport: Passport, years: float) -> dict[str, float]:
    """Return the sizes of what is named of a transducer."""
    named = passport.effects if passport.decision == "named" else ()
    return {effect: passport.trends[effect].value(years)[0] for effect in named}


def day_of(years: float) -> str:
    """Return the date of a time in a passport."""
    return datetime.fromtimestamp(years * _YEAR_S, UTC).date().isoformat()


def pooled_json(found: Pooled) -> Iterator[str]:
    """Yield it as JSON text, piece by piece; dates are texts, sizes a year become sizes a month."""
    return streamed(pooled_values(found), {"transducers": passports_json(found)})


def passports_json(found: Pooled) -> Iterator[dict[str, Any]]:
    """Yield the transducers as plain mappings, with a point for each campaign."""
    return map(_passport_json, found.passports)


def pooled_values(found: Pooled) -> dict[str, Any]:
    """Return all but the transducers as plain mappings."""
    return {
        "schema": "wheelsoil/fleet-diagnosis/1",
        "soils_off_laboratory": list(map(_with_wheel, found.soils)),
        "named_by_campaigns": [
            {**_with_wheel(error), "start": error.start.isoformat() if error.start else None} for error in found.named
        ],
        "changes": [_change_json(change) for change in found.changes],
        "without_serial": list(found.nameless),
        "without_date": list(found.dateless),
        "damaged": [vars(damage) for damage in found.damaged],
    }


def _with_wheel(found: SoilDeparture | NamedError | Change | Point) -> dict[str, Any]:
    """Return it as a mapping, with the wheel where there are several."""
    return {key: value for key, value in vars(found).items() if value or key != "wheel"}


def _change_json(change: Change) -> dict[str, Any]:
    pull = change.pull and {**vars(change.pull), "beyond": change.pull.is_beyond}
    dates = {"start": change.start.isoformat(), "start_before": change.start_before.isoformat()}
    own = {key: value for key, value in _with_wheel(change).items() if key not in ("pull", "sizes")}
    sizes = [vars(size) | {"difference": size.difference} for size in change.sizes]
    return {**own, **dates, "pull_at_slip_0_2": pull, "sizes": sizes}


def _passport_json(passport: Passport) -> dict[str, Any]:
    return {
        "serial": passport.sensor,
        "campaigns": list(passport.campaigns),
        "decision": passport.decision,
        "effects": list(passport.effects),
        "probability": passport.wrong,
        "candidates": [vars(candidate) for candidate in passport.candidates],
        "shared": [{"effect": each.effect, "probability": each.probability} for each in passport.shared],
        "scatter": passport.scatter,
        "disagree": passport.disagree,
        "trends": {effect: _trend_json(passport, effect) for effect in passport.trends},
    }


def _trend_json(passport: Passport, effect: str) -> dict[str, Any]:
    trend = passport.trends[effect]
    return {
        "parameter": trend.parameter,
        "unit": trend.unit,
        "date": day_of(trend.middle),
        "value": trend.at[0],
        "sigma": trend.at[1],
        "per_month": trend.per_year[0] / 12,
        "per_month_sigma": trend.per_year[1] / 12,
        "points": [{**_with_wheel(point), "date": day_of(point.years)} for point in trend.points],
    }
