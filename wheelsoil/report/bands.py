"""How sure a fitted model is of its own curve: the covariance of its coefficients, carried through its slopes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.fit_result import CampaignFit, ModelFit
from model.observations import CHANNELS
from model.run_conditions import conditions_of
from processing.processed_run import ProcessedRun
from wheelsoil.report.thinning import EDGES

FloatArray = NDArray[np.float64]

_PER_BIN = 4
"""Samples of a run and a bin of slip for which it is worked out: the band is smooth."""


def model_sigmas(runs: Sequence[ProcessedRun], fit: CampaignFit) -> dict[str, dict[str, FloatArray]]:
    """Return one-sigma of each model's prediction from its coefficients alone, on some of the used samples.

    Parameters
    ----------
    runs : sequence of ProcessedRun
    fit : CampaignFit
        Of these runs.

    Returns
    -------
    mapping channel -> model -> float64 array, shape (n,)
        For the used samples of all runs, one after the other; NaN where it was not worked out, and everywhere for a
        model that has no coefficient with a standard error.
    """
    used = [run.used for run in runs]
    slip = np.concatenate([run.slip[keep] for run, keep in zip(runs, used, strict=True)])
    rows = _rows(slip, np.repeat(np.arange(len(runs)), [int(keep.sum()) for keep in used]))
    conditions = _chosen(runs, fit.soil.unit_weight_n_m3, rows)
    found: dict[str, dict[str, FloatArray]] = {channel: {} for channel in CHANNELS}
    for model in fit.models:
        for channel, sigma in _of_model(fit, model, conditions).items():
            found[channel][model.name] = np.full(len(slip), np.nan)
            found[channel][model.name][rows] = sigma
    return found


def _of_model(fit: CampaignFit, model: ModelFit, conditions: Conditions) -> dict[str, FloatArray]:
    """Return one-sigma of each channel under some conditions."""
    names, covariance = _covariance(model)
    if not names:
        return dict.fromkeys(CHANNELS, np.full(len(conditions.slip), np.nan))
    forward = fit.options.forward(fit.wheel, fit.soil, model.name)
    said = forward.predict(conditions, model.values, wrt=names)
    found = {}
    for channel, quantity in CHANNELS.items():
        slopes = np.stack([getattr(said.sensitivities[name], quantity) for name in names])
        found[channel] = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", slopes, covariance, slopes), 0.0))
    return found


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


def _chosen(runs: Sequence[ProcessedRun], unit_weight_n_m3: float, rows: NDArray[np.int64]) -> Conditions:
    """Return the conditions of some of the used samples."""
    conditions = conditions_of(runs, unit_weight_n_m3)

    def of_field(name: str) -> FloatArray:
        pieces = [getattr(c, name)[run.used] for c, run in zip(conditions, runs, strict=True)]
        return np.concatenate(pieces)[rows]

    return Conditions(**{name: of_field(name) for name in Conditions.__dataclass_fields__})
