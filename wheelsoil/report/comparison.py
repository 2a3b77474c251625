"""Ranking of the models by their error, and the significance of the best model's lead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from daq import OUTPUTS, FloatArray, IntArray
from model.fit import ModelFit
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.fit_text import reason_text

_MIN_BLOCKS = 6
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Rival:
    """Comparison of another model with the best one.

    Attributes
    ----------
    t, critical_t : float
        Mean difference of the squared errors over nearly independent blocks of samples, divided by its standard
        error; significant (95 %) beyond `critical_t`. NaN with too few blocks.
    """

    name: str
    r0_n: float
    t: float
    critical_t: float
    blocks: int

    @property
    def is_worse(self) -> bool:
        """Whether the best model's lead over this one is significant."""
        return bool(self.t > self.critical_t)


@dataclass(frozen=True)
class Ranking:
    """Models by their R0 of the drawbar pull; `rivals` are the others, the closest first."""

    best: ModelFit
    r0_n: float
    rivals: tuple[Rival, ...]
    error_n: FloatArray
    """Error of the best model on the compared samples: predicted - measured."""

    def rival(self, name: str) -> Rival | None:
        """Return the comparison with one model."""
        return next((rival for rival in self.rivals if rival.name == name), None)


def rank(material: ReportInputs, channel: str = "dp") -> Ranking:
    """Compare the models above the slip threshold.

    The errors of two models on one sample are paired, and neighbouring samples are correlated: the difference of
    the squared errors is averaged over blocks; their length is the longer one of the two fits.

    Raises
    ------
    DataError
        There is no fit, the channel was not measured, or no slip is above the threshold.

    Notes
    -----
    Source: Diebold & Mariano (1995), J. Bus. Econ. Stat. 13:253, with block means for the variance.
    """
    from daq import DataError

    fit, pool = material.fit, material.pool
    scored = [m for m in fit.models if channel in m.criteria and np.isfinite(m.criteria[channel].R0_N)]
    if not scored:
        reasons = {reason_text(m.criteria[channel]) for m in fit.models if channel in m.criteria}
        raise DataError("; ".join(sorted(reasons)) or "no model has an R0")
    ordered = sorted(scored, key=lambda model: model.criteria[channel].R0_N)
    measured = pool.measured(channel)
    errors = {model.name: pool.predicted(model.name, OUTPUTS[channel].field) - measured for model in ordered}
    counted = pool.slip >= fit.slip_threshold
    for error in errors.values():
        counted &= np.isfinite(error)
    best = ordered[0]
    rivals = []
    for other in ordered[1:]:
        length_s = float(np.nanmax([best.blocks.length_s, other.blocks.length_s]))
        difference = errors[other.name][counted] ** 2 - errors[best.name][counted] ** 2
        t, critical, blocks = _block_t(difference, pool.time_s[counted], pool.run[counted], length_s)
        rivals.append(Rival(other.name, other.criteria[channel].R0_N, t, critical, blocks))
    return Ranking(best, best.criteria[channel].R0_N, tuple(rivals), errors[best.name][counted])


def _block_t(difference: FloatArray, time_s: FloatArray, run: IntArray, length_s: float) -> tuple[float, float, int]:
    """Return Student's t of block means, its critical value (one-sided) and the number of blocks."""
    key = np.stack([run, np.floor(time_s / length_s).astype(np.int64)])
    label = np.unique(key, axis=1, return_inverse=True)[1].reshape(-1)
    counts = np.bincount(label)
    if len(counts) < _MIN_BLOCKS:
        return float("nan"), float("nan"), len(counts)
    sums = np.bincount(label, difference)
    mean = difference.mean()
    # ratio estimator: blocks hold unequal numbers of samples
    spread = sums - mean * counts
    blocks = len(counts)
    error = np.sqrt(np.sum(spread**2) * blocks / (blocks - 1)) / counts.sum()
    critical = float(stdtrit(blocks - 1, _CONFIDENCE))
    return (float(mean / error) if error > 0 else float("nan")), critical, blocks
