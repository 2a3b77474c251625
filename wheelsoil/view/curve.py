"""The model's curve over slip for the page's sliders (one load, steady driving, no fit), and the sliders' ranges."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, log10
from typing import Any

import numpy as np

from daq import OUTPUTS, ConfigError, Fault, FloatArray, nearest
from model.effects import EFFECTS
from model.effects import Parameter as EffectParameter
from model.wheel_soil import (
    LABORATORY_SPREAD,
    SOIL_PARAMETERS,
    Conditions,
    Reading,
    Soil,
    SoilPrior,
    Wheel,
    WheelSoilModel,
    speed_ratio,
)
from wheelsoil.wording.names import letter, named_with_unit

SLIPS = np.linspace(-0.3, 0.95, 120)

_SIGMAS = 4.0
"""Half the range of a slider, in prior scales (plausible sizes) from the neutral value."""
_STEPS = 200
_SOIL: dict[str, tuple[str, str, float, float, float]] = {
    "cohesion_pa": ("cohesion c", "Pa", 0.0, 1e6, 5e3),
    "tan_phi": ("friction tan φ", "1", 0.0, 1.75, 0.5),
    "shear_modulus_m": ("shear modulus K", "m", 1e-4, 1.0, 0.02),
    "sinkage_exponent": ("sinkage exponent n", "1", 0.05, 3.0, 1.0),
    "cohesive_modulus": ("cohesive modulus k_c", "N/m^(n+1)", -1e9, 1e9, 50e3),
    "frictional_modulus": ("frictional modulus k_φ", "N/m^(n+2)", -1e9, 1e9, 500e3),
}
"""Label, unit, lower and upper bound, and a typical size for a value that is zero."""


@dataclass(frozen=True)
class Base:
    """Conditions of a campaign's curve; effects may need more than slip and load.

    Attributes
    ----------
    load_n : float
        Median of the used samples.
    ground_speed_mps : float
        Median of the used samples; constant, and the wheel speed follows from the slip.
    direction : 1 or -1
    pass_number : float
        The highest of the runs.
    inflation_kpa : float
        The lowest of the runs; NaN where none is known.
    """

    wheel: Wheel
    soil: Soil
    load_n: float
    ground_speed_mps: float
    direction: float = 1.0
    pass_number: float = 1.0
    inflation_kpa: float = float("nan")

    def conditions(self) -> Conditions:
        """Return the conditions at `SLIPS`: unaccelerated, at the far end of the line and the end of the campaign."""
        ratio = 1.0 / speed_ratio(SLIPS)

        def held(value: float) -> FloatArray:
            return np.full(len(SLIPS), value)

        return Conditions(
            slip=SLIPS,
            vertical_load_n=held(self.load_n),
            ground_speed_mps=held(self.ground_speed_mps),
            wheel_speed_radps=self.ground_speed_mps * ratio / self.wheel.radius_m,
            ground_acceleration_mps2=held(0.0),
            ground_jerk_mps3=held(0.0),
            wheel_acceleration_radps2=held(0.0),
            line_position=held(1.0),
            campaign_time=held(0.5),
            direction=held(self.direction),
            pass_number=held(self.pass_number),
            inflation_kpa=held(self.inflation_kpa),
            unit_weight_n_m3=held(self.soil.unit_weight_n_m3),
            body_pitch_rad=held(0.0),
        )


def curve_of(
    base: Base, effects: Sequence[str], reading: Reading, values: Mapping[str, float]
) -> dict[str, FloatArray | float]:
    """Return slip, drawbar pull, torque and sinkage, each of shape (120,), NaN where the model has no answer.

    `effects` are keys of `EFFECTS`; `values` are the parameters that differ from the values of the soil and the neutral
    values of the effects. `ConfigError` for an unknown parameter, or two effects that share one.
    """
    model = WheelSoilModel(base.wheel, base.soil, [EFFECTS[key] for key in effects], reading)
    found = model.predict(base.conditions(), values)
    return {
        "slip": SLIPS,
        **{channel.field: getattr(found, channel.field) for channel in OUTPUTS.values()},
        "load_n": base.load_n,
    }


def over_time(
    base: Base, conditions: Conditions, effects: Sequence[str], reading: Reading, values: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return drawbar pull, torque and sinkage at the samples of a run, each of shape (n,); see `curve_of`."""
    model = WheelSoilModel(base.wheel, base.soil, [EFFECTS[key] for key in effects], reading)
    weight = np.full(np.shape(conditions.slip), base.soil.unit_weight_n_m3)
    found = model.predict(replace(conditions, unit_weight_n_m3=weight), values)
    return {channel.field: getattr(found, channel.field) for channel in OUTPUTS.values()}


def soil_parameters(soil: Soil, prior: SoilPrior) -> list[dict[str, Any]]:
    """Return the soil's parameters; `low` and `high` are four sigmas of the laboratory away."""
    return [_soil_parameter(name, float(getattr(soil, name)), prior) for name in SOIL_PARAMETERS]


