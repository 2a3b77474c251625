r"""AveragedModel: what several sets of causes predict, averaged by their probabilities, and how uncertain that is.

Predictions are averaged, not parameters: a parameter has a meaning beside the other members of its set only. Of the
members' predictions m_k with variances s_k^2, and probabilities p_k that sum to 1,

.. math:: m = \sum_k p_k m_k, \qquad s^2 = \sum_k p_k \left(s_k^2 + (m_k - m)^2\right).

Source: Hoeting, Madigan, Raftery & Volinsky (1999), Stat. Sci. 14:382, Eq. 1 to 3.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daq import OUTPUTS, ConfigError, FloatArray
from model.wheel_soil.conditions import Conditions
from model.wheel_soil.dual import Number
from model.wheel_soil.wheel_soil_model import INPUTS, Prediction, Sensitivity, WheelSoilModel

LEAST_ANSWERED = 0.5
"""Share of the probability that must have an answer for a sample; below it the average has none."""


@dataclass(frozen=True)
class Member:
    """A set of causes as a model with values.

    Attributes
    ----------
    probability : float
        Above 0; of all members they need not sum to 1.
    values : mapping parameter -> value
        As the model takes them.
    names : tuple of str, p of them
        Parameters of the covariance.
    covariance : array, shape (p, p)
    """

    probability: float
    model: WheelSoilModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: FloatArray


class AveragedModel(WheelSoilModel):
    """The average of several models of one wheel by their probabilities; it has no parameters of its own.

    Parameters
    ----------
    members : sequence of Member
        At least one.
    """

    def __init__(self, members: Sequence[Member]) -> None:
        first = members[0].model
        super().__init__(first.wheel, first.soil, (), first.reading, first.quadrature)
        self.members = tuple(members)

    def predict(
        self,
        conditions: Conditions,
        values: Mapping[str, Number] | None = None,
        wrt: Sequence[str] = (),
        sinkage_m: FloatArray | None = None,
        static_sinkage_m: FloatArray | None = None,
    ) -> Prediction:
        """Return the mean of the members' predictions; see `WheelSoilModel.predict`.

        A sample without an answer of members that have `LEAST_ANSWERED` of the probability has none.

        Parameters
        ----------
        values : must be empty
        static_sinkage_m : not taken, since every member has its own
        wrt : sequence of str
            Of the inputs ``slip`` and ``vertical_load_n`` only.

        Raises
        ------
        ConfigError
            A parameter was given, or is asked for.
        """
        if foreign := [*(values or {}), *(name for name in wrt if name not in INPUTS)]:
            raise ConfigError.of("an average of several sets has no parameters", found=", ".join(foreign))
        total = _Mean(tuple(wrt))
        for member in self.members:
            total.add(member.probability, member.model.predict(conditions, member.values, wrt, sinkage_m))
        return total.mean()

    def sigmas(self, conditions: Conditions) -> dict[str, FloatArray]:
        """Return one-sigma of the mean prediction: of the parameters within each set, and between the sets.

        Returns
        -------
        mapping channel ("dp", "t", "z") -> array, shape (n,)
            In the channel's unit; noise of a measurement is not in it. NaN where there is no answer.
        """
        moments = {channel: _Moments() for channel in OUTPUTS}
        for member in self.members:
            prediction = member.model.predict(conditions, member.values, wrt=member.names)
            for channel, output in OUTPUTS.items():
                slopes = [getattr(prediction.sensitivities[name], output.field) for name in member.names]
                moments[channel].add(member.probability, getattr(prediction, output.field), slopes, member.covariance)
        return {channel: each.sigma() for channel, each in moments.items()}


def _of(prediction: Prediction) -> Iterator[tuple[tuple[str, str], FloatArray]]:
    """Yield every array of a prediction by what it is the derivative by (empty: itself) and its field."""
    for name in Prediction.__dataclass_fields__:
        if name != "sensitivities":
            yield ("", name), getattr(prediction, name)
    for by, slopes in prediction.sensitivities.items():
        for name in Sensitivity.__dataclass_fields__:
            yield (by, name), getattr(slopes, name)


class _Mean:
    """The weighted sum of predictions, as they come: of ten hours not all are kept."""

    def __init__(self, wrt: tuple[str, ...]) -> None:
        self._wrt = wrt
        self._sums: dict[tuple[str, str], FloatArray] = {}
        self._answered = np.zeros(0)
        self._whole = 0.0

    def add(self, probability: float, prediction: Prediction) -> None:
        known = np.isfinite(prediction.drawbar_pull_n)
        if not self._whole:
            self._answered = np.zeros(known.shape)
        self._whole += probability
        self._answered += probability * known
        for key, x in _of(prediction):
            part = np.where(known, probability * x, 0.0)
            self._sums[key] = self._sums[key] + part if key in self._sums else part

    def mean(self) -> Prediction:
        enough = self._answered >= LEAST_ANSWERED * self._whole
        weight = np.where(enough, self._answered, np.nan)
        mean = {key: x / weight for key, x in self._sums.items()}
        fields = {name: x for (by, name), x in mean.items() if not by}
        slopes = {by: Sensitivity(**{n: mean[by, n] for n in Sensitivity.__dataclass_fields__}) for by in self._wrt}
        return Prediction(**fields, sensitivities=slopes)


class _Moments:
    """First and second moment of one channel's prediction over the members."""

    def __init__(self) -> None:
        self._sums: FloatArray = np.zeros(0)
        self._whole = 0.0

    def add(self, probability: float, x: FloatArray, slopes: Sequence[FloatArray], covariance: FloatArray) -> None:
        slope = np.nan_to_num(np.stack(slopes, axis=1), posinf=0.0, neginf=0.0) if slopes else np.zeros((len(x), 0))
        within = np.einsum("ni,ij,nj->n", slope, covariance, slope)
        known = np.isfinite(x)
        rows = np.where(known, np.stack([np.ones(len(x)), x, x**2 + within]), 0.0)
        self._sums = probability * rows if not self._whole else self._sums + probability * rows
        self._whole += probability

    def sigma(self) -> FloatArray:
        answered, first, second = self._sums
        weight = np.where(answered >= LEAST_ANSWERED * self._whole, answered, np.nan)
        return np.asarray(np.sqrt(np.maximum(second / weight - (first / weight) ** 2, 0.0)))
