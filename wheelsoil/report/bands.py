"""How sure a fitted model is of its own curve: the covariance of its coefficients, carried through its slopes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.effects import EFFECTS
from model.fit_result import EXTENDED, ModelFit
from model.observations import CHANNELS
from model.run_conditions import conditions_of
from model.wheel_soil import WheelSoilModel
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.thinning import EDGES

_PER_BIN = 4
"""Samples of a run and a bin of slip for which it is worked out: the band is smooth."""


def model_sigma(material: Material, model: ModelFit, channel: str) -> FloatArray:
    """Return one-sigma of a model's prediction from its coefficients alone, on some of the used samples.

    Parameters
    ----------
    material : Material
    model : ModelFit
    channel : "dp" or "t"

    Returns
    -------
    float64 array, shape (n,)
        For the samples of `Material.pool`; NaN where it was not worked out, and everywhere for a model that has no
        coefficient with a standard error.
    """
    pool = material.pool
    sigma = np.full(len(pool.slip), np.nan)
    names, covariance = _covariance(model)
    if not names:
        return sigma
    rows = _rows(pool.slip, pool.run)
    conditions = _chosen(material, rows)
    fit = material.fit
    ground = fit.options.extended.soil if model.name == EXTENDED and fit.options.extended else fit.soil
    said = WheelSoilModel(fit.wheel, ground, [EFFECTS[key] for key in model.effects], fit.options.reading).predict(
        conditions, model.values, wrt=names
    )
    slopes = np.stack([getattr(said.sensitivities[name], CHANNELS[channel]) for name in names])
    sigma[rows] = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", slopes, covariance, slopes), 0.0))
    return sigma


def _covariance(model: ModelFit) -> tuple[tuple[str, ...], FloatArray]:
    """Return the coefficients that have a standard error, and their covariance."""
    free = [e for e in model.estimates if not e.derived and np.isfinite(e.sigma)]
    names = tuple(e.name for e in free)
    size = np.array([e.sigma for e in free])
    correlation = np.eye(len(free))
    for (a, b), value in model.correlation.items():
        if a in names and b in names and np.isfinite(value):
            i, j = names.index(a), names.index(b)
            correlation[i, j] = correlation[j, i] = value
    return names, correlation * np.outer(size, size)


def _rows(slip: FloatArray, run: NDArray[np.int64]) -> NDArray[np.int64]:
    """Choose samples at even steps of each run and bin of slip."""
    bins = len(EDGES) + 1
    label = run * bins + np.digitize(slip, EDGES)
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    picks = starts[:, None] + (np.arange(_PER_BIN)[None, :] * sizes[:, None]) // _PER_BIN
    return np.asarray(np.sort(order[np.unique(picks)]), np.int64)


def _chosen(material: Material, rows: NDArray[np.int64]) -> Conditions:
    """Return the conditions of some samples of the pool."""
    conditions = conditions_of(material.runs, material.fit.soil.unit_weight_n_m3)
    used = [run.used for run in material.runs]

    def of_field(name: str) -> FloatArray:
        pieces = [getattr(c, name)[keep] for c, keep in zip(conditions, used, strict=True)]
        return np.concatenate(pieces)[rows]

    return Conditions(**{name: of_field(name) for name in Conditions.__dataclass_fields__})
