"""The extended model as a value: the soil, the causes that were found, and where they come from.

What a diagnosis leaves behind for `fit`, `simulate` and `report`. Where it named its causes there is one model; where
several sets of causes remain possible, these sets with their probabilities, whose predictions are averaged. Wheels of a
vehicle that were diagnosed together have one soil, and causes that act at all of them or at one.
`ExtendedModel.to_mapping` holds only what TOML and JSON can hold; a number that is not known is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from math import inf, isclose, isfinite, nan, sqrt
from typing import Any, Literal

import numpy as np

from daq import ConfigError, Fault, nearest, parse_mapping
from model.averaged import AveragedModel, Member
from model.diagnosis.core.average import Average, FittedSet
from model.diagnosis.core.result import Cause, ParameterEstimate, SoilEstimate
from model.effects.base import Effect
from model.effects.catalogue import EFFECTS, parted
from model.model_sections import (
    AverageFile,
    CovarianceSection,
    EffectSection,
    OneModelFile,
    SetSection,
    VehicleWheels,
    soil_with,
)
from model.wheel_soil.conditions import Conditions, Wheel
from model.wheel_soil.soils import SOIL_PARAMETERS, Soil
from model.wheel_soil.wheel_soil_model import Prediction, Reading, WheelSoilModel

SCHEMA = "wheelsoil/model/1"
"""Of a file with one model."""
AVERAGE_SCHEMA = "wheelsoil/model/2"
"""Of a file with several sets of causes."""
VEHICLE_SCHEMA = "wheelsoil/model/3"
"""Of a file of all wheels of a vehicle, with one model or several sets."""
Fact = str | float | tuple[str, ...] | tuple[tuple[str, str, str], ...]
Which = Literal["all", "physical"]

_ROUNDING = 1e-6


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
class ModelSet:
    """A set of causes that remains possible, with the soil that was fitted beside it.

    Attributes
    ----------
    probability : float
        Of the set, among all sets that were weighed.
    soil : mapping name of `SOIL_PARAMETERS` -> value
    effects : tuple of ExtendedEffect
        Empty: no cause acts.
    names : tuple of str, p of them
        Parameters of the covariance, as a model takes them: the soil's and the effects'.
    covariance : tuple of p tuples of p float
        SI units.
    """

    probability: float
    soil: dict[str, float]
    effects: tuple[ExtendedEffect, ...] = ()
    names: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()

    @property
    def sigmas(self) -> dict[str, float]:
        """One-sigma of every parameter of the covariance."""
        return {name: sqrt(row[i]) for i, (name, row) in enumerate(zip(self.names, self.covariance, strict=True))}


@dataclass(frozen=True)
class ExtendedModel:
    """A wheel on a soil with the causes that a diagnosis found; `model` makes it calculate.

    Attributes
    ----------
    wheel, tyre : Wheel, "smooth", "lugged" or ""
        Of a vehicle those of the first wheel.
    soil : Soil
        As the data leave it; with several sets the laboratory's, since each has its own.
    soil_sigmas : mapping name of `SOIL_PARAMETERS` -> one-sigma
    reading : "balanced" or "literal"
    provenance : mapping str -> str, float or tuple
        Where it comes from: runs, verdict, probability, gain; "wheel", of one of several; "counted_from", what its
        errors of measurement count from: (wheel, name, value), the wheel empty where there is one.
    sets : tuple of ModelSet
        Where several sets of causes remain possible, most probable first; else empty.
    rest_probability : float
        Of the sets that are not listed.
    wheels : mapping wheel -> (Wheel, tyre)
        Of a vehicle, by the wheels' ids; else empty. `of_wheel` gives the model of one of them, which predicts.
    """

    wheel: Wheel
    soil: Soil
    effects: tuple[ExtendedEffect, ...] = ()
    reading: Reading = "balanced"
    tyre: str = ""
    soil_sigmas: dict[str, float] = field(default_factory=dict)
    provenance: dict[str, Fact] = field(default_factory=dict)
    sets: tuple[ModelSet, ...] = ()
    rest_probability: float = 0.0
    wheels: dict[str, tuple[Wheel, str]] = field(default_factory=dict)

    def of_wheel(self, wheel: str, where: str = "model file") -> ExtendedModel:
        """Return the model of one wheel of a vehicle: what acts at all wheels, and at it; a model of one as it is.

        Raises
        ------
        ConfigError
            The vehicle has no wheel of this id, or the model is of another wheel.
        """
        if not self.wheels and self.wheel_id in ("", wheel):
            return self
        if wheel not in self.wheels:
            raise ConfigError.of(
                f"the model is of {'the wheels of a vehicle' if self.wheels else 'another wheel'}",
                where,
                found=f"wheel {wheel}" if wheel else "a wheel without an id",
                expected=", ".join(self.wheels) or self.wheel_id,
                next_step=f"give {'their runs' if self.wheels else f'its runs (--wheel {self.wheel_id})'}, or the "
                f"model of one wheel: `wheelsoil diagnose FOLDER{f' --wheel {wheel}' if wheel else ''} -o FILE`"
                + ("" if wheel or self.wheels else "; where it is this wheel, remove `wheel` of its [provenance]"),
            )
        size, tyre = self.wheels[wheel]
        sets = tuple(_with_effects(each, _chosen(each.effects, wheel=wheel)) for each in self.sets)
        return replace(self, wheel=size, tyre=tyre, effects=_chosen(self.effects, wheel=wheel), sets=sets, wheels={})

    @property
    def wheel_id(self) -> str:
        """Id of the only wheel that it is of; empty where that has none, or there are several."""
        return str(self.provenance.get("wheel", ""))

    @property
    def values(self) -> dict[str, float]:
        """The effects' parameters by the names that a model takes; none of several sets."""
        return _values(self.effects)

    @property
    def keys(self) -> tuple[str, ...]:
        """Every effect, of all sets; the one of the most probable set first."""
        sets = [self.effects, *(model_set.effects for model_set in self.sets)]
        return tuple(dict.fromkeys(effect.key for effects in sets for effect in effects))

    def model(self, kind: Which = "all") -> WheelSoilModel:
        """Return the model, or the average of several sets.

        Parameters
        ----------
        kind : "all" or "physical"
            "physical" leaves out what belongs to the sensors of those runs and not to the soil.

        Raises
        ------
        ConfigError
            It is of a vehicle: `of_wheel` gives that of a wheel.
        """
        own = self.of_wheel(self.wheel_id)
        if not own.sets:
            return WheelSoilModel(own.wheel, own.soil, _classes(own.effects, kind), own.reading)
        return AveragedModel([own._member(model_set, kind) for model_set in own.sets if model_set.probability > 0])

    def predict(self, conditions: Conditions, kind: Which = "all") -> Prediction:
        """Return what the model says, at its own values; see `WheelSoilModel.predict`."""
        return self.model(kind).predict(conditions, _values(self.effects, kind))

    def drawn(self, rng: np.random.Generator) -> ExtendedModel:
        """Return one model: of several sets one that is drawn by its probability, physical members only."""
        if not self.sets:
            return self
        weights = np.array([model_set.probability for model_set in self.sets])
        chosen = self.sets[number := int(rng.choice(len(weights), p=weights / weights.sum()))]
        return replace(
            self,
            provenance={
                **self.provenance,
                "set": f"{number + 1} of {len(weights)} ({100 * chosen.probability:.3g} %): "
                + (" + ".join(effect.key for effect in chosen.effects) or "no cause"),
            },
            soil=soil_of(self.soil, chosen.soil, "re-calibrated"),
            effects=_chosen(chosen.effects, "physical"),
            soil_sigmas={name: sigma for name, sigma in chosen.sigmas.items() if name in SOIL_PARAMETERS},
            sets=(),
            rest_probability=0.0,
        )

    def _member(self, model_set: ModelSet, kind: Which) -> Member:
        model = WheelSoilModel(
            self.wheel, soil_of(self.soil, model_set.soil, ""), _classes(model_set.effects, kind), self.reading
        )
        own = _with_effects(model_set, _chosen(model_set.effects, kind))
        covariance = np.array(own.covariance).reshape(len(own.names), len(own.names))
        return Member(model_set.probability, model, _values(own.effects), own.names, covariance)

    def to_mapping(self) -> dict[str, Any]:
        """Return what a TOML or JSON file holds."""
        soil = {
            "name": self.soil.name,
            "source": self.soil.source,
            "unit_weight_n_m3": self.soil.unit_weight_n_m3,
            "reference_speed_mps": self.soil.reference_speed_mps,
            **{name: float(getattr(self.soil, name)) for name in SOIL_PARAMETERS},
        }
        wheels = [
            {"id": name, "radius_m": wheel.radius_m, "width_m": wheel.width_m, "tyre": tyre}
            for name, (wheel, tyre) in (self.wheels or {"": (self.wheel, self.tyre)}).items()
        ]
        provenance = {k: list(v) if isinstance(v, tuple) else v for k, v in self.provenance.items()}
        wheel = wheels if self.wheels else {name: value for name, value in wheels[0].items() if name != "id"}
        if self.sets:
            return {
                "schema": VEHICLE_SCHEMA if self.wheels else AVERAGE_SCHEMA,
                "reading": self.reading,
                "rest_probability": self.rest_probability,
                "wheel": wheel,
                "soil": soil,
                "set": [_set_mapping(model_set) for model_set in self.sets],
                "provenance": provenance,
            }
        return {
            "schema": VEHICLE_SCHEMA if self.wheels else SCHEMA,
            "reading": self.reading,
            "wheel": wheel,
            "soil": soil,
            "soil_sigmas": _finite(self.soil_sigmas),
            "effect": [_effect_mapping(e) for e in self.effects],
            "provenance": provenance,
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
            Lists every fault at once: unknown keys, effects and parameters, values outside their bounds. A file of a
            later version is refused as such.
        """
        _refuse_later(raw, where)
        found = _of_vehicle(raw, where) if raw.get("schema") == VEHICLE_SCHEMA else _of_one(raw, where)
        if foreign := [key for key in found.keys if parted(key)[1] not in ("", *found.wheels)]:
            raise ConfigError.of(
                "an effect is of no wheel of the file",
                where,
                ", ".join(foreign),
                ", ".join(found.wheels) or "no wheel: the file is of one",
                "correct `wheel` of the effect, or the id under [[wheel]]",
            )
        return found


def _refuse_later(raw: Mapping[str, Any], where: str) -> None:
    """Raise ConfigError for a file of a version that is not known yet."""
    schema = str(raw.get("schema", ""))
    version = re.fullmatch(r"wheelsoil/model/(\d+)", schema)
    if version and int(version[1]) > int(VEHICLE_SCHEMA.rpartition("/")[2]):
        raise ConfigError.of(
            "the model file is of a later version of wheelsoil",
            where,
            found=f"schema {schema}",
            expected=f"{SCHEMA} to {VEHICLE_SCHEMA}",
            next_step="update wheelsoil, or write the file again with `wheelsoil diagnose RUN... -o FILE`",
        )


def _of_one(raw: Mapping[str, Any], where: str) -> ExtendedModel:
    """Return the model of a file of one wheel; raises as `ExtendedModel.from_mapping`."""
    if raw.get("schema") == AVERAGE_SCHEMA:
        return _of_several(parse_mapping(raw, AverageFile, where), where)
    file = parse_mapping(raw, OneModelFile, where)
    faults: list[Fault] = []
    effects = _effects(file.effect, where, faults)
    unknown = [name for name in file.soil_sigmas if name not in SOIL_PARAMETERS]
    faults += [Fault(f"the soil has no parameter {n!r}", where, expected=nearest(n, SOIL_PARAMETERS)) for n in unknown]
    if faults:
        raise ConfigError(*faults)
    return ExtendedModel(
        wheel=Wheel(file.wheel.radius_m, file.wheel.width_m),
        soil=file.soil.soil(),
        effects=effects,
        reading=file.reading,
        tyre=file.wheel.tyre,
        soil_sigmas=file.soil_sigmas,
        provenance=file.provenance,
    )


def _of_vehicle(raw: Mapping[str, Any], where: str) -> ExtendedModel:
    """Return the model of a file of all wheels of a vehicle; raises as `ExtendedModel.from_mapping`."""
    sections = parse_mapping({"wheel": raw.get("wheel", ())}, VehicleWheels, where).wheel
    wheels = {section.id: (Wheel(section.radius_m, section.width_m), str(section.tyre)) for section in sections}
    if len(wheels) < len(sections):
        raise ConfigError.of(
            "a wheel is there twice",
            where,
            ", ".join(section.id for section in sections),
            next_step="restore the file as it was written",
        )
    first = {"schema": AVERAGE_SCHEMA if "set" in raw else SCHEMA, "wheel": sections[0].model_dump(exclude={"id"})}
    return replace(_of_one({**raw, **first}, where), wheels=wheels)


def _of_several(file: AverageFile, where: str) -> ExtendedModel:
    """Return the model of a file with several sets; `ConfigError` lists every fault at once."""
    faults: list[Fault] = []
    sets = [
        _set(section, f"{where}, set {i} ({100 * section.probability:.3g} %)", faults)
        for i, section in enumerate(file.set, 1)
    ]
    keys = [tuple(sorted(e.key for e in model_set.effects)) for model_set in sets]
    faults += [
        Fault("a set is there twice", where, found=", ".join(k) or "no cause")
        for k in dict.fromkeys(keys)
        if keys.count(k) > 1 and not faults
    ]
    total = file.rest_probability + sum(model_set.probability for model_set in sets)
    if not isclose(total, 1.0, abs_tol=_ROUNDING):
        what = "the probabilities of the sets and the rest do not sum to 1"
        faults.append(Fault(what, where, found=f"{total:.6g}", next_step="restore the file as it was written"))
    if not any(model_set.probability > 0 for model_set in sets):
        faults.append(Fault("no set has a probability above 0", where))
    if faults:
        raise ConfigError(*faults)
    return ExtendedModel(
        wheel=Wheel(file.wheel.radius_m, file.wheel.width_m),
        soil=file.soil.soil(),
        reading=file.reading,
        tyre=file.wheel.tyre,
        provenance=file.provenance,
        sets=tuple(sets),
        rest_probability=file.rest_probability,
    )


def _set(section: SetSection, where: str, faults: list[Fault]) -> ModelSet:
    effects = _effects(section.effect, where, faults)
    known = {*SOIL_PARAMETERS, *_values(effects)}
    if len(effects) == len(section.effect):
        faults += _covariance_faults(section.covariance, known, where)
    found = section.covariance
    return ModelSet(section.probability, section.soil.values(), effects, found.names, found.rows)


def _covariance_faults(section: CovarianceSection, known: Iterable[str], where: str) -> list[Fault]:
    names, count = section.names, len(section.names)
    faults = [
        Fault(f"the covariance is of no parameter {name!r} of this set", where, expected=nearest(name, known))
        for name in names
        if name not in known
    ]
    if len(set(names)) != count or [len(row) for row in section.rows] != [count] * count:
        rows = f"{count} names, rows of {', '.join(str(len(row)) for row in section.rows) or 'nothing'}"
        return [*faults, Fault("the covariance is no square of its names", where, found=rows)]
    matrix = np.array(section.rows).reshape(count, count)
    scale = np.sqrt(np.abs(np.diag(matrix)))
    correlation = matrix / np.outer(np.where(scale > 0, scale, 1.0), np.where(scale > 0, scale, 1.0))
    lowest = np.linalg.eigvalsh(correlation).min() if count else 0.0
    if not np.allclose(correlation, correlation.T, atol=_ROUNDING) or (np.diag(matrix) < 0).any() or lowest < -1e-4:
        expected = "symmetric, no variance or combination of them below zero"
        faults.append(Fault("the covariance is not positive semi-definite", where, expected=expected))
    return faults


def _set_mapping(model_set: ModelSet) -> dict[str, Any]:
    return {
        "probability": model_set.probability,
        "soil": dict(model_set.soil),
        "effect": [_effect_mapping(e) for e in model_set.effects],
        "covariance": {"names": list(model_set.names), "rows": [list(row) for row in model_set.covariance]},
    }


def _effect_mapping(effect: ExtendedEffect) -> dict[str, Any]:
    name, wheel = parted(EFFECTS[effect.key].name)
    return {
        "name": name,
        "form": EFFECTS[effect.key].form,
        **({"wheel": wheel} if wheel else {}),
        "parameter": [_parameter(p) for p in effect.parameters],
        **({"combination": [_parameter(p) for p in effect.combinations]} if effect.combinations else {}),
    }


def _chosen(
    effects: Iterable[ExtendedEffect], kind: Which = "all", wheel: str | None = None
) -> tuple[ExtendedEffect, ...]:
    """Return the effects of a kind; with a wheel's id those that act there."""
    of_kind = (e for e in effects if kind in ("all", EFFECTS[e.key].kind))
    return tuple(e for e in of_kind if wheel is None or parted(e.key)[1] in ("", wheel))


def _with_effects(model_set: ModelSet, effects: tuple[ExtendedEffect, ...]) -> ModelSet:
    """Return a set with some of its effects, and the covariance of the soil and of these."""
    known = {*SOIL_PARAMETERS, *_values(effects)}
    kept = [i for i, name in enumerate(model_set.names) if name in known]
    rows = tuple(tuple(model_set.covariance[i][j] for j in kept) for i in kept)
    return replace(model_set, effects=effects, names=tuple(model_set.names[i] for i in kept), covariance=rows)


def _classes(effects: Iterable[ExtendedEffect], kind: Which) -> list[type[Effect]]:
    return [EFFECTS[e.key] for e in _chosen(effects, kind)]


def _values(effects: Iterable[ExtendedEffect], kind: Which = "all") -> dict[str, float]:
    return {name: value for effect in _chosen(effects, kind) for name, value in effect.values.items()}


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


def averaged_model(
    wheel: Wheel,
    laboratory: Soil,
    average: Average,
    campaign: str,
    reading: Reading = "balanced",
    *,
    tyre: str = "",
    provenance: Mapping[str, Fact] | None = None,
) -> ExtendedModel:
    """Build the model of one campaign from the sets of causes that a diagnosis could not decide between."""
    return ExtendedModel(
        wheel=wheel,
        soil=laboratory,
        reading=reading,
        tyre=tyre,
        provenance=dict(provenance or {}),
        sets=tuple(
            _model_set(fitted, [soil.campaign for soil in fitted.soils].index(campaign)) for fitted in average.sets
        ),
        rest_probability=average.rest_probability,
    )


def _model_set(fitted: FittedSet, index: int) -> ModelSet:
    effects = [_extended(cause) for cause in fitted.causes]
    rows = tuple(tuple(map(float, row)) for row in fitted.covariances[index])
    return ModelSet(
        fitted.probability, dict(fitted.soils[index].values), tuple(map(_within_bounds, effects)), fitted.names, rows
    )


def _within_bounds(effect: ExtendedEffect) -> ExtendedEffect:
    """Return an effect whose values are no rounding error beyond their bounds."""
    bounds = {p.name: (p.lower, p.upper) for p in EFFECTS[effect.key].parameters}
    kept = (replace(p, value=min(max(p.value, bounds[p.name][0]), bounds[p.name][1])) for p in effect.parameters)
    return replace(effect, parameters=tuple(kept))


def soil_of(laboratory: Soil, values: Mapping[str, float], source: str) -> Soil:
    """Return the soil with other values of `SOIL_PARAMETERS`; what is not given stays."""
    found = {name: float(getattr(laboratory, name)) for name in SOIL_PARAMETERS} | dict(values)
    return soil_with(laboratory.name, found, laboratory.unit_weight_n_m3, source, laboratory.reference_speed_mps)


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


def _effects(sections: Iterable[EffectSection], where: str, faults: list[Fault]) -> tuple[ExtendedEffect, ...]:
    """Return the effects of one set; add what is wrong with them to `faults`."""
    effects = tuple(e for section in sections if (e := _effect(section, where, faults)))
    keys = [e.key for e in effects]
    faults += [Fault(f"{key!r} is there twice", where) for key in dict.fromkeys(keys) if keys.count(key) > 1]
    return effects


def _effect(section: EffectSection, where: str, faults: list[Fault]) -> ExtendedEffect | None:
    """Return the effect of a section, its missing parameters neutral; add what is wrong with it to `faults`."""
    key = (section.form or section.name) + (f"@{section.wheel}" if section.wheel else "")
    effect = EFFECTS.get(key)
    if effect is None or parted(effect.name)[0] != section.name:
        label = f"{section.name}/{section.form}" if section.form else section.name
        label += f" at wheel {section.wheel}" if section.wheel else ""
        known = [f"{e.name}/{e.form}" if e.form else e.name for e in EFFECTS.values()]
        step = "install the package that brings it; without it the file's predictions are not what it claims"
        faults.append(Fault(f"there is no effect {label!r}", where, expected=nearest(label, known), next_step=step))
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
