"""What the campaigns of a store say together: passports of transducers, soils that differ from their laboratory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from model.diagnosis import Information
from model.diagnosis.pooling import (
    OF_THE_TRANSDUCER,
    Observation,
    Passport,
    SoilDeparture,
    passport_of,
    soil_departure,
)
from wheelsoil.fleet.holdings import Holdings, read
from wheelsoil.fleet.manifests import Damage
from wheelsoil.fleet.store import Store

_YEAR_S = 365.25 * 86400
_SURPRISING = 0.01
"""Probability, over all campaigns, from which on a soil differs from its laboratory."""


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
    damaged : tuple of Damage
        What was set aside.
    """

    passports: tuple[Passport, ...]
    soils: tuple[SoilDeparture, ...]
    nameless: tuple[str, ...]
    dateless: tuple[str, ...]
    damaged: tuple[Damage, ...] = ()


def pool(store: Store) -> Pooled:
    """Pool what the store's table ``evidence`` has; no recording is read."""
    found, damaged = read(store, ("evidence",), pooled_of)
    return replace(found, damaged=damaged)


def pooled_of(holdings: Holdings) -> Pooled:
    """Pool the evidence of the campaigns that can be read."""
    rows = holdings.table("evidence").to_pylist()
    nameless = tuple(row["campaign"] for row in rows if not row["transducer"])
    dateless = tuple(row["campaign"] for row in rows if row["transducer"] and row["start"] is None)
    by_serial: dict[str, list[Observation]] = {}
    for row in rows:
        if row["transducer"] and row["start"] is not None:
            by_serial.setdefault(row["transducer"], []).append(_observation(row))
    passports = {serial: passport_of(serial, own) for serial, own in sorted(by_serial.items())}
    others = [_observation(row) for row in rows if row["campaign"] in {*nameless, *dateless}]
    soils = [soil_departure(one) for one in others]
    soils += [soil_departure(one, _known(passports[s], one)) for s, own in by_serial.items() for one in own]
    far = sorted((one for one in soils if one.p_value < _SURPRISING / len(soils)), key=lambda one: one.p_value)
    return Pooled(tuple(passports.values()), tuple(far), nameless, dateless)


def _observation(row: Mapping[str, Any]) -> Observation:
    size = 1 + len(row["soil"]) + len(row["effects"])
    names = ("soil", "effects", "parameters", "units", "scales", "neutrals", "one_sided", "about")
    lists = {name: tuple(row[name]) for name in names}
    matrix = np.array(row["matrix"], float).reshape(size, size)
    information = Information(matrix=matrix, samples=row["samples"], **lists)
    years = row["start"].timestamp() / _YEAR_S if row["start"] is not None else 0.0
    return Observation(row["campaign"], years, information)


def _known(passport: Passport, one: Observation) -> np.ndarray[Any, Any] | None:
    """Return what is named of a transducer, in units of the parameters' scales."""
    if passport.decision != "named":
        return None
    scale = dict(zip(one.information.effects, one.information.scales, strict=True))
    found = np.zeros(len(OF_THE_TRANSDUCER))
    for effect in passport.effects:
        if effect in scale:
            found[OF_THE_TRANSDUCER.index(effect)] = passport.trends[effect].value(one.years)[0] / scale[effect]
    return found


def day_of(years: float) -> str:
    """Return the date of a time in a passport."""
    return datetime.fromtimestamp(years * _YEAR_S, UTC).date().isoformat()


def pooled_json(found: Pooled) -> dict[str, Any]:
    """Return it as plain mappings, dates as texts; sizes a year become sizes a month."""
    return {
        "schema": "wheelsoil/fleet-diagnosis/1",
        "transducers": [_passport_json(one) for one in found.passports],
        "soils_off_laboratory": [vars(one) for one in found.soils],
        "without_serial": list(found.nameless),
        "without_date": list(found.dateless),
        "damaged": [vars(one) for one in found.damaged],
    }


def _passport_json(one: Passport) -> dict[str, Any]:
    return {
        "serial": one.sensor,
        "campaigns": list(one.campaigns),
        "decision": one.decision,
        "effects": list(one.effects),
        "probability": one.wrong,
        "candidates": [vars(candidate) for candidate in one.candidates],
        "shared": [{"effect": each.effect, "probability": each.probability} for each in one.shared],
        "scatter": one.scatter,
        "disagree": one.disagree,
        "trends": {effect: dict(_trend_json(one, effect)) for effect in one.trends},
    }


def _trend_json(one: Passport, effect: str) -> Iterator[tuple[str, Any]]:
    trend = one.trends[effect]
    yield "parameter", trend.parameter
    yield "unit", trend.unit
    yield "date", day_of(trend.middle)
    yield "value", trend.at[0]
    yield "sigma", trend.at[1]
    yield "per_month", trend.per_year[0] / 12
    yield "per_month_sigma", trend.per_year[1] / 12
    yield "points", [{**vars(point), "date": day_of(point.years)} for point in trend.points]
