"""What a fit asks of its options and data before it begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.errors import ConfigError, DataError, Fault, nearest
from model.effects import EFFECTS, Effect
from model.extended import ExtendedModel
from model.fit_result import MODELS, FitOptions
from model.observations import CHANNELS, Observations
from model.soils import SOIL_PARAMETERS, Soil
from model.wheel import Wheel
from model.wheel_soil import WheelSoilModel

MIN_SAMPLES = 20
"""Driven samples of a time series below which nothing is fitted."""


def check_options(options: FitOptions) -> None:
    """Raise ConfigError for models or channels that there are not, or an extended model of another reading."""
    faults = [Fault(f"there is no model {m!r}", expected=nearest(m, MODELS)) for m in options.models if m not in MODELS]
    faults += [
        Fault(f"there is no channel {c!r} to fit", expected="dp, t", next_step="use --channels dp,t")
        for c in options.channels or ("",)
        if c not in CHANNELS
    ]
    if options.extended is not None and options.extended.reading != options.reading:
        faults.append(
            Fault(
                "the extended model is of the other reading",
                found=f"{options.extended.reading}, and the fit is {options.reading}",
                next_step=f"add --sinkage {options.extended.reading}",
            )
        )
    faults += [
        Fault(
            f"effect {key} is of the {EFFECTS[key].reading} reading only",
            found=f"the fit is {options.reading}",
            next_step=f"add --sinkage {EFFECTS[key].reading}, or leave it out",
        )
        for key in options.chosen
        if EFFECTS[key].reading not in ("any", options.reading)
    ]
    if faults:
        raise ConfigError(*faults)


def driven_samples(observations: Observations, options: FitOptions) -> Observations:
    """Return the samples that can be fitted: 0 < s <= 1, W > 0, every fitted channel measured."""
    missing = [c for c in options.channels if not np.isfinite(observations.measured(c)).any()]
    if missing and len(observations):
        raise DataError(
            *(
                Fault(
                    f"{CHANNELS[c]} was not measured",
                    next_step=f"leave {c!r} out of --channels, or give the signal a role under [signals]",
                )
                for c in missing
            )
        )
    good = (observations.slip > 0) & (observations.slip <= 1) & (observations.vertical_load_n > 0)
    for channel in options.channels:
        good &= np.isfinite(observations.measured(channel))
    return observations[good]


def check_stiffness(soil: Soil, wheel: Wheel) -> None:
    """Raise ConfigError for a soil that does not resist the wheel."""
    stiffness = soil.stiffness(wheel.width_m)
    if not stiffness > 0:
        raise ConfigError(
            Fault(
                "this soil does not resist a wheel of this width: k_c/b + k_phi is not positive",
                where=f"soil {soil.name}",
                found=f"k_c {soil.cohesive_modulus:g} N/m^(n+1), k_phi {soil.frictional_modulus:g} N/m^(n+2), "
                f"b {wheel.width_m:g} m: {stiffness:g} Pa/m^n",
                next_step="check cohesive_modulus_kn, frictional_modulus_kn and width_m",
            )
        )


def check_enough(driven: Observations, lost: int, options: FitOptions) -> None:
    """Raise DataError for too few samples; `lost` more have no answer of the model."""
    most = max(sum(len(EFFECTS[e].parameters) for e in options.effects_of(m)) for m in options.names)
    most += len(SOIL_PARAMETERS) if options.soil_prior else 0
    needed = max(4, most + 3) if driven.independent else MIN_SAMPLES
    if len(driven) >= needed:
        return
    found = f"{len(driven)} usable samples with s > 0"
    if lost:
        found += f"; {lost} more whose load this soil and wheel do not carry above the axle"
    raise DataError(
        Fault(
            "too few driven samples to fit",
            found=found,
            expected=f"at least {needed}",
            next_step="check wheel, soil and units" if lost else "see `wheelsoil process` for why samples are left out",
        )
    )


def answered_by_extended(
    wheel: Wheel, driven: Observations, extended: ExtendedModel, answered: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which samples the extended model has an answer for, with the values it comes with."""
    effects = [EFFECTS[effect.key] for effect in extended.effects]
    _check_needs(driven, effects, "take another --model")
    model = WheelSoilModel(wheel, extended.soil, effects, extended.reading)
    found = np.isfinite(model.predict(driven.conditions, extended.values).drawbar_pull_n)
    if answered.any() and not (found & answered).any():
        raise DataError(
            Fault(
                "the extended model has no answer for any sample",
                found=", ".join(effect.key() for effect in effects) or "no effects",
                next_step="check that it is of this wheel and soil",
            )
        )
    return found


def check_chosen(driven: Observations, chosen: Sequence[str]) -> None:
    """Raise DataError for an effect that a person chose and these data cannot tell."""
    _check_needs(driven, [EFFECTS[key] for key in chosen], "leave the effect out")


def _check_needs(driven: Observations, effects: Sequence[type[Effect]], instead: str) -> None:
    lacking = [
        Fault(
            f"effect {effect.key()} needs {name}, which these data do not have",
            next_step=f"give it (runs.toml, or the signal's role under [signals]), or {instead}",
        )
        for effect in effects
        for name in effect.needs
        if len(driven) and not np.isfinite(getattr(driven.conditions, name)).any()
    ]
    if lacking:
        raise DataError(*lacking)