def effect_entries(
    base: Base, reading: Reading, reasons: Mapping[str, str], roles: Collection[str], chosen: Collection[str]
) -> Iterator[dict[str, Any]]:
    """Yield every effect with its parameters, and why these data cannot identify it (`reasons` by family).

    Effects that need further `roles` than the vehicle declares are left out, but for those that are `chosen`.
    """
    visible = _visible_in_curve(base, reading)
    for key, effect in EFFECTS.items():
        lacking = [role for role in effect.needs.roles if role not in roles]
        if lacking and key not in chosen:
            continue
        why = {effect.name: f"vehicle.toml declares no {', '.join(lacking)}"} if lacking else {}
        yield _entry(key, base.wheel, reading, {**reasons, **why}) | {"in_curve": visible[key]}


def checked_values(effects: Sequence[str], values: Mapping[str, float], soil: Mapping[str, float]) -> dict[str, float]:
    """Return the values of soil and effects in one mapping, as the model expects them.

    `ConfigError` lists unknown effects, unknown parameters, and values out of bounds.
    """
    faults = [
        Fault(f"no effect is called {key!r}", "effects", expected=nearest(key, EFFECTS))
        for key in effects
        if key not in EFFECTS
    ]
    known = {
        key: (p.lower, p.upper)
        for effect in effects
        if effect in EFFECTS
        for key, p in zip(EFFECTS[effect].parameter_keys().values(), EFFECTS[effect].parameters, strict=True)
    }
    faults += _unfit(values, known, "values")
    faults += _unfit(soil, {name: (low, high) for name, (_, _, low, high, _) in _SOIL.items()}, "soil")
    ConfigError.stop_if_any(faults)
    return {**soil, **values}


def _unfit(given: Mapping[str, float], bounds: Mapping[str, tuple[float, float]], where: str) -> Iterable[Fault]:
    for name, value in given.items():
        low, high = bounds.get(name, (-inf, inf))
        if name not in bounds:
            step = "switch its effect on" if where == "values" else ""
            yield Fault(f"there is no parameter {name!r}", where, expected=nearest(name, bounds), next_step=step)
        elif not low <= value <= high:
            yield Fault(f"{name} is out of bounds", where, f"{value:g}", f"{low:g} to {high:g}")


def _soil_parameter(name: str, value: float, prior: SoilPrior) -> dict[str, Any]:
    label, unit, least, most, usual = _SOIL[name]
    sigma = prior.sigma_of(name) or LABORATORY_SPREAD[name] * (abs(value) or usual)
    low, high = max(least, value - _SIGMAS * sigma), min(most, value + _SIGMAS * sigma)
    return _parameter(name, (label, label, letter(name)), unit, value, value, (low, high), (least, most), prior.source)


def _entry(key: str, wheel: Wheel, reading: Reading, reasons: Mapping[str, str]) -> dict[str, Any]:
    effect = EFFECTS[key]
    why_not = reasons.get(effect.name, "")
    if effect.reading not in ("any", reading):
        why_not = f"it is defined for --sinkage {effect.reading} only"
    return {
        "key": key,
        "name": effect.name,
        "family": effect.name,
        "form": effect.form,
        "kind": effect.kind,
        "summary": effect.summary,
        "parameters": [_of_effect(effect.parameter_keys()[p.name], p, wheel) for p in effect.parameters],
        "can": not why_not,
        "why_not": why_not,
    }


def _of_effect(key: str, parameter: EffectParameter, wheel: Wheel) -> dict[str, Any]:
    neutral, reach = parameter.neutral, _SIGMAS * parameter.scale(wheel)
    low, high = max(parameter.lower, neutral - reach), min(parameter.upper, neutral + reach)
    if parameter.side > 0:
        low = max(low, min(neutral, high))
    elif parameter.side < 0:
        high = min(high, max(neutral, low))
    own = parameter.name
    texts = (own.replace("_", " "), named_with_unit(own)[0], letter(own))
    bounds = (parameter.lower, parameter.upper)
    return _parameter(key, texts, parameter.unit, neutral, neutral, (low, high), bounds, parameter.source) | {
        "start": parameter.start
    }


def _parameter(
    name: str,
    texts: tuple[str, str, str],
    unit: str,
    value: float,
    neutral: float,
    slider: tuple[float, float],
    bounds: tuple[float, float],
    source: str,
) -> dict[str, Any]:
    return {
        "name": name,
        **dict(zip(("label", "words", "letter"), texts, strict=True)),
        "unit": unit,
        "value": value,
        "neutral": neutral,
        "low": slider[0],
        "high": slider[1],
        "lowest": bounds[0],
        "highest": bounds[1],
        "step": _round_step((slider[1] - slider[0]) / _STEPS),
        "source": source,
    }


def _round_step(step: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above `step`."""
    if not step > 0:
        return 0.0
    power = 10.0 ** np.floor(log10(step))
    return float(power * max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= step * (1 + 1e-9)))


@lru_cache(maxsize=16)
def _visible_in_curve(base: Base, reading: Reading) -> dict[str, bool]:
    """Return, by effect, whether a plausible size of it changes the curve of steady driving."""
    unchanged = curve_of(base, (), reading, {})
    found = {}
    for key, effect in EFFECTS.items():
        names = effect.parameter_keys()
        values = {
            names[p.name]: float(np.clip(p.neutral + p.towards(base.wheel), p.lower, p.upper))
            for p in effect.parameters
        }
        moved = curve_of(base, (key,), reading, values)
        found[key] = any(
            not np.allclose(moved[c.field], unchanged[c.field], rtol=1e-9, atol=1e-9, equal_nan=True)
            for c in OUTPUTS.values()
        )
    return found
