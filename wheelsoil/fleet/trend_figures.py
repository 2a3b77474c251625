"""A transducer's zeros and gains over the days, campaign by campaign with error bars, as figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.diagnosis.pooling import Passport, Point, Trend
from wheelsoil.fleet.pooled import day_of
from wheelsoil.report import Curve, Drawing, Plane, drawn, reach
from wheelsoil.wording.names import plain_name
from wheelsoil.wording.passport_text import ZEROS_AND_GAINS

MOST_POINTS = 60
"""Of a figure: of more campaigns, those after one another are averaged."""
_DAYS_A_YEAR, _MONTHS_A_YEAR = 365.25, 12
_IN_DAYS = 90
"""Days up to which the axis has days; months beyond."""
_LARGE, _SMALL = (720, 360, 20), (300, 210, 10)


def passport_drawing(passport: Passport) -> Drawing | None:
    """Draw the course of the named parameter, or of a sound transducer the first."""
    effect = next((each for each in (*passport.effects, *passport.trends) if each in passport.trends), None)
    return None if effect is None else _drawing(passport, passport.trends[effect], _LARGE)


def trend_drawings(passport: Passport) -> list[Drawing]:
    """Draw every zero and gain that a campaign shows."""
    return [
        _drawing(passport, passport.trends[effect], _SMALL) for effect in ZEROS_AND_GAINS if effect in passport.trends
    ]


def _drawing(passport: Passport, trend: Trend, wide: tuple[int, int, int]) -> Drawing:
    factor, unit = (100.0, "%") if trend.unit == "1" else (1.0, trend.unit)
    known = averaged([point for point in trend.points if np.isfinite(point.value)], MOST_POINTS)
    first = min(point.years for point in trend.points)
    days = max(point.years for point in known) - first <= _IN_DAYS / _DAYS_A_YEAR
    a_year, name_of = (_DAYS_A_YEAR, "days") if days else (_MONTHS_A_YEAR, "months")
    at = np.array([(point.years - first) * a_year for point in known])
    value, half = (factor * np.array(each) for each in zip(*((p.value, 1.96 * p.sigma) for p in known), strict=True))
    along = np.linspace(0.0, max(float(at.max()), 0.1), 40)
    fitted = factor * np.array([trend.value(first + place / a_year) for place in along])
    name = plain_name(trend.effect)
    curves = [
        Curve("", along, fitted[:, 0], "model", fitted[:, 1], fitted[:, 2]),
        Curve("", at, value, "measured", value - half, value + half, points=True),
    ]
    last = float(along[-1])
    plane = Plane(
        (-0.02 * last, 1.02 * last),
        reach(value - half, value + half),
        f"{name_of} since {day_of(first)}",
        f"{name}, {unit}" + ", with 95 % intervals" * (wide is _LARGE),
    )
    title = f"{passport.sensor}: {name}"
    return drawn(f"passport-{passport.sensor}-{trend.effect}", title, "", plane, curves, wide=wide)


def averaged(points: Sequence[Point], most: int) -> list[Point]:
    """Return at most so many points: those after one another as their mean, weighted by their precision."""
    ordered = sorted(points, key=lambda point: point.years)
    if len(ordered) <= most:
        return ordered
    numbers = np.array([(point.years, point.value, point.sigma) for point in ordered])
    begin = np.arange(most) * len(ordered) // most
    weight = numbers[:, 2] ** -2.0
    total = np.add.reduceat(weight, begin)
    years, value = (np.add.reduceat(weight * numbers[:, i], begin) / total for i in (0, 1))
    return [Point("", *row) for row in zip(years.tolist(), value.tolist(), (total**-0.5).tolist(), strict=True)]
