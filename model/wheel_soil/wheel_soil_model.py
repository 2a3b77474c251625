"""WheelSoilModel: Wong's model of a rigid wheel on soil, and what effects change of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from daq import BoolArray, ConfigError, Fault, FloatArray, nearest
from model.effects.base import Effect
from model.wheel_soil import SOIL_PARAMETERS, Conditions, Quadrature, Reaction, Soil, Wheel, WheelState
from model.wheel_soil.balance import Active, Contact, Solution, solve
from model.wheel_soil.dual import Dual, Number, column, value_of

Reading = Literal["balanced", "literal"]
"""How the slip-sinkage laws are read (docs/decisions/sinkage-readings.md)."""

INPUTS = ("slip", "vertical_load_n")
_BLOCK = 1 << 16
"""Samples at once: a long run's temporaries stay small."""


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives by one parameter, each of shape (n,), in the quantity's unit per unit of the parameter."""

    sinkage_m: FloatArray
    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray


@dataclass(frozen=True)
class Prediction:
    """What the model says; arrays of shape (n,), NaN where it has no answer.

    Attributes
    ----------
    static_sinkage_m, sinkage_m : Z0 and Z
    vertical_load_n : Eq. 7 for that sinkage
    drawbar_pull_n, driving_torque_nm : Eq. 8 and 9
    stress_scale : factor on the normal stress that returns the measured load (1 in the literal reading)
    sensitivities : mapping parameter name -> Sensitivity
    """

    static_sinkage_m: FloatArray
    sinkage_m: FloatArray
    entry_angle_rad: FloatArray
    vertical_load_n: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    stress_scale: FloatArray
    sensitivities: dict[str, Sensitivity]


