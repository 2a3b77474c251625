"""Draws of fitted parameters and of causes for ArviZ: corner plots, comparison with the prior, tables.

A fit and a diagnosis have no sampler: their posterior is a normal distribution, known by its mean and covariance. The
draws are from it, independent of each other, so that diagnostics of Markov chains say nothing here. What a bound holds
has its value in every draw; a parameter that cannot be negative is not cut off at zero.

Source: ArviZ (Kumar et al. 2019, Journal of Open Source Software 4, 1143), its schema of groups; an xarray.DataTree,
which ArviZ 1.0 takes as it is, and ArviZ 0.x through ``InferenceData.from_datatree``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from daq import OUTPUTS, FloatArray, not_installed

if TYPE_CHECKING:
    from xarray import DataTree

    from model.diagnosis import Information
    from model.fit import CampaignFit

CHAINS = 4
"""ArviZ expects several."""


def draws_of_fit(fit: CampaignFit, name: str, draws: int, seed: int) -> DataTree:
    """Return what `CampaignFit.to_inference_data` does."""
    found = fit.model(name)
    fitted = [one for one in found.estimates if not one.derived]
    free = [one for one in fitted if np.isfinite(one.sigma)]
    correlation = np.eye(len(free))
    for i, one in enumerate(free):
        for j, other in enumerate(free[:i]):
            each = found.correlation.get((other.name, one.name), found.correlation.get((one.name, other.name), 0.0))
            correlation[i, j] = correlation[j, i] = each
    sigma = np.array([one.sigma for one in free])
    drawn = _normal(np.array([one.value for one in free]), sigma[:, None] * correlation * sigma, draws, seed)
    posterior = {one.name: np.full((CHAINS, draws), one.value) for one in fitted}
    posterior |= {one.name: drawn[..., i] for i, one in enumerate(free)}
    seen, channels = fit.observations, [OUTPUTS[key].field for key in fit.options.channels]
    groups = {
        "posterior": posterior,
        "observed_data": {name: getattr(seen, name) for name in channels},
        "constant_data": {"slip": seen.slip, "vertical_load_n": seen.vertical_load_n},
    }
    units = {one.name: one.unit for one in fitted}
    return _tree(groups, units, {"model": found.name, "terrain": fit.soil.name, "stop_reason": found.stop_reason})


def draws_of_information(information: Information, attributes: Mapping[str, str], draws: int, seed: int) -> DataTree:
    """Return what `model.diagnosis.Diagnosis.to_inference_data` does."""
    first = 1 + len(information.soil)
    causes = [i for i, key in enumerate(information.effects) if key in information.about]
    at = np.array([*range(1, first), *(first + i for i in causes)], np.intp)
    names = [*information.soil, *(f"{information.effects[i]}.{information.parameters[i]}" for i in causes)]
    units = [*("laboratory's one-sigma" for _ in information.soil), *(information.units[i] for i in causes)]
    neutral = np.array([*(0.0 for _ in information.soil), *(information.neutrals[i] for i in causes)])
    scale = np.array([*(1.0 for _ in information.soil), *(information.scales[i] for i in causes)])
    covariance: FloatArray = np.asarray(np.linalg.inv(np.eye(at.size) + information.matrix[np.ix_(at, at)]), float)
    posterior = neutral + scale * _normal(covariance @ information.matrix[at, 0], covariance, draws, seed)
    prior = neutral + scale * _normal(np.zeros(at.size), np.eye(at.size), draws, seed + 1)
    groups = {
        group: {name: drawn[..., i] for i, name in enumerate(names)}
        for group, drawn in (("posterior", posterior), ("prior", prior))
    }
    return _tree(groups, dict(zip(names, units, strict=True)), attributes)


def _normal(mean: FloatArray, covariance: FloatArray, draws: int, seed: int) -> FloatArray:
    """Return draws, shape (chains, draws, parameters)."""
    rng = np.random.default_rng(seed)
    return rng.multivariate_normal(mean, covariance, (CHAINS, draws), method="eigh")


def _tree(
    groups: Mapping[str, Mapping[str, Sequence[float] | FloatArray]],
    units: Mapping[str, str],
    attributes: Mapping[str, str],
) -> DataTree:
    try:
        from arviz_base import from_dict
    except ImportError:
        raise not_installed("draws for ArviZ", "arviz-base", "", "arviz") from None
    tree: Any = from_dict(groups, attrs={"posterior": {**attributes, "sampled": "no: normal approximation"}})
    for group in set(tree.children) & {"posterior", "prior"}:
        for name in tree[group].data_vars:
            tree[group][name].attrs["units"] = units[name]
    return tree  # type: ignore[no-any-return]
