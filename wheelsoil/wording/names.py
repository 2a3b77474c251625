"""Names, places and probabilities as sentences and tables write them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from math import floor, isfinite

from daq import OUTPUTS, Quantity, unit_suffix, unit_text
from model.diagnosis import Kind, Rows, Shape
from model.effects import EFFECTS, Effect, parted

_TEXTS = {
    Kind.SLIP: "slip {} to {}",
    Kind.BRAKING_SLIP: "braking, slip {} to {}",
    Kind.LOAD_DRIVING: "growing with load, driving",
    Kind.LOAD_BRAKING: "growing with load, braking",
    Kind.LOAD_SQUARED: "at loads far from the mean",
    Kind.GROUND_SPEED: "ground speed {} to {} m/s",
    Kind.LINE_POSITION: "place on the line {} to {} (of -1 to 1)",
    Kind.TIME_IN_RUN: "{run}, {} to {} s",
    Kind.DIRECTION_DRIVING: "with the sign of the direction (out +, back -), driving",
    Kind.DIRECTION_BRAKING: "with the sign of the direction (out +, back -), braking",
    Kind.CONSTANT_DRIVING: "the same wherever it drives",
    Kind.CONSTANT_BRAKING: "the same wherever it brakes",
    Kind.ACCELERATION_DRIVING: "speeding up (slowing down: the other sign), driving",
    Kind.ACCELERATION_BRAKING: "speeding up (slowing down: the other sign), braking",
    Kind.SLIP_RATE_DRIVING: "rising slip (falling: the other sign), driving",
    Kind.SLIP_RATE_BRAKING: "rising slip (falling: the other sign), braking",
    Kind.DRAWBAR_PULL: "at simulated drawbar pulls of {} to {} kN",
    Kind.DRAWBAR_PULL_SQUARED: "growing with the square of the simulated drawbar pull",
    Kind.DRAWBAR_PULL_DRIFT: "as a share of drawbar pull that grows over the campaign",
    Kind.TORQUE: "at simulated torques of {} to {} kN m",
    Kind.TORQUE_SQUARED: "growing with the square of the simulated torque",
    Kind.TORQUE_DRIFT: "as a share of torque that grows over the campaign",
    Kind.ZERO_WITH_LOAD: "as a zero that grows with the load, at standstill too",
    Kind.SPEED_ERROR: "as a sensor error, at {} to {} m/s",
    Kind.LOAD_ERROR: "as a sensor error everywhere",
    Kind.LOAD_ERROR_WITH_LOAD: "as a sensor error, growing with the load",
}

_HIGHEST, _LOWEST = 0.9995, 0.0005
_ROUNDING = 1e-6

SOIL_LETTERS = {
    "cohesion_pa": "c",
    "tan_phi": "tan φ",
    "shear_modulus_m": "K",
    "sinkage_exponent": "n",
    "cohesive_modulus": "k_c",
    "frictional_modulus": "k_φ",
}
"""The textbook's letters of the soil's parameters."""

SOIL_UNITS = {
    "cohesion_pa": "Pa",
    "tan_phi": "",
    "shear_modulus_m": "m",
    "sinkage_exponent": "",
    "cohesive_modulus": "N/m^(n+1)",
    "frictional_modulus": "N/m^(n+2)",
}
"""Units of the soil's parameters; "" for a plain number."""

_RUN = "run-"

LABORATORY = "Wong, laboratory soil"
"""Wong's model with the soil of terrain.toml."""
CALIBRATED = "Wong, calibrated soil"
"""Wong's model with the soil fitted to the runs within the laboratory's uncertainty, and no cause."""

PARAMETERS = {
    "H_m": "H",
    "H2_m": "H₂",
    "Q_m": "Q",
    "m1": "m₁",
    "m2": "m₂",
    "p": "p = m₁ + m₂",
    "n1": "n₁",
    "c1": "c₁",
    "c2": "c₂",
    "ln_mu": "ln μ",
    "lambda": "λ",
    "angle_rad": "angle",
    "relative": "relative error",
    "campaign_span_n": "drift over the campaign",
    **SOIL_LETTERS,
}
"""The textbook's letters of parameters."""

_UNITS = {unit_suffix(quantity.value): unit_text(quantity.value) for quantity in Quantity}


NOT_IDENTIFIABLE, OMITTED = ("not_identifiable", "cannot_tell"), ("omitted", "left_out")
"""Keys of JSON: the second is the former one, which stays one version."""


def letter(name: str) -> str:
    """Return the textbook's letter of a parameter, or else its name in words, without the unit."""
    return PARAMETERS.get(name) or (name if "=" in name else named_with_unit(name)[0])


def named_with_unit(name: str) -> tuple[str, str]:
    """Return "drawbar pull noise", "N" of ``drawbar_pull_noise_n``; "" as the unit where the name ends in none."""
    plain, _, last = name.rpartition("_")
    known = plain and last in _UNITS
    return (plain if known else name).replace("_", " "), _UNITS[last] if known else ""


