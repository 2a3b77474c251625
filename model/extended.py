"""The extended model as a value: the soil, the causes that were found, and where they come from.

What a diagnosis leaves behind for `fit`, `simulate` and `report`. `ExtendedModel.to_mapping` holds only what TOML and
JSON can hold; a number that is not known is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import atan, inf, isfinite, nan
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from daq import ConfigError, Fault, nearest, parse_mapping
from model.diagnosis.core.result import Cause, ParameterEstimate, SoilEstimate
from model.effects.catalogue import EFFECTS
from model.wheel_soil.conditions import Conditions, Wheel
from model.wheel_soil.soils import REFERENCE_SPEED_MPS, SOIL_PARAMETERS, Soil
from model.wheel_soil.wheel_soil_model import Prediction, Reading, WheelSoilModel

SCHEMA = "wheelsoil/model/1"
Fact = str | float | tuple[str, ...]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class ExtendedEffect:
    """A cause in the model.

    Attributes
    ----------
    key : of the effect in the library
    parameters : tuple of ParameterEstimate
        Every parameter of the effect; sigma and interval are NaN where there is none.
    combinations : tuple of ParameterEstimate
        What the data determine of several of them together, as Lyasko's p = m1 + m2; for people, not for the model.
    """

    key: str
    parameters: tuple[ParameterEstimate, ...]
    combinations: tuple[ParameterEstimate, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Parameters by the names that a model takes."""
        return EFFECTS[self.key].keyed({p.name: p.value for p in self.parameters})


@dataclass(frozen=True)
class ExtendedModel:
    """A wheel on a soil with the causes that a diagnosis found; `model` makes it calculate.

    Attributes
    ----------
    tyre : "smooth", "lugged" or ""
    soil : Soil
        As the data leave it.
    soil_sigmas : mapping name of `SOIL_PARAMETERS` -> one-sigma
    reading : "balanced" or "literal"
    provenance : mapping str -> str, float or tuple of str
        Where it comes from: runs, verdict, probability, gain.
    """

    wheel: Wheel
    soil: Soil
    effects: tuple[ExtendedEffect, ...] = ()
    reading: Reading = "balanced"
    tyre: str = ""
    soil_sigmas: dict[str, float] = field(default_factory=dict)
    provenance: dict[str, Fact] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """The effects' parameters by the names that a model takes."""
        return {name: value for effect in self.effects for name, value in effect.values.items()}

    def model(self, kind: Literal["all", "physical"] = "all") -> WheelSoilModel:
        """Return the model; "physical" leaves out what belongs to the sensors of those runs and not to the soil."""
        return WheelSoilModel(self.wheel, self.soil, [EFFECTS[e.key] for e in self._chosen(kind)], self.reading)

    def predict(self, conditions: Conditions, kind: Literal["all", "physical"] = "all") -> Prediction:
        """Return what the model says, at its own values; see `WheelSoilModel.predict`."""
        values = {name: value for effect in self._chosen(kind) for name, value in effect.values.items()}
        return self.model(kind).predict(conditions, values)

    def _chosen(self, kind: str) -> tuple[ExtendedEffect, ...]:
        return tuple(e for e in self.effects if kind in ("all", EFFECTS[e.key].kind))

    def to_mapping(self) -> dict[str, Any]:
        """Return what a TOML or JSON file holds."""
        return {
            "schema": SCHEMA,
            "reading": self.reading,
            "wheel": {"radius_m": self.wheel.radius_m, "width_m": self.wheel.width_m, "tyre": self.tyre},
            "soil": {
                "name": self.soil.name,
                "source": self.soil.source,
                "unit_weight_n_m3": self.soil.unit_weight_n_m3,
                "reference_speed_mps": self.soil.reference_speed_mps,
                **{name: float(getattr(self.soil, name)) for name in SOIL_PARAMETERS},
            },
            "soil_sigmas": _finite(self.soil_sigmas),
            "effect": [
                {
                    "name": EFFECTS[e.key].name,
                    "form": EFFECTS[e.key].form,
                    "parameter": [_parameter(p) for p in e.parameters],
                    **({"combination": [_parameter(p) for p in e.combinations]} if e.combinations else {}),
                }
                for e in self.effects
            ],
            "provenance": {k: list(v) if isinstance(v, tuple) else v for k, v in self.provenance.items()},
        }

    @staticmethod
    def from_mapping(raw: Mapping[str, Any], where: str = "model file") -> ExtendedModel:
        """Build the model from what a file holds.

        Parameters
        ----------
        where : name of the file, for messages

        Raises
        ------
        ConfigError
            Lists every fault at once: unknown keys, effects and parameters, values outside their bounds.
        """
        file = parse_mapping(raw, _File, where)
        faults: list[Fault] = []
        effects = tuple(_effect(section, where, faults) for section in file.effect)
        keys = [e.key for e in effects if e]
        faults += [Fault(f"{key!r} is there twice", where) for key in dict.fromkeys(keys) if keys.count(key) > 1]
        unknown = [name for name in file.soil_sigmas if name not in SOIL_PARAMETERS]
        faults += [
            Fault(f"the soil has no parameter {n!r}", where, expected=nearest(n, SOIL_PARAMETERS)) for n in unknown
        ]
        if faults:
            raise ConfigError(*faults)
        return ExtendedModel(
            wheel=Wheel(file.wheel.radius_m, file.wheel.width_m),
            soil=file.soil.soil(),
            effects=tuple(e for e in effects if e),
            reading=file.reading,
            tyre=file.wheel.tyre,
            soil_sigmas=file.soil_sigmas,
            provenance=file.provenance,
        )


