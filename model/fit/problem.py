r"""The weighted least-squares problem of one model on one terrain's driven samples.

:math:`\sum_i (f_i - y_i)^2 / v_i` with the effective variance
:math:`v_i = a^2 + (f_s\,\sigma_s)^2 + (f_W\,\sigma_W)^2`: the measured errors of slip and load, carried through the
model's own slopes, so that the steep and badly measured start of the curve does not rule the fit; :math:`a` is what
the residual asks for beyond that. The variances are held while Gauss-Newton runs and updated after it.

Source: Orear (1982), Am. J. Phys. 50:912 (least squares when both variables have uncertainties).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray
from model.averaged import AveragedModel
from model.effects.speed_errors import DELAY
from model.fit.observations import Observations
from model.wheel_soil import SOIL_PARAMETERS, Prediction, SoilPrior, WheelSoilModel

_SOIL_BOUNDS = {
    "cohesion_pa": (0.0, np.inf),
    "tan_phi": (0.0, 1.75),
    "shear_modulus_m": (1e-9, 1.0),
    "sinkage_exponent": (1e-9, 3.0),
    "cohesive_modulus": (-np.inf, np.inf),
    "frictional_modulus": (-np.inf, np.inf),
}
"""Whatever terrain.toml may say is within; where k_c/b + k_phi is not positive the model has no answer anyway."""

_SOIL_UNITS = dict(zip(SOIL_PARAMETERS, ("Pa", "1", "m", "1", "N/m^(n+1)", "N/m^(n+2)"), strict=True))


@dataclass(frozen=True)
class Free:
    """A parameter that is fitted; at ``neutral`` the model is Wong's with the laboratory's soil."""

    name: str
    unit: str
    start: float
    lower: float
    upper: float
    scale: float
    neutral: float


def free_parameters(
    model: WheelSoilModel, prior: SoilPrior | None, starts: Mapping[str, float] | None = None
) -> tuple[Free, ...]:
    """Return the effects' parameters and, with a prior, the soil's; `starts` are other starts than the effects' own.

    An average of several sets has none.
    """
    if isinstance(model, AveragedModel):
        return ()
    given = starts or {}
    effects = [
        Free(key, p.unit, given.get(key, p.start), p.lower, p.upper, p.scale(model.wheel), p.neutral)
        for e in model.effects
        for key, p in zip(e.parameter_keys().values(), e.parameters, strict=True)
    ]
    if prior is None:
        return tuple(effects)
    sigmas = np.sqrt(np.diag(prior.covariance))
    soil = [
        Free(name, _SOIL_UNITS[name], float(mean), *_SOIL_BOUNDS[name], float(sigma), float(mean))
        for name, mean, sigma in zip(SOIL_PARAMETERS, prior.mean, sigmas, strict=True)
        if sigma > 0
    ]
    return (*effects, *soil)


@dataclass(frozen=True)
class FitProblem:
    """Residuals and sensitivities of a model against measured channels.

    Attributes
    ----------
    driven : Observations, the n samples to fit
    channels : of "dp", "t" and "z"
    free : the parameters, p of them
    variance : mapping channel -> array (n,), N^2, (N m)^2 or m^2
    tempering : share of the data's information that counts against the prior: 1 / (samples per independent sample)
    static_sinkage_m : array (n,), optional
        Z0 where no free parameter moves it, so that it is solved for once.
    fixed : mapping name -> value
        Parameters that are not fitted and not at their neutral value.
    """

    model: WheelSoilModel
    driven: Observations
    channels: tuple[str, ...]
    free: tuple[Free, ...]
    prior: SoilPrior | None
    variance: dict[str, FloatArray]
    tempering: float = 1.0
    static_sinkage_m: FloatArray | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(f.name for f in self.free)

    def with_static_sinkage(self) -> FitProblem:
        """Return the problem with Z0 solved once, where no free parameter moves it."""
        if self.prior is not None or any(e.moves_static_sinkage() for e in self.model.effects):
            return self
        neutral = np.array([f.neutral for f in self.free])
        return replace(self, static_sinkage_m=self.predict(neutral).static_sinkage_m)

    def predict(self, x: FloatArray, wrt: tuple[str, ...] = ()) -> Prediction:
        """Return the model's answer at the estimate `x`, shape (p,)."""
        return self.model.predict(self.driven.conditions, self._values(x), wrt=wrt)

    def _values(self, x: FloatArray) -> dict[str, float]:
        return {**self.fixed, **dict(zip(self.names, x.tolist(), strict=True))}

    def without_idle_parameters(self, at: Literal["start", "neutral"]) -> FitProblem:
        """Return the problem with those parameters fixed, at their start or neutral, that nothing fitted shows.

        So is the delay of a model file: where the forces are steep in slip, weights and noise confirm any delay.
        """
        x = self.answered_start()
        slopes = self.predict(x, self.names).sensitivities
        fields = [OUTPUTS[channel].field for channel in self.channels]
        shown = [
            (at == "neutral" or name != DELAY) and any(np.any(getattr(slopes[name], field) != 0.0) for field in fields)
            for name in self.names
        ]
        kept = tuple(f for f, seen in zip(self.free, shown, strict=True) if seen or f.name in SOIL_PARAMETERS)
        idle = {f.name: float(getattr(f, at)) for f in self.free if f not in kept}
        return replace(self, free=kept, fixed={**self.fixed, **idle})

    def answered_start(self) -> FloatArray:
        """Return the starts, shape (p,), brought as near to neutral as it takes for the model to answer every sample.

        Where the soil hardly carries the wheel, a start with slip sinkage would put its axle under ground.
        """
        neutral, away = np.array([[f.neutral, f.start - f.neutral] for f in self.free]).reshape(-1, 2).T
        for share in (1.0, 0.3, 0.1, 0.03, 0.01):
            if np.isfinite(self.predict(neutral + share * away).drawbar_pull_n).all():
                return np.asarray(neutral + share * away)
        return np.asarray(neutral)

    def residual_and_jacobian(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return whitened residuals (model - measured; prior rows last), and their derivatives."""
        prediction = self.model.predict(
            self.driven.conditions, self._values(x), wrt=self.names, static_sinkage_m=self.static_sinkage_m
        )
        residual, jacobian = [], []
        for channel in self.channels:
            tempering = 1.0 if self.at_single_samples(channel) else self.tempering
            weight = self.known(channel) * np.sqrt(tempering / self.variance[channel])
            residual.append(self.miss(prediction, channel) * weight)
            slopes = [getattr(prediction.sensitivities[n], OUTPUTS[channel].field) for n in self.names]
            jacobian.append(np.stack(slopes, axis=1) * weight[:, None])
        if self.prior is not None:
            rows, target = self._prior_rows()
            residual.append(rows @ x - target)
            jacobian.append(rows)
        return np.concatenate(residual), np.concatenate(jacobian)

    def miss(self, prediction: Prediction, channel: str) -> FloatArray:
        """Return model minus measured, shape (n,); 0 where no rut was read."""
        predicted: FloatArray = getattr(prediction, OUTPUTS[channel].field)
        return np.where(self.known(channel), predicted - self.driven.measured(channel), 0.0)

    def at_single_samples(self, channel: str) -> bool:
        """Return whether a channel is of rut readings, which do not repeat each other as a time series does."""
        return channel == "z" and self.driven.readings

    def known(self, channel: str) -> BoolArray:
        """Return which samples have a measured value; all but where no rut was read."""
        return np.isfinite(self.driven.measured(channel))

    def sensitivities_and_scores(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each sample's whitened sensitivities (n, channels, p) and its score w_i J_i' e_i (n, p)."""
        n, c, p = len(self.driven), len(self.channels), len(self.free)
        residual, jacobian = self.residual_and_jacobian(x)
        sensitivities = jacobian[: n * c].reshape(c, n, p).transpose(1, 0, 2)
        whitened = residual[: n * c].reshape(c, n).T
        return sensitivities, np.einsum("ncp,nc->np", sensitivities, whitened)

    def prior_information(self) -> FloatArray:
        """Return the prior's information matrix, shape (p, p); zero without a prior."""
        if self.prior is None:
            return np.zeros((len(self.free), len(self.free)))
        rows, _ = self._prior_rows()
        return np.asarray(rows.T @ rows)

    def _prior_rows(self) -> tuple[FloatArray, FloatArray]:
        assert self.prior is not None
        whitener = self.prior.whitener()
        rows = np.zeros((len(whitener), len(self.free)))
        for column, name in enumerate(self.names):
            if name in SOIL_PARAMETERS:
                rows[:, column] = whitener[:, SOIL_PARAMETERS.index(name)]
        return rows, whitener @ self.prior.mean

    def renewed(self, x: FloatArray) -> tuple[FitProblem, dict[str, float]]:
        """Return the problem with the variances of the estimate `x`, and the floor a of each channel."""
        prediction = self.predict(x, ("slip", "vertical_load_n"))
        variance, floor = {}, {}
        for channel in self.channels:
            by_slip = getattr(prediction.sensitivities["slip"], OUTPUTS[channel].field) * self.driven.slip_sigma
            by_load = (
                getattr(prediction.sensitivities["vertical_load_n"], OUTPUTS[channel].field)
                * self.driven.vertical_load_sigma_n
            )
            carried = by_slip**2 + by_load**2
            known = self.known(channel)
            floor[channel] = _floor(self.miss(prediction, channel)[known] ** 2, carried[known])
            variance[channel] = floor[channel] ** 2 + carried
        return replace(self, variance=variance), floor


def _floor(squared: FloatArray, carried: FloatArray) -> float:
    """Return a with mean(squared / (a^2 + carried)) = 1, but at least a tenth of the residual's rms.

    The least keeps a weight finite where the carried error alone explains the residual.
    """
    rms = float(np.sqrt(np.mean(squared)))
    low, high = 0.1 * rms, rms
    if not rms > 0 or np.mean(squared / (low**2 + carried)) <= 1.0:
        return max(low, 1e-9)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.mean(squared / (middle**2 + carried)) > 1.0:
            low = middle
        else:
            high = middle
    return high
