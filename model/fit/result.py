"""The result of a fit and its tables."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from daq import OUTPUTS, Note, frame_of_rows
from model.effects.catalogue import EFFECTS
from model.extended import ExtendedModel
from model.fit import Criteria, Observations
from model.fit.intervals import Blocks
from model.inference_data import Normal, inference_data
from model.wheel_soil import Prediction, Reading, Soil, SoilPrior, Wheel, WheelSoilModel

if TYPE_CHECKING:
    import pandas as pd
    from xarray import DataTree


MODELS: dict[str, tuple[str, ...]] = {"wong": (), "vasilev": ("vasilev",), "lyasko": ("lyasko",), "ding": ("ding",)}
"""The paper's four models by the effects they add to Wong's."""
EXTENDED = "extended"
"""Name of the model that a diagnosis left behind, in a fit beside the four."""
CHOSEN = "chosen"
"""Name of the model with the effects that a person chose, in a fit beside the four."""


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes
    ----------
    reading : "balanced" or "literal"
    channels : of "dp", "t" and "z"
    soil_prior : SoilPrior, optional
        Frees the soil's parameters within it; without it the soil is fixed, as in the paper.
    slip_threshold : for the criteria only; see `threshold_on`
    models : of `MODELS`
    confidence : of the intervals
    extended : ExtendedModel, optional
        Fitted beside the others: its soil, and its effects from the values they have. One of several sets is not
        fitted: it predicts their average.
    chosen : tuple of str
        Effects of one more model, fitted beside the others like them.
    """

    reading: Reading = "balanced"
    channels: tuple[str, ...] = ("dp",)
    soil_prior: SoilPrior | None = None
    slip_threshold: float | None = None
    models: tuple[str, ...] = tuple(MODELS)
    confidence: float = 0.95
    extended: ExtendedModel | None = None
    chosen: tuple[str, ...] = ()

    def threshold_on(self, soil: Soil) -> float:
        """Return the slip from which on criteria count: by default the paper's, 0.2 on clay, else 0.1."""
        if self.slip_threshold is not None:
            return self.slip_threshold
        return 0.2 if "clay" in soil.name.lower() else 0.1

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all models that are fitted."""
        return (*self.models, *(EXTENDED,) * (self.extended is not None), *(CHOSEN,) * bool(self.chosen))

    def effects_of(self, name: str) -> tuple[str, ...]:
        """Return the short names of a model's effects."""
        if name == EXTENDED and self.extended is not None:
            return self.extended.keys
        return self.chosen if name == CHOSEN else MODELS[name]

    def forward(self, wheel: Wheel, soil: Soil, name: str) -> WheelSoilModel:
        """Return what computes a model, by its name; an extended model brings its own soil."""
        if name == EXTENDED and self.extended:
            return replace(self.extended, wheel=wheel).model()
        return WheelSoilModel(wheel, soil, [EFFECTS[effect] for effect in self.effects_of(name)], self.reading)


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter, or one that follows from several (``derived``).

    ``sigma`` and ``interval`` are NaN where a bound holds the parameter.
    """

    name: str
    unit: str
    value: float
    sigma: float
    interval: tuple[float, float]
    derived: bool = False
    at_bound: bool = False


@dataclass(frozen=True)
class LoadRatio:
    """Eq. 7 for the model's sinkage over the measured load, on the fitted samples: median, least, most."""

    median: float
    lowest: float
    highest: float


