"""Passports of transducers and what else campaigns say together, as lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from daq import ALL_WHEELS, number
from model.diagnosis.pooling import Passport, SoilDeparture, Trend
from wheelsoil.fleet import Change, NamedError, day_of
from wheelsoil.wording.change_text import size_sentence
from wheelsoil.wording.grounds_text import verdict_words
from wheelsoil.wording.names import SOIL_LETTERS, chance, plain_name
from wheelsoil.workflows.key_figures import Z95

_MONTHS = 12
_LIKELY = 0.5
_NAMED = 6
"""Campaigns that a line names, more are counted."""
ZEROS_AND_GAINS = tuple(f"{of}_{kind}" for of in ("drawbar_pull", "torque", "load") for kind in ("zero", "gain"))
_WHAT = {"wheel_radius_m": "wheel radius, m,"}


def passport_line(passport: Passport, first: str, last: str) -> str:
    """Return what is known of a transducer; `first` and `last` are its campaigns' dates."""
    count = len(passport.campaigns)
    span = first if first == last else f"{first} to {last}"
    return f"{passport.sensor}: {count} campaign{'s' * (count != 1)}, {span}: {'; '.join(_findings(passport))}"


def _findings(passport: Passport) -> Iterator[str]:
    chance = "> 99.9" if passport.wrong > 0.999 else f"{100 * passport.wrong:.1f}"
    if passport.decision == "named":
        yield from (_course(passport, effect) for effect in passport.effects)
        yield "calibrate before the next campaign"
    elif passport.decision == "flagged":
        names = " or ".join(map(plain_name, passport.effects))
        yield f"something is wrong ({chance} %), open which: {names}"
        yield "calibrate these channels against weights"
    else:
        weighed = ((each.effect, each.probability) for each in passport.candidates)
        yield verdict_words("nothing_detectable", {"none": 1.0 - passport.wrong, **dict(weighed)})
        for effect, trend in list(passport.trends.items())[:1]:
            yield f"its {plain_name(effect)} is known to {_size(Z95 * trend.at[1], trend)}"
    if passport.shared and passport.shared[0].probability > _LIKELY:
        name, percent = plain_name(passport.shared[0].effect), 100 * passport.shared[0].probability
        yield f"all campaigns share what is not the transducer's: {name} ({percent:.0f} %)"
    if passport.disagree:
        yield f"not as the others: {_names(list(passport.disagree))}"


def _course(passport: Passport, effect: str) -> str:
    trend = passport.trends[effect]
    drifts = next(each.drifts / max(each.probability, 1e-9) for each in passport.candidates if each.effect == effect)
    if drifts < 0.5:
        return f"{plain_name(effect)} is off by {_interval(*trend.at, trend)}"
    slope, sigma = (size / _MONTHS for size in trend.per_year)
    return f"{plain_name(effect)} drifts by {_interval(slope, sigma, trend, ' a month')}"


def trend_lines(passport: Passport) -> Iterator[str]:
    """Yield each zero and gain of a transducer with its 95 % intervals."""
    for effect in ZEROS_AND_GAINS:
        trend = passport.trends.get(effect)
        if trend is None:
            continue
        slope = ""
        if len({point.years for point in trend.points}) > 1:
            a_month, sigma = (size / _MONTHS for size in trend.per_year)
            slope = f"; {_interval(a_month, sigma, trend)} a month"
        yield f"{plain_name(effect)}: {_interval(*trend.at, trend)} on {day_of(trend.middle)}{slope}"


def _interval(value: float, sigma: float, trend: Trend, per: str = "") -> str:
    low, high = value - Z95 * sigma, value + Z95 * sigma
    return f"{_size(value, trend)}{per} ({_size(low, trend)} to {_size(high, trend)})"


def _size(value: float, trend: Trend | NamedError) -> str:
    return f"{100 * value:.2f} %" if trend.unit == "1" else f"{number(value, 3)} {trend.unit}"


def named_lines(named: Sequence[NamedError]) -> Iterator[str]:
    """Yield the errors of the measurement that single campaigns name."""
    for error in named:
        places = (error.serial or "transducer without serial") if error.is_transducers else "not the transducer's"
        day = f", {error.start:%Y-%m-%d}" if error.start else ""
        low, high = _size(error.lower95, error), _size(error.upper95, error)
        size = f"{_size(error.value, error)} ({low} to {high})"
        of = f"{error.campaign}{_at(error)} ({places}{day})"
        yield f"{of}: {plain_name(error.effect)} {size}, {chance(error.probability)}"


def _at(found: NamedError | SoilDeparture | Change) -> str:
    return {"": "", ALL_WHEELS: ", all wheels"}.get(found.wheel, f", wheel {found.wheel}")


def change_lines(changes: Sequence[Change]) -> Iterator[str]:
    """Yield what changed since the last campaign of each vehicle and terrain."""
    for change in changes:
        differences = "; ".join(_changed(change)) or "the same within the intervals"
        yield (
            f"{change.of} {change.name}{_at(change)}: {change.campaign} ({change.start:%Y-%m-%d}) "
            f"after {change.before} ({change.start_before:%Y-%m-%d}): {differences}"
        )


def _changed(change: Change) -> Iterator[str]:
    if change.pull is not None:
        before, now = number(change.pull.before_n, 3), number(change.pull.now_n, 3)
        if change.pull.is_beyond:
            half = number(change.pull.half95_n or 0.0, 2)
            yield f"drawbar pull at slip 0.2 from {before} to {now} N, beyond their intervals (± {half} N)"
        elif change.pull.half95_n is None and before != now:
            yield f"drawbar pull at slip 0.2 from {before} to {now} N, without an interval"
    yield from map(size_sentence, change.sizes)
    for what, (before, now) in change.differs.items():
        yield f"{_WHAT.get(what, what)} {_as_text(before)} → {_as_text(now)}"


def _as_text(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(plain_name, value)) or "none"
    if isinstance(value, float):
        return number(value, 3)
    return plain_name(str(value)) if value else "not stated"


def soil_lines(soils: Sequence[SoilDeparture]) -> Iterator[str]:
    """Yield the campaigns whose soil differs from its laboratory, and in what most."""
    for soil in soils:
        worst = sorted(soil.sigmas.items(), key=lambda item: -abs(item[1]))[:2]
        sizes = ", ".join(f"{SOIL_LETTERS.get(name, name)} {size:+.1f}" for name, size in worst)
        yield f"{soil.campaign}{_at(soil)}: {sizes} of the laboratory's one-sigma (p = {number(soil.p_value, 2)})"


def left_out_line(campaigns: Sequence[str], what: str) -> str:
    """Return that some campaigns say nothing of a transducer, and why."""
    count = len(campaigns)
    return f"{count} campaign{'s' * (count != 1)} without {what} in no passport: {_names(campaigns)}"


def _names(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
