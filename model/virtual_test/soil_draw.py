"""A soil drawn from the laboratory's uncertainty: what the field really is, as against what terrain.toml says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import atan, tan

import numpy as np

from daq.errors import ConfigError, Fault, nearest
from model.soils import LABORATORY_SPREAD, Soil


def drawn_soil(soil: Soil, rng: np.random.Generator, spread: Mapping[str, float] | None = None) -> Soil:
    """Return a soil whose parameters are log-normal about the laboratory's.

    Parameters
    ----------
    soil : Soil
        The laboratory's values.
    rng : numpy.random.Generator
    spread : mapping, optional
        Relative one-sigma per parameter (``tan_phi`` for the friction angle); `LABORATORY_SPREAD` by default. A
        parameter that is left out stays as it is.

    Raises
    ------
    ConfigError
        `spread` names no parameter of a soil.
    """
    sigmas = LABORATORY_SPREAD if spread is None else spread
    unknown = [name for name in sigmas if name not in LABORATORY_SPREAD]
    if unknown:
        raise ConfigError(
            *(Fault(f"a soil has no parameter {n!r}", expected=nearest(n, LABORATORY_SPREAD)) for n in unknown)
        )
    z = dict(zip(LABORATORY_SPREAD, rng.standard_normal(len(LABORATORY_SPREAD)), strict=True))
    factor = {name: float(np.exp(sigmas.get(name, 0.0) * z[name])) for name in LABORATORY_SPREAD}
    friction = factor.pop("tan_phi")
    changed = {name: getattr(soil, name) * f for name, f in factor.items()}
    angle = atan(tan(soil.friction_angle_rad) * friction)
    return replace(soil, **changed, friction_angle_rad=angle, source=f"drawn about: {soil.source}")