def soil_unit(name: str) -> tuple[float, str]:
    """Return the factor to the unit of a soil's parameter that pages write, as terrain.toml does, and that unit."""
    text = SOIL_UNITS.get(name, "")
    return (1e-3, f"k{text}") if text.startswith(("Pa", "N/")) else (1.0, text)


def page_unit(channel: str) -> tuple[float, str]:
    """Return the factor to the unit that pages write for a channel, and that unit: sinkage is in mm."""
    return (1e3, "mm") if OUTPUTS[channel].unit == "m" else (1.0, OUTPUTS[channel].unit_text)


def plain_name(name: str) -> str:
    """Return the name of a family or a channel as people write it."""
    plain, wheel = parted(name)
    return plain.replace("_", " ") + (f" of wheel {wheel}" if wheel else "")


def plain_names(names: Iterable[str]) -> list[str]:
    """Return families as people write them, each once: with the wheels at which it may act alone."""
    wheels: dict[str, list[str]] = {}
    for name in names:
        plain, wheel = parted(name)
        wheels.setdefault(plain, []).append(wheel)
    return [
        plain_name(plain) + (f" ({', '.join(wheel or 'all wheels' for wheel in own)})" if any(own) else "")
        for plain, own in wheels.items()
    ]


def effect_name(key: str) -> str:
    """Return family and form of an effect of the library, or the key of one that is not in it."""
    effect = EFFECTS.get(key)
    if effect is None:
        return plain_name(key)
    return f"{plain_name(effect.name)} ({effect.form})" if effect.form else plain_name(effect.name)


def meaning(key: str) -> str:
    """Return what an effect states of itself and of its source, as far as it does."""
    effect = EFFECTS.get(key, Effect)
    return " ".join(filter(None, (effect.summary, effect.source and f"({effect.source})")))


def family_of(key: str) -> str:
    """Return the family of an effect of the library, or the key of one that is not in it."""
    effect = EFFECTS.get(key)
    return effect.name if effect else key


def parameter_name(key: str, name: str) -> str:
    """Return the name of a cause's parameter; of a total, with its summands: "p = m1 + m2"."""
    return EFFECTS[key].spelled(name) if key in EFFECTS else name


def chance(p: float) -> str:
    """Return a probability as a percentage with one decimal; never 100 % or 0 %, which no data give."""
    return "> 99.9 %" if p >= _HIGHEST else "< 0.1 %" if p < _LOWEST else f"{100 * p:.1f} %" if isfinite(p) else "-"


def with_chance(family: str, p: float) -> str:
    """Return a family in plain words, with its probability."""
    return f"{plain_name(family)} ({chance(p)})"


def shares_percent(shares: Sequence[float]) -> list[float]:
    """Return shares that add up to 1 as percentages with one decimal that add up to 100, by the largest remainder."""
    tenths = [1000.0 * max(share, 0.0) for share in shares]
    whole = [floor(tenth + _ROUNDING) for tenth in tenths]
    lacking = round(sum(tenths)) - sum(whole)
    order = sorted(range(len(tenths)), key=lambda i: whole[i] - tenths[i])
    for i in order[: max(lacking, 0)]:
        whole[i] += 1
    return [tenth / 10 for tenth in whole]


def place_text(place: Shape | Rows) -> str:
    """Return where a misfit is, as it reads on its own."""
    if isinstance(place, Rows):
        before = f"{place.campaign}, " if place.campaign else ""
        manner, rows = "driving" if place.slip >= 0 else "braking", "row" if place.count == 1 else "rows"
        return f"{before}slip {place.slip:.2f}, load {place.vertical_load_n:.3g} N, {manner} ({place.count} {rows})"
    before = f"{place.campaign}: " if place.campaign else ""
    ends = [f"{end:.2g}" for end in place.range or ()]
    return before + _TEXTS[Kind(place.kind)].format(*ends, run=place.run)


def listed(names: Sequence[str], joint: str = "and") -> str:
    """Return "a, b and c"."""
    return " ".join([", ".join(names[:-1]), joint, names[-1]]) if len(names) > 1 else "".join(names)


def stretches(names: Collection[str], order: Sequence[str], most: int = 5) -> str:
    """Return names in their order, three and more that follow each other as "a to c"; many only by their number.

    Names as "run-1" are "runs 1 to 3".
    """
    numbered = len(names) > 1 and all(name.startswith(_RUN) and name[len(_RUN) :].isdigit() for name in order)
    shown = [name.removeprefix(_RUN) for name in order] if numbered else order
    parts: list[list[str]] = []
    before = -1
    for place in sorted(order.index(name) for name in names):
        if place == before + 1 and parts:
            parts[-1].append(shown[place])
        else:
            parts.append([shown[place]])
        before = place
    texts = [text for part in parts for text in ([f"{part[0]} to {part[-1]}"] if len(part) > 2 else part)]
    return f"{'runs ' if numbered else ''}{listed(texts)}" if len(texts) <= most else f"{len(names)} runs"


def upper(text: str) -> str:
    """Return a text that begins with a capital."""
    return f"{text[:1].upper()}{text[1:]}"