def extended_model(
    wheel: Wheel,
    laboratory: Soil,
    soil: SoilEstimate,
    causes: tuple[Cause, ...],
    reading: Reading = "balanced",
    *,
    tyre: str = "",
    provenance: Mapping[str, Fact] | None = None,
) -> ExtendedModel:
    """Build the extended model of one campaign from what a diagnosis says.

    A parameter that a cause does not state is neutral; a soil without values stays the laboratory's, source and all.
    """
    return ExtendedModel(
        wheel=wheel,
        soil=soil_of(laboratory, soil.values, f"re-calibrated with {soil.campaign}") if soil.values else laboratory,
        effects=tuple(_extended(cause) for cause in causes),
        reading=reading,
        tyre=tyre,
        soil_sigmas=_finite(soil.sigmas),
        provenance=dict(provenance or {}),
    )


def soil_of(laboratory: Soil, values: Mapping[str, float], source: str) -> Soil:
    """Return the soil with other values of `SOIL_PARAMETERS`; what is not given stays."""
    found = {name: float(getattr(laboratory, name)) for name in SOIL_PARAMETERS} | dict(values)
    return _soil(laboratory.name, found, laboratory.unit_weight_n_m3, source, laboratory.reference_speed_mps)


def _soil(
    name: str, values: Mapping[str, float], unit_weight_n_m3: float, source: str, reference_speed_mps: float
) -> Soil:
    plain = {key: value for key, value in values.items() if key != "tan_phi"}
    angle = atan(values["tan_phi"])
    return Soil(
        name,
        friction_angle_rad=angle,
        unit_weight_n_m3=unit_weight_n_m3,
        source=source,
        reference_speed_mps=reference_speed_mps,
        **plain,
    )


def _extended(cause: Cause) -> ExtendedEffect:
    own = {p.name for p in EFFECTS[cause.key].parameters}
    return ExtendedEffect(
        cause.key,
        _all_parameters(cause.key, cause.parameters),
        tuple(p for p in cause.parameters if p.name not in own),
    )


def _all_parameters(key: str, stated: Iterable[ParameterEstimate]) -> tuple[ParameterEstimate, ...]:
    """Return every parameter of an effect; one that is not stated is neutral."""
    known = {p.name: p for p in stated}
    neutral = [ParameterEstimate(p.name, p.unit, p.neutral, (nan, nan), nan) for p in EFFECTS[key].parameters]
    return tuple(known.get(p.name, p) for p in neutral)


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if isfinite(value)}


def _parameter(estimate: ParameterEstimate) -> dict[str, Any]:
    found: dict[str, Any] = {"name": estimate.name, "unit": estimate.unit, "value": estimate.value}
    if isfinite(estimate.sigma):
        found["sigma"] = estimate.sigma
    if all(isfinite(edge) for edge in estimate.interval95):
        found["interval95"] = list(estimate.interval95)
    return found


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _WheelSection(_Section):
    radius_m: Positive
    width_m: Positive
    tyre: Literal["smooth", "lugged", ""] = ""


class _SoilSection(_Section):
    name: str
    source: str = ""
    unit_weight_n_m3: Positive = 16_500.0
    reference_speed_mps: Positive = REFERENCE_SPEED_MPS
    cohesion_pa: NonNegative
    tan_phi: NonNegative
    shear_modulus_m: Positive
    sinkage_exponent: Positive
    cohesive_modulus: Finite
    frictional_modulus: Finite

    def soil(self) -> Soil:
        values = {name: getattr(self, name) for name in SOIL_PARAMETERS}
        return _soil(self.name, values, self.unit_weight_n_m3, self.source, self.reference_speed_mps)


class _ParameterSection(_Section):
    name: str
    unit: str = ""
    value: Finite
    sigma: NonNegative | None = None
    interval95: tuple[Finite, Finite] | None = None

    def estimate(self) -> ParameterEstimate:
        return ParameterEstimate(
            self.name,
            self.unit,
            self.value,
            self.interval95 or (nan, nan),
            nan if self.sigma is None else self.sigma,
        )


class _EffectSection(_Section):
    name: str
    form: str = ""
    parameter: tuple[_ParameterSection, ...] = ()
    combination: tuple[_ParameterSection, ...] = ()


class _File(_Section):
    schema_: Literal["wheelsoil/model/1"] = Field(alias="schema")
    reading: Reading = "balanced"
    wheel: _WheelSection
    soil: _SoilSection
    soil_sigmas: dict[str, NonNegative] = {}
    effect: tuple[_EffectSection, ...] = ()
    provenance: dict[str, str | float | tuple[str, ...]] = {}


def _effect(section: _EffectSection, where: str, faults: list[Fault]) -> ExtendedEffect | None:
    """Return the effect of a section, its missing parameters neutral; add what is wrong with it to `faults`."""
    key = section.form or section.name
    effect = EFFECTS.get(key)
    if effect is None or effect.name != section.name:
        label = f"{section.name}/{section.form}" if section.form else section.name
        known = [f"{e.name}/{e.form}" if e.form else e.name for e in EFFECTS.values()]
        faults.append(Fault(f"there is no effect {label!r}", where, expected=nearest(label, known)))
        return None
    bounds = {p.name: (p.lower, p.upper) for p in effect.parameters}
    for given in section.parameter:
        low, high = bounds.get(given.name, (-inf, inf))
        if given.name not in bounds:
            faults.append(Fault(f"{key} has no parameter {given.name!r}", where, expected=nearest(given.name, bounds)))
        elif not low <= given.value <= high:
            expected = f"{low:g} to {high:g}"
            faults.append(Fault(f"{key}: {given.name} is out of bounds", where, f"{given.value:g}", expected))
    return ExtendedEffect(
        key,
        _all_parameters(key, (p.estimate() for p in section.parameter)),
        tuple(p.estimate() for p in section.combination),
    )
