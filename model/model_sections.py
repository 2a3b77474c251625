"""Sections of a model file as they are written, each checked by itself."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan, nan
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from model.diagnosis.core.result import ParameterEstimate
from model.wheel_soil.soils import REFERENCE_SPEED_MPS, SOIL_PARAMETERS, Soil
from model.wheel_soil.wheel_soil_model import Reading

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


def soil_with(
    name: str, values: Mapping[str, float], unit_weight_n_m3: float, source: str, reference_speed_mps: float
) -> Soil:
    """Return the soil of these values of `SOIL_PARAMETERS`."""
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


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class _WheelSection(_Section):
    radius_m: Positive
    width_m: Positive
    tyre: Literal["smooth", "lugged", ""] = ""


class _NamedWheel(_WheelSection):
    id: Annotated[str, Field(min_length=1)]


class VehicleWheels(_Section):
    """Wheels of a file of all wheels of a vehicle."""

    wheel: tuple[_NamedWheel, ...] = Field(min_length=2)


class SoilValues(_Section):
    """Values of `SOIL_PARAMETERS`."""

    cohesion_pa: NonNegative
    tan_phi: NonNegative
    shear_modulus_m: Positive
    sinkage_exponent: Positive
    cohesive_modulus: Finite
    frictional_modulus: Finite

    def values(self) -> dict[str, float]:
        """Return them by name."""
        return {name: float(getattr(self, name)) for name in SOIL_PARAMETERS}


class _SoilSection(SoilValues):
    name: str
    source: str = ""
    unit_weight_n_m3: Positive = 16_500.0
    reference_speed_mps: Positive = REFERENCE_SPEED_MPS

    def soil(self) -> Soil:
        return soil_with(self.name, self.values(), self.unit_weight_n_m3, self.source, self.reference_speed_mps)


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


class EffectSection(_Section):
    """A cause with its parameters; `wheel` is the id of the only one where it acts."""

    name: str
    form: str = ""
    wheel: str = ""
    parameter: tuple[_ParameterSection, ...] = ()
    combination: tuple[_ParameterSection, ...] = ()


class CovarianceSection(_Section):
    """Covariance of a set's parameters, in the order of `names`."""

    names: tuple[str, ...] = ()
    rows: tuple[tuple[Finite, ...], ...] = ()


class SetSection(_Section):
    """A set of causes with the soil that was fitted beside them."""

    probability: Probability
    soil: SoilValues
    effect: tuple[EffectSection, ...] = ()
    covariance: CovarianceSection = CovarianceSection()


class _File(_Section):
    reading: Reading = "balanced"
    wheel: _WheelSection
    soil: _SoilSection
    provenance: dict[str, str | float | tuple[str, ...] | tuple[tuple[str, str, str], ...]] = {}


class OneModelFile(_File):
    """A file with one model: the named causes, or none."""

    schema_: Literal["wheelsoil/model/1"] = Field(alias="schema")
    soil_sigmas: dict[str, NonNegative] = {}
    effect: tuple[EffectSection, ...] = ()


class AverageFile(_File):
    """A file with the sets of causes that remain possible; `soil` is the laboratory's."""

    schema_: Literal["wheelsoil/model/2"] = Field(alias="schema")
    rest_probability: Probability = 0.0
    set: tuple[SetSection, ...] = Field(min_length=1)
