"""Gain of an extension on held-out data, which neither the choice of its causes nor its fit has used.

One run, or one condition of a table with its repeats, is held out at a time. It is predicted twice from the others:
by the base model and by the extended one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from daq import BoolArray, FloatArray
from model.diagnosis.core.result import Gain, Reduction, Scores
from model.fit.criteria import criteria

_FEWEST_FOR_INTERVAL = 3


@dataclass(frozen=True)
class HeldOutPrediction:
    """One held-out run or condition, as predicted from the others.

    Attributes
    ----------
    log_likelihood : float
        Nats.
    measured, predicted : mapping channel -> array, shape (n,)
    judged : bool array, shape (n,)
        Samples that errors are of: those at or above the paper's slip threshold.
    numbers : int
        That the log likelihood is the density of.
    slip : shape (n,), optional
        Of the samples of a run, for M0; rows of a table need none.
    variance : mapping channel -> array, shape (n,)
        Of measured - predicted by soil and noise; of runs.
    """

    log_likelihood: float
    measured: dict[str, FloatArray]
    predicted: dict[str, FloatArray]
    judged: BoolArray
    numbers: int
    slip: FloatArray | None = None
    variance: dict[str, FloatArray] = field(default_factory=dict)

    def answered_by(self, other: HeldOutPrediction) -> HeldOutPrediction:
        """Return the prediction of those samples only that another model answers, too."""
        both = {c: np.where(np.isfinite(other.predicted[c]), x, np.nan) for c, x in self.predicted.items()}
        return replace(self, predicted=both)

    def squares(self, channel: str) -> tuple[float, int]:
        """Return the sum of squared errors in a channel, and how many there are."""
        error = (self.measured[channel] - self.predicted[channel])[self._known(channel)]
        return float(error @ error), len(error)

    def expected_squares(self, channel: str) -> float:
        """Return the sum of squared errors that soil and noise would give."""
        return float(self.variance[channel][self._known(channel)].sum())

    def measures(self, channel: str) -> bool:
        """Return whether a run has a value of the channel that errors are of."""
        return channel in self.variance and bool(np.isfinite(self.measured[channel][self.judged]).any())

    def _known(self, channel: str) -> BoolArray:
        return self.judged & np.isfinite(self.measured[channel] - self.predicted[channel])


def rms(folds: Sequence[HeldOutPrediction], channel: str) -> float:
    """Return the root mean square error of a channel over all folds, in its unit."""
    total, count = np.sum([fold.squares(channel) for fold in folds], axis=0)
    return float(np.sqrt(total / count))


def gain_of(
    base: Sequence[HeldOutPrediction],
    extended: Sequence[HeldOutPrediction],
    chosen: Sequence[tuple[str, ...]],
    channel: str,
) -> Gain:
    """Return the gain of the extended model over the base model, from the predictions of every fold.

    `chosen` has the keys of the causes that each fold chose; the error of `channel` is reported first.
    """
    pairs = [(b.answered_by(e), e.answered_by(b)) for b, e in zip(base, extended, strict=True)]
    base, extended = (_judged(folds) for folds in zip(*pairs, strict=True))
    channels = dict.fromkeys((channel, *(c for fold in base for c in fold.measured)))
    reductions = {c: _reduction(_squares(base, extended, c)) for c in channels}
    return Gain(
        base=_scores(base),
        extended=_scores(extended),
        reduction_percent=reductions[channel].percent,
        interval95=reductions[channel].interval95,
        log_likelihood_gain=sum(_gained(b, e) for b, e in zip(base, extended, strict=True)),
        chosen=tuple(chosen),
        channel=channel,
        reductions=reductions,
        expected={c: _expected(base, c) for c in channels if any(fold.measures(c) for fold in base)},
    )


def _gained(base: HeldOutPrediction, extended: HeldOutPrediction) -> float:
    """Return the gain in the prediction of a fold, nats; 0 where one model has an answer for more samples."""
    return extended.log_likelihood - base.log_likelihood if extended.numbers == base.numbers else 0.0


def _judged(folds: Sequence[HeldOutPrediction]) -> Sequence[HeldOutPrediction]:
    """Return the folds; where no sample at all is above the threshold, judged on every sample."""
    if any(fold.judged.any() for fold in folds):
        return folds
    return [replace(fold, judged=np.ones(len(fold.judged), bool)) for fold in folds]


def _expected(folds: Sequence[HeldOutPrediction], channel: str) -> float:
    """Return R0 of a channel by soil and noise alone; NaN without a sample."""
    own = [fold for fold in folds if channel in fold.variance]
    total, count = np.sum([(fold.expected_squares(channel), fold.squares(channel)[1]) for fold in own], axis=0)
    return float(np.sqrt(total / count)) if count else float("nan")


def _scores(runs: Sequence[HeldOutPrediction]) -> dict[str, Scores]:
    """Return the criteria of every channel over all folds."""
    likelihood = float(np.mean([run.log_likelihood for run in runs]))
    found = {}
    for channel in dict.fromkeys(c for run in runs for c in run.measured):
        own = [run for run in runs if channel in run.measured]
        judged = criteria(
            np.concatenate([run.measured[channel] for run in own]),
            np.concatenate([run.predicted[channel] for run in own]),
            np.concatenate([np.where(run.judged, 0.0 if run.slip is None else run.slip, np.nan) for run in own]),
            -np.inf,
            rows=any(run.slip is None for run in own),
        )
        found[channel] = Scores(judged.R0_N, judged.M0_percent, judged.R2, likelihood)
    return found


def _squares(base: Sequence[HeldOutPrediction], extended: Sequence[HeldOutPrediction], channel: str) -> FloatArray:
    """Return squared errors of base and extended model in a channel, of the folds that have any; shape (folds, 2)."""
    pairs = [
        (b.squares(channel), e.squares(channel)) for b, e in zip(base, extended, strict=True) if channel in b.measured
    ]
    return np.array([(before, after) for (before, count), (after, _) in pairs if count], float).reshape(-1, 2)


def _reduction(squares: FloatArray) -> Reduction:
    """Return by how much R0 falls.

    The interval is Student's, of the logarithm of the ratio of the sums: three folds drawn with replacement know hardly
    more than their own mean, and their interval is too narrow.
    """
    folds = len(squares)
    before, after = squares[:, 0].sum(), squares[:, 1].sum()
    if not (before > 0 and after > 0):
        return Reduction(float("nan"), (float("nan"), float("nan")))
    middle = 0.5 * float(np.log(after / before))
    if folds < _FEWEST_FOR_INTERVAL:
        return Reduction(_fall(middle), (float("nan"), float("nan")))
    moves = 0.5 * (squares[:, 1] / after - squares[:, 0] / before)
    reach = float(scipy.special.stdtrit(folds - 1, 0.975) * np.sqrt(folds / (folds - 1) * np.sum(moves**2)))
    return Reduction(_fall(middle), (_fall(middle + reach), _fall(middle - reach)))


def _fall(log_ratio: float) -> float:
    return float(-100.0 * np.expm1(log_ratio))
