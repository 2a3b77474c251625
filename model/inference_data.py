"""Draws from a normal posterior for ArviZ: corner plots, comparison with the prior, tables.

A fit and a diagnosis have no sampler: their posterior is a normal distribution, known by its mean and covariance. The
draws are from it, independent of each other, so that diagnostics of Markov chains say nothing here. What a bound holds
has its value in every draw; a parameter that cannot be negative is not cut off at zero.

Source: ArviZ (Kumar et al. 2019, Journal of Open Source Software 4, 1143), its schema of groups; an xarray.DataTree,
which ArviZ 1.0 takes as it is, and ArviZ 0.x through ``InferenceData.from_datatree``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from daq import FloatArray, not_installed

if TYPE_CHECKING:
    from xarray import DataTree

_CHAINS = 4
"""ArviZ expects several."""


@dataclass(frozen=True)
class Normal:
    """A normal distribution of k named parameters.

    Attributes
    ----------
    units : mapping name -> unit
        In the order of `mean`, shape (k,), and `covariance`, shape (k, k).
    """

    units: Mapping[str, str]
    mean: FloatArray
    covariance: FloatArray

    def draws(self, count: int, seed: int) -> dict[str, FloatArray]:
        """Return each parameter's draws, shape (chains, count)."""
        rng = np.random.default_rng(seed)
        found = rng.multivariate_normal(self.mean, self.covariance, (_CHAINS, count), method="eigh")
        return {name: found[..., i] for i, name in enumerate(self.units)}


def inference_data(
    posterior: Normal,
    prior: Normal | None = None,
    *,
    data: Mapping[str, Mapping[str, FloatArray]] | None = None,
    attributes: Mapping[str, str],
    draws: int,
    seed: int,
) -> DataTree:
    """Return groups for ArviZ: ``posterior``, ``prior`` and those of `data`, with units as attributes.

    `ConfigError` where arviz-base is not installed.
    """
    try:
        from arviz_base import from_dict
    except ImportError:
        raise not_installed("draws for ArviZ", "arviz-base", "", "arviz") from None
    drawn = {"posterior": posterior} | ({"prior": prior} if prior else {})
    groups = {group: normal.draws(draws, seed + i) for i, (group, normal) in enumerate(drawn.items())}
    described = {**attributes, "sampled": "no: normal approximation"}
    tree: Any = from_dict({**groups, **(data or {})}, attrs={"posterior": described})
    for group, normal in drawn.items():
        for name, unit in normal.units.items():
            tree[group][name].attrs["units"] = unit
    return tree  # type: ignore[no-any-return]