class WheelSoilModel:
    """Wong's model (Eq. 1-10) with any effects.

    Parameters
    ----------
    effects : sequence of Effect classes or instances
        In any order; they are taken by their `stage`.
    reading : "balanced" or "literal"
        balanced: static sinkage from Eq. 7; where an effect moves the sinkage, the normal stress is scaled so that
        Eq. 7 returns the measured load. literal: the paper's, static sinkage from Eq. 10 and no scaling.

    Raises
    ------
    ConfigError
        Two effects share a parameter's name.

    Notes
    -----
    Source: Wong, Theory of Ground Vehicles (2008); Yang et al. (2016), Eq. 1-13.
    """

    def __init__(
        self,
        wheel: Wheel,
        soil: Soil,
        effects: Sequence[Effect | type[Effect]] = (),
        reading: Reading = "balanced",
        quadrature: Quadrature | None = None,
    ) -> None:
        self.wheel = wheel
        self.soil = soil
        self.effects = tuple(sorted((e() if isinstance(e, type) else e for e in effects), key=lambda e: e.stage))
        self.reading: Reading = reading
        self.quadrature = quadrature or Quadrature()
        names = [name for e in self.effects for name in e.parameter_keys().values()]
        if len(set(names)) != len(names):
            raise ConfigError.of("two effects share a parameter", found=", ".join(names))
        self._defaults: dict[str, float] = {
            **{name: float(getattr(soil, name)) for name in SOIL_PARAMETERS},
            "radius_m": wheel.radius_m,
            "width_m": wheel.width_m,
            **{
                key: p.neutral
                for e in self.effects
                for key, p in zip(e.parameter_keys().values(), e.parameters, strict=True)
            },
        }

    def predict(
        self,
        conditions: Conditions,
        values: Mapping[str, Number] | None = None,
        wrt: Sequence[str] = (),
        sinkage_m: FloatArray | None = None,
        static_sinkage_m: FloatArray | None = None,
    ) -> Prediction:
        """Predict load, drawbar pull, torque and sinkage.

        Parameters
        ----------
        conditions : Conditions
            Arrays of shape (n,); a sample with NaN, a slip outside -1..1 or a load <= 0 gives NaN.
        values : parameters that differ from the soil's, the wheel's or an effect's neutral value
        wrt : sequence of str
            Differentiate by these parameters, or by the inputs ``slip`` and ``vertical_load_n``.
        sinkage_m : array, shape (n,), optional
            A given total sinkage instead of the static one; effects then do not move it.
        static_sinkage_m : array, shape (n,), optional
            Z0, where it is known already: for effects that leave it alone it need not be solved for again. No
            derivative passes through it.

        Raises
        ------
        ConfigError
            An unknown parameter.
        """
        parameters = self._parameters(values or {}, wrt)
        count = max(np.size(conditions.slip), np.size(conditions.vertical_load_n))
        parts = []
        for start in range(0, max(count, 1), _BLOCK):
            rows = slice(start, start + _BLOCK)
            given = (None if x is None else np.asarray(x)[rows] for x in (sinkage_m, static_sinkage_m))
            parts.append(self._predict(conditions.rows(rows), parameters, wrt, *given))
        return _joined(parts)

    def _predict(
        self,
        conditions: Conditions,
        parameters: Mapping[str, Number],
        wrt: Sequence[str],
        sinkage_m: FloatArray | None,
        static_sinkage_m: FloatArray | None,
    ) -> Prediction:
        """Return what `predict` does, of some samples."""
        slip, load = (np.asarray(x, float) for x in (conditions.slip, conditions.vertical_load_n))
        valid = np.isfinite(slip) & np.isfinite(load) & (load > 0) & (np.abs(slip) <= 1)
        for given in (sinkage_m, static_sinkage_m):
            if given is not None:
                valid &= np.isfinite(given) & (np.asarray(given) > 0)
        chosen = conditions.map(lambda x: column(np.asarray(x, float)[valid]) if np.ndim(x) else x)
        seeds = {name: Dual(getattr(chosen, name), {name: 1.0}) for name in INPUTS if name in wrt}
        chosen = replace(chosen, **seeds)
        total, static = (
            None if x is None else np.asarray(x, float)[valid][:, None] for x in (sinkage_m, static_sinkage_m)
        )
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            columns = self.evaluate(chosen, parameters, total, static) if valid.any() else {}
        return _scatter(columns, valid, wrt)

    def evaluate(
        self,
        conditions: Conditions,
        parameters: Mapping[str, Number],
        given: Number | None = None,
        static: Number | None = None,
    ) -> dict[str, Number]:
        """Return the prediction as columns of any `Number` kind; `predict` is the door for everybody else.

        Parameters
        ----------
        conditions : Conditions
            Columns of shape (n, 1), valid samples only.
        parameters : a value for every parameter of the soil, the wheel and the effects
        given : column (n, 1), optional
            The total sinkage, where it is not the model's to find.
        static : column (n, 1), optional
            The static sinkage, where it is known already.
        """
        active = self._active(parameters)
        for effect, values in reversed(active):
            conditions = effect.inputs(conditions, values)
        soil, radius = self.soil.state(parameters), parameters["radius_m"]
        for effect, values in active:
            soil = effect.soil(soil, conditions, values)
            radius = effect.contact_radius(radius, conditions, values)
        contact = Contact(soil, radius, parameters["width_m"], conditions, active, self.quadrature)
        solution = self._solution(contact, given, static)
        state = WheelState(conditions, soil, radius, contact.width, solution.sinkage, solution.entry_angle)
        reaction = _read(active, Reaction(solution.drawbar_pull, solution.driving_torque), state)
        return {
            "static_sinkage_m": solution.static_sinkage,
            "sinkage_m": solution.sinkage,
            "entry_angle_rad": solution.entry_angle,
            "vertical_load_n": solution.vertical_load,
            "drawbar_pull_n": reaction.drawbar_pull,
            "driving_torque_nm": reaction.driving_torque,
            "stress_scale": solution.stress_scale,
        }

    def at_rest(
        self,
        conditions: Conditions,
        values: Mapping[str, Number] | None = None,
        wrt: Sequence[str] = (),
        applied: Reaction | None = None,
    ) -> tuple[Number, Number]:
        """Return the drawbar pull (N) and the torque (N m) that the transducer shows while the wheel stands.

        Parameters
        ----------
        conditions : Conditions
            Load, direction and time of each standstill, shape (n,); the slip is not used.
        values, wrt
            As for `predict`; the results are `Dual` where `wrt` is given.
        applied : Reaction, optional
            Known pull and torque on the wheel, shape (n,): all that is wrong with the transducer shows then.

        Raises
        ------
        ConfigError
            An unknown parameter.
        """
        parameters = self._parameters(values or {}, wrt)
        active = tuple(
            (effect, own)
            for effect, own in self._active(parameters)
            if effect.at_standstill or (applied is not None and effect.kind == "measurement")
        )
        state = WheelState(
            conditions, self.soil.state(parameters), parameters["radius_m"], parameters["width_m"], np.nan, np.nan
        )
        nothing = np.zeros(np.shape(conditions.vertical_load_n))
        reaction = _read(active, applied or Reaction(nothing, nothing), state)
        return reaction.drawbar_pull, reaction.driving_torque

    def slip_beyond(
        self, conditions: Conditions, values: Mapping[str, Number] | None = None, wrt: Sequence[str] = ()
    ) -> Number:
        """Return by how much the measured slip is larger than the true one: what a wheel without slip shows.

        Parameters
        ----------
        conditions, values, wrt
            As for `at_rest`; where the wheel stands there is none (NaN).

        Raises
        ------
        ConfigError
            An unknown parameter.
        """
        true, parameters = conditions, self._parameters(values or {}, wrt)
        with np.errstate(invalid="ignore", divide="ignore"):
            for effect, own in reversed(self._active(parameters)):
                true = effect.inputs(true, own)
        return conditions.slip - true.slip

    def _active(self, parameters: Mapping[str, Number]) -> Active:
        """Return the effects that are not at their neutral values, each with its own parameters."""
        own = [(e, {name: parameters[key] for name, key in e.parameter_keys().items()}) for e in self.effects]
        return tuple((effect, values) for effect, values in own if effect.is_active(values))

    def _solution(self, contact: Contact, given: Number | None, static: Number | None) -> Solution:
        """Solve in the model's reading, or in a mixture of both where an effect says so."""
        share: Number = 1.0 if self.reading == "balanced" else 0.0
        for effect, values in contact.effects:
            share = effect.load_consistency(share, values)
        if isinstance(share, float) and share in (0.0, 1.0):
            return solve(contact, given, static, balanced=share == 1.0)
        literal, balanced = (solve(contact, given, static, balanced=which) for which in (False, True))
        return Solution(*((1.0 - share) * a + share * b for a, b in zip(literal, balanced, strict=True)))

    def _parameters(self, values: Mapping[str, Number], wrt: Sequence[str]) -> dict[str, Number]:
        unknown = [name for name in values if name not in self._defaults]
        unknown += [name for name in wrt if name not in self._defaults and name not in INPUTS]
        if unknown:
            raise ConfigError(
                *(Fault(f"the model has no parameter {n!r}", expected=nearest(n, self._defaults)) for n in unknown)
            )
        parameters: dict[str, Number] = {**self._defaults, **values}
        return {k: Dual(v, {k: 1.0}) if k in wrt else v for k, v in parameters.items()}


