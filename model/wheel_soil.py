"""WheelSoilModel: Wong's model of a rigid wheel on soil, and what effects change of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daq.errors import ConfigError, Fault, nearest
from model import sinkage as sinkages
from model.contact import Patch, Quadrature, Resultants, entry_angle, resultants
from model.dual import Dual, Number, column, rows, value_of, where
from model.effects.base import Effect
from model.soils import Soil
from model.stresses import speed_ratio
from model.wheel import Wheel

FloatArray = NDArray[np.float64]
Reading = Literal["balanced", "literal"]
"""How the slip-sinkage laws are read (docs/decisions/sinkage-readings.md)."""

SOIL_PARAMETERS = (
    "cohesion_pa",
    "tan_phi",
    "shear_modulus_m",
    "sinkage_exponent",
    "cohesive_modulus",
    "frictional_modulus",
)
WHEEL_PARAMETERS = ("radius_m", "width_m")
INPUTS = ("slip", "vertical_load_n")


@dataclass(frozen=True)
class Conditions:
    """What the wheel is put through.

    Attributes
    ----------
    slip : array, shape (n,)
        Eq. 6 when driving, (r omega - V)/V when braking.
    vertical_load_n : array, shape (n,), > 0
    """

    slip: Number
    vertical_load_n: Number

    @property
    def driving_slip(self) -> Number:
        """max(s, 0): the slip-sinkage laws hold for a driven wheel."""
        return where(value_of(self.slip) > 0.0, self.slip, 0.0)


@dataclass(frozen=True)
class SoilState:
    """The soil's parameters under given conditions, as columns or scalars in SI units."""

    cohesion: Number
    tan_phi: Number
    shear_modulus: Number
    exponent: Number
    cohesive_modulus: Number
    frictional_modulus: Number


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
    entry_angle_rad : theta_1
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
    wheel : Wheel
    soil : Soil
    effects : sequence of Effect classes or instances
    reading : "balanced" or "literal"
        balanced: static sinkage from Eq. 7; where an effect moves the sinkage, the normal stress is scaled so that
        Eq. 7 returns the measured load. literal: the paper's, static sinkage from Eq. 10 and no scaling.
    quadrature : Quadrature, optional

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
        self.effects = tuple(e() if isinstance(e, type) else e for e in effects)
        self.reading: Reading = reading
        self.quadrature = quadrature or Quadrature()
        names = [p.name for e in self.effects for p in e.parameters]
        if len(set(names)) != len(names):
            raise ConfigError(Fault("two effects share a parameter", found=", ".join(names)))
        self._defaults: dict[str, float] = {
            **{name: float(getattr(soil, name)) for name in SOIL_PARAMETERS},
            "radius_m": wheel.radius_m,
            "width_m": wheel.width_m,
            **{p.name: p.neutral for e in self.effects for p in e.parameters},
        }

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names that `predict` takes: the soil's, the wheel's and the effects'."""
        return tuple(self._defaults)

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
        values : mapping, optional
            Parameters that differ from the soil's, the wheel's or an effect's neutral value.
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
        slip, load = np.asarray(conditions.slip, float), np.asarray(conditions.vertical_load_n, float)
        valid = np.isfinite(slip) & np.isfinite(load) & (load > 0) & (np.abs(slip) <= 1)
        for given in (sinkage_m, static_sinkage_m):
            if given is not None:
                valid &= np.isfinite(given) & (np.asarray(given) > 0)
        chosen = Conditions(*(_seeded(x[valid], name, wrt) for x, name in ((slip, "slip"), (load, "vertical_load_n"))))
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
        parameters : mapping
            A value for every name of `parameter_names`.
        given : column (n, 1), optional
            The total sinkage, where it is not the model's to find.
        static : column (n, 1), optional
            The static sinkage, where it is known already.
        """
        active = [e for e in self.effects if e.is_active(parameters)]
        soil = SoilState(*(parameters[name] for name in SOIL_PARAMETERS))
        for effect in active:
            soil = effect.soil(soil, conditions, parameters)
        radius, width = parameters["radius_m"], parameters["width_m"]
        patch = Patch(
            entry_angle=np.nan,
            speed_ratio=speed_ratio(conditions.slip),
            radius=radius,
            width=width,
            cohesion=soil.cohesion,
            tan_phi=soil.tan_phi,
            shear_modulus=soil.shear_modulus,
            stiffness=soil.cohesive_modulus / width + soil.frictional_modulus,
            exponent=soil.exponent,
        )
        if given is not None:
            static = total = given
        else:
            static = self._static(patch, soil, conditions) if static is None else static
            total = static
            for effect in active:
                total = effect.sinkage(total, conditions, parameters)
        forces = self._resultants(patch, total)
        moved = given is not None or any(e.moves_sinkage() for e in active)
        scale: Number = 1.0
        if moved and self.reading == "balanced":
            scale = (conditions.vertical_load_n - forces.load_cohesion) / forces.load_stress
            scale = where(value_of(scale) > 0.0, scale, np.nan)
        return {
            "static_sinkage_m": static,
            "sinkage_m": total,
            "entry_angle_rad": entry_angle(total, radius),
            "vertical_load_n": forces.load(scale),
            "drawbar_pull_n": forces.pull(scale),
            "driving_torque_nm": forces.torque(scale),
            "stress_scale": scale,
        }

    def _resultants(self, patch: Patch, total: Number) -> Resultants:
        return resultants(replace(patch, entry_angle=entry_angle(total, patch.radius)), self.quadrature)

    def _static(self, patch: Patch, soil: SoilState, conditions: Conditions) -> Number:
        closed = sinkages.closed_form(
            conditions.vertical_load_n,
            patch.radius,
            patch.width,
            soil.cohesive_modulus,
            soil.frictional_modulus,
            soil.exponent,
        )
        return closed if self.reading == "literal" else self._balanced(patch, conditions, closed)

    def _balanced(self, patch: Patch, conditions: Conditions, start: Number) -> Number:
        """Solve Eq. 7 for the sinkage, with derivatives where there are any."""
        load = conditions.vertical_load_n
        plain = patch.map(value_of)
        n = len(value_of(load))

        def load_of(z: FloatArray, index: NDArray[np.intp]) -> FloatArray:
            part = plain if len(index) == n else plain.map(lambda x: rows(x, n, index))
            return np.asarray(self._resultants(part, z).load())

        def full(x: Number) -> FloatArray:
            return np.broadcast_to(np.asarray(value_of(x), float), (n, 1))

        solved = sinkages.balanced(full(load), full(start), full(patch.radius), full(patch.exponent), load_of)
        numbers = [load, *(getattr(patch, name) for name in patch.__dataclass_fields__)]
        if not any(isinstance(x, Dual) or np.iscomplexobj(x) for x in numbers):
            return solved
        slope = self._resultants(plain, Dual(solved, {"Z": 1.0})).load().partials["Z"]
        return sinkages.differentiate(solved, load, self._resultants(patch, solved).load(), slope)

    def _parameters(self, values: Mapping[str, Number], wrt: Sequence[str]) -> dict[str, Number]:
        unknown = [name for name in values if name not in self._defaults]
        unknown += [name for name in wrt if name not in self._defaults and name not in INPUTS]
        if unknown:
            raise ConfigError(
                *(Fault(f"the model has no parameter {n!r}", expected=nearest(n, self._defaults)) for n in unknown)
            )
        parameters: dict[str, Number] = {**self._defaults, **values}
        return {k: Dual(v, {k: 1.0}) if k in wrt else v for k, v in parameters.items()}


def _seeded(x: FloatArray, name: str, wrt: Sequence[str]) -> Number:
    return Dual(x[:, None], {name: 1.0}) if name in wrt else column(x)


def _scatter(columns: Mapping[str, Number], valid: NDArray[np.bool_], wrt: Sequence[str]) -> Prediction:
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
