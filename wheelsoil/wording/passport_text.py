"""Passports of transducers and what else campaigns say together, as lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from daq import number
from model.diagnosis.pooling import Passport, SoilDeparture, Trend
from wheelsoil.wording.names import SOIL_LETTERS, plain_name

_Z95 = 1.96
_MONTHS = 12
_LIKELY = 0.5
_NAMED = 6
"""Campaigns that a line names, more are counted."""


def passport_line(one: Passport, first: str, last: str) -> str:
    """Return what is known of a transducer; `first` and `last` are its campaigns' dates."""
    count = len(one.campaigns)
    span = first if first == last else f"{first} to {last}"
    return f"{one.sensor}: {count} campaign{'s' * (count != 1)}, {span}: {'; '.join(_said(one))}"


def _said(one: Passport) -> Iterator[str]:
    chance = "> 99.9" if one.wrong > 0.999 else f"{100 * one.wrong:.1f}"
    if one.decision == "named":
        yield from (_course(one, effect) for effect in one.effects)
        yield "calibrate before the next campaign"
    elif one.decision == "flagged":
        names = " or ".join(map(plain_name, one.effects))
        yield f"something is wrong ({chance} %), open which: {names}"
        yield "calibrate these channels against weights"
    else:
        yield "nothing detectable"
        for effect, trend in list(one.trends.items())[:1]:
            yield f"its {plain_name(effect)} is known to {_size(_Z95 * trend.at[1], trend)}"
    if one.shared and one.shared[0].probability > _LIKELY:
        name, percent = plain_name(one.shared[0].effect), 100 * one.shared[0].probability
        yield f"all campaigns share what is not the transducer's: {name} ({percent:.0f} %)"
    if one.disagree:
        yield f"not as the others: {_names(list(one.disagree))}"


def _course(one: Passport, effect: str) -> str:
    trend = one.trends[effect]
    drifts = next(each.drifts / max(each.probability, 1e-9) for each in one.candidates if each.effect == effect)
    if drifts < 0.5:
        value, sigma = trend.at
        low, high = value - _Z95 * sigma, value + _Z95 * sigma
        return f"{plain_name(effect)} is off by {_size(value, trend)} ({_size(low, trend)} to {_size(high, trend)})"
    slope, sigma = (size / _MONTHS for size in trend.per_year)
    low, high = slope - _Z95 * sigma, slope + _Z95 * sigma
    return f"{plain_name(effect)} drifts by {_size(slope, trend)} a month ({_size(low, trend)} to {_size(high, trend)})"


def _size(value: float, trend: Trend) -> str:
    return f"{100 * value:.2f} %" if trend.unit == "1" else f"{number(value, 3)} {trend.unit}"


def soil_lines(soils: Sequence[SoilDeparture]) -> Iterator[str]:
    """Yield the campaigns whose soil differs from its laboratory, and in what most."""
    for one in soils:
        worst = sorted(one.sigmas.items(), key=lambda item: -abs(item[1]))[:2]
        sizes = ", ".join(f"{SOIL_LETTERS.get(name, name)} {size:+.1f}" for name, size in worst)
        yield f"{one.campaign}: {sizes} of the laboratory's one-sigma (p = {number(one.p_value, 2)})"


def left_out_line(campaigns: Sequence[str], what: str) -> str:
    """Return that some campaigns say nothing of a transducer, and why."""
    count = len(campaigns)
    return f"{count} campaign{'s' * (count != 1)} without {what} in no passport: {_names(campaigns)}"


def _names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