def _joined(parts: list[Prediction]) -> Prediction:
    if len(parts) == 1:
        return parts[0]
    names = [name for name in Prediction.__dataclass_fields__ if name != "sensitivities"]
    fields = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    sensitivities = {
        key: Sensitivity(
            **{
                name: np.concatenate([getattr(part.sensitivities[key], name) for part in parts])
                for name in Sensitivity.__dataclass_fields__
            }
        )
        for key in parts[0].sensitivities
    }
    return Prediction(**fields, sensitivities=sensitivities)


def _read(active: Active, reaction: Reaction, state: WheelState) -> Reaction:
    """Return what the transducer reads: first what else acts on it, then what it makes of that."""
    for effect, values in active:
        reaction = effect.resultants(reaction, state, values)
    for effect, values in active:
        reaction = effect.observation(reaction, state, values)
    return reaction


def _scatter(columns: Mapping[str, Number], valid: BoolArray, wrt: Sequence[str]) -> Prediction:
    def spread(x: Number) -> FloatArray:
        out = np.full(valid.shape, np.nan)
        out[valid] = np.broadcast_to(x, (int(valid.sum()), 1))[:, 0]
        return out

    def partial(name: str, parameter: str) -> FloatArray:
        x = columns.get(name, np.nan)
        return spread(x.partials.get(parameter, 0.0) if isinstance(x, Dual) else x * 0.0)

    names = [f for f in Prediction.__dataclass_fields__ if f != "sensitivities"]
    fields = {name: spread(value_of(columns.get(name, np.nan))) for name in names}
    for name in names:
        if name != "stress_scale":
            fields[name][~np.isfinite(fields["drawbar_pull_n"])] = np.nan
    sensitivities = {
        p: Sensitivity(**{name: partial(name, p) for name in Sensitivity.__dataclass_fields__}) for p in wrt
    }
    return Prediction(**fields, sensitivities=sensitivities)