@dataclass(frozen=True)
class ModelFit:
    """One model fitted to one terrain.

    Attributes
    ----------
    name : of `MODELS`, `EXTENDED` or `CHOSEN`
    effects : short names of the effects on top of Wong's model
    estimates : tuple of Estimate, empty for Wong's model with a fixed soil
    correlation : mapping (name, name) -> float, each pair once
    warnings : what cannot be separated, what sits on a bound
    stop_reason, iterations : of Gauss-Newton; "nothing_to_fit" without parameters
    criteria : mapping channel -> Criteria
    samples : in the fit
    blocks : what the intervals took as independent
    residual_floor : mapping channel -> a of the effective variance, N or N m
    predictions : one for each run, on all its samples (NaN where not usable); empty for a bench table
    fixed : mapping name -> value of effects' parameters that nothing fitted shows
    worse : channels that were measured, not fitted, and are followed worse than by Wong's model
    predicted_sigma : mapping channel -> float
        Of an average of several sets, rms over the samples that the criteria count: one-sigma of its prediction.
    """

    name: str
    effects: tuple[str, ...]
    estimates: tuple[Estimate, ...]
    correlation: dict[tuple[str, str], float]
    warnings: tuple[Note, ...]
    stop_reason: str
    iterations: int
    criteria: dict[str, Criteria]
    load_ratio: LoadRatio
    samples: int
    blocks: Blocks
    residual_floor: dict[str, float]
    predictions: tuple[Prediction, ...] = ()
    fixed: dict[str, float] = field(default_factory=dict)
    worse: tuple[Note, ...] = ()
    predicted_sigma: dict[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is to be known of its numbers."""
        return (*self.warnings, *self.worse)

    @property
    def values(self) -> dict[str, float]:
        """Parameters by name, as `WheelSoilModel.predict` takes them: the fitted ones and those that are held."""
        return self.fixed | {e.name: e.value for e in self.estimates if not e.derived}

    @property
    def normal(self) -> Normal:
        """The fitted parameters' joint distribution; one that a bound holds has no variance."""
        fitted = [e for e in self.estimates if not e.derived]
        correlation = np.eye(len(fitted))
        for (i, first), (j, second) in combinations(enumerate(fitted), 2):
            pair = self.correlation.get((first.name, second.name), self.correlation.get((second.name, first.name), 0.0))
            correlation[i, j] = correlation[j, i] = np.nan_to_num(pair)
        sigma = np.nan_to_num(np.array([e.sigma for e in fitted]))
        mean = np.array([e.value for e in fitted])
        return Normal({e.name: e.unit for e in fitted}, mean, sigma[:, None] * correlation * sigma)

    def estimate(self, name: str) -> Estimate:
        """Return an estimate by name."""
        return next(e for e in self.estimates if e.name == name)


@dataclass(frozen=True)
class CampaignFit:
    """All models of one terrain."""

    models: tuple[ModelFit, ...]
    wheel: Wheel
    soil: Soil
    options: FitOptions
    slip_threshold: float
    observations: Observations
    notes: tuple[Note, ...] = ()

    def model(self, name: str) -> ModelFit:
        """Return a model's fit by name."""
        return next(m for m in self.models if m.name == name)

    def to_inference_data(self, name: str, *, draws: int = 1000, seed: int = 0) -> DataTree:
        """Return a model's parameters for ArviZ, as draws from their normal distribution in four chains.

        Returns
        -------
        xarray.DataTree
            ``posterior`` (its ``units`` as attributes), ``observed_data`` and ``constant_data`` of the fitted samples.

        Raises
        ------
        ConfigError
            arviz-base is not installed.
        """
        fit = self.model(name)
        fields = [OUTPUTS[key].field for key in self.options.channels]
        return inference_data(
            fit.normal,
            data={
                "observed_data": {field: getattr(self.observations, field) for field in fields},
                "constant_data": {field: getattr(self.observations, field) for field in ("slip", "vertical_load_n")},
            },
            attributes={"model": name, "terrain": self.soil.name, "stop_reason": fit.stop_reason},
            draws=draws,
            seed=seed,
        )

    def to_frames(self) -> dict[str, pd.DataFrame]:
        """Return ``estimates`` (one row a parameter) and ``criteria`` (one row a model and channel) as frames.

        Returns
        -------
        dict of pandas.DataFrame
            Values are in the unit of the row's ``unit``; ``lower`` and ``upper`` are the ends of the interval at
            ``options.confidence``. A parameter that is ``held`` has no interval. ``reason`` is a code of `FitCode`.
        """
        return {"estimates": _estimates_frame(self), "criteria": _criteria_frame(self)}


def _estimates_frame(fit: CampaignFit) -> pd.DataFrame:
    names = ("model", "name", "unit", "value", "sigma", "lower", "upper", "derived", "at_bound", "held")
    nan = float("nan")
    rows: list[tuple[Any, ...]] = []
    for model in fit.models:
        rows += [(model.name, n, "", value, nan, nan, nan, False, False, True) for n, value in model.fixed.items()]
        rows += [
            (model.name, e.name, e.unit, e.value, e.sigma, *e.interval, e.derived, e.at_bound, False)
            for e in model.estimates
        ]
    return frame_of_rows(names, rows)


def _criteria_frame(fit: CampaignFit) -> pd.DataFrame:
    names = ("model", "channel", "unit", "R0", "M0_percent", "R2", "samples", "reason")
    rows = [
        (
            *(
                model.name,
                OUTPUTS[key].role,
                OUTPUTS[key].unit,
                criteria.R0_N,
                criteria.M0_percent,
                criteria.R2,
                criteria.samples,
            ),
            str(criteria.reason.code) if criteria.reason else "",
        )
        for model in fit.models
        for key, criteria in model.criteria.items()
    ]
    return frame_of_rows(names, rows)
