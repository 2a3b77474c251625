"""A model and runs to a fit: estimates with intervals, criteria, and the load that the model's sinkage carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.criteria import criteria
from model.estimates import correlations, estimates_of, spread_of, warnings_of
from model.fit_checks import (
    answered_by_extended,
    check_chosen,
    check_enough,
    check_options,
    check_stiffness,
    driven_samples,
)
from model.fit_problem import FitProblem, free_parameters
from model.fit_result import CHOSEN, EXTENDED, CampaignFit, FitOptions, LoadRatio, ModelFit
from model.gauss_newton import GaussNewtonOptions, GaussNewtonResult, gauss_newton
from model.intervals import Blocks, blocks_of
from model.observations import CHANNELS, Observations, observations_of
from model.one_thread import one_thread
from model.run_conditions import conditions_of
from model.soils import Soil
from model.wheel import Wheel
from model.wheel_soil import Prediction
from processing.processed_run import ProcessedRun

FloatArray = NDArray[np.float64]

_RENEWALS = 2


@one_thread
def fit_models(
    runs: Sequence[ProcessedRun], wheel: Wheel, soil: Soil, options: FitOptions | None = None
) -> CampaignFit:
    """Fit the paper's models to processed runs of one terrain.

    Parameters
    ----------
    runs : sequence of ProcessedRun
    wheel : Wheel
    soil : Soil
    options : FitOptions, optional

    Raises
    ------
    ConfigError
        Unknown model or channel.
    DataError
        Too few usable driven samples, or a fitted channel that was not measured.

    Source
    ------
    Yang et al. (2016), sections 1.2, 1.3 and 3.
    """
    conditions = conditions_of(runs, soil.unit_weight_n_m3)
    asked = conditions if options and (options.extended or options.chosen) else ()
    fitted = fit_observations(observations_of(runs, conditions=asked), wheel, soil, options)
    everything = observations_of(runs, thinned=False)
    models, predicted = [], []
    for fit in fitted.models:
        model = fitted.options.forward(wheel, soil, fit.name)
        predictions = tuple(model.predict(condition, fit.values) for condition in conditions)
        models.append(replace(fit, predictions=predictions))
        predicted.append(
            {
                c: np.concatenate([getattr(p, CHANNELS[c])[r.used] for p, r in zip(predictions, runs, strict=True)])
                for c in CHANNELS
            }
        )
    return replace(fitted, models=judge_alike(models, everything, predicted, fitted.slip_threshold, wheel.radius_m))


@one_thread
def fit_observations(
    observations: Observations,
    wheel: Wheel,
    soil: Soil,
    options: FitOptions | None = None,
) -> CampaignFit:
    """Fit the paper's models to samples and judge them on the same: the door for bench tables.

    Parameters
    ----------
    observations : Observations
        What is fitted; only s > 0 is used.
    wheel : Wheel
    soil : Soil
    options : FitOptions, optional

    Raises
    ------
    ConfigError, DataError
        As `fit_models`.
    """
    chosen = options or FitOptions()
    check_options(chosen)
    check_stiffness(soil, wheel)
    driven = driven_samples(observations, chosen)
    answered = np.isfinite(chosen.forward(wheel, soil, "wong").predict(driven.conditions).drawbar_pull_n)
    if chosen.extended is not None:
        answered &= answered_by_extended(wheel, driven, chosen.extended, answered)
    check_chosen(driven, chosen.chosen)
    driven, lost = driven[answered], int((~answered).sum())
    check_enough(driven, lost, chosen)
    threshold = default_slip_threshold(soil) if chosen.slip_threshold is None else chosen.slip_threshold
    fits = [_fit_one(name, driven, wheel, soil, chosen) for name in chosen.names]
    forward = [chosen.forward(wheel, soil, fit.name) for fit in fits]
    predictions = [model.predict(observations.conditions, fit.values) for model, fit in zip(forward, fits, strict=True)]
    predicted = [{c: getattr(p, CHANNELS[c]) for c in CHANNELS} for p in predictions]
    models = judge_alike(fits, observations, predicted, threshold, wheel.radius_m)
    notes = (f"{lost} driven samples left out: the soil does not carry their load above the axle",) if lost else ()
    return CampaignFit(models, wheel, soil, chosen, threshold, observations, notes)


def default_slip_threshold(soil: Soil) -> float:
    """Return the paper's threshold for the criteria: 0.2 on clay, else 0.1."""
    return 0.2 if "clay" in soil.name.lower() else 0.1


def _fit_one(name: str, driven: Observations, wheel: Wheel, soil: Soil, options: FitOptions) -> ModelFit:
    problem = _problem(name, driven, wheel, soil, options)
    free = problem.free
    x = problem.answered_start()
    problem, floor = problem.renewed(x)
    result: GaussNewtonResult | None = None
    iterations = 0
    blocks = _blocks(problem, x)
    if free:
        for _ in range(_RENEWALS + 1):
            problem = replace(problem, tempering=_tempering(blocks, driven))
            result = _solve(problem, x)
            x, iterations = result.estimate, iterations + result.iterations
            problem, floor = problem.renewed(x)
            blocks = _blocks(problem, x)
    found = spread_of(problem, x, result, blocks) if result else None
    estimates = estimates_of(problem, x, result, found, blocks, options.confidence) if result and found else ()
    return ModelFit(
        name=name,
        effects=options.effects_of(name),
        estimates=estimates,
        correlation=correlations(problem.names, found.covariance) if found else {},
        warnings=warnings_of(problem, result, found, estimates) if result and found else (),
        stop_reason=str(result.stop_reason) if result else "nothing_to_fit",
        iterations=iterations,
        criteria={},
        load_ratio=_load_ratio(problem.predict(x), driven),
        samples=len(driven),
        blocks=blocks,
        residual_floor=floor,
        fixed=dict(problem.fixed),
    )


def _problem(name: str, driven: Observations, wheel: Wheel, soil: Soil, options: FitOptions) -> FitProblem:
    model = options.forward(wheel, soil, name)
    starts = options.extended.values if name == EXTENDED and options.extended else None
    free = free_parameters(model, options.soil_prior, starts)
    ones = {c: np.ones(len(driven)) for c in options.channels}
    problem = FitProblem(model, driven, options.channels, free, options.soil_prior, ones)
    if name in (EXTENDED, CHOSEN):
        problem = problem.without_idle_parameters("start" if name == EXTENDED else "neutral")
    return problem.with_static_sinkage()


def _solve(problem: FitProblem, start: FloatArray) -> GaussNewtonResult:
    return gauss_newton(
        problem.residual_and_jacobian,
        start,
        lower=[f.lower for f in problem.free],
        upper=[f.upper for f in problem.free],
        scale=[f.scale for f in problem.free],
        names=problem.names,
        options=GaussNewtonOptions(epsilon=1e-6, cost_tolerance=1e-10, max_iterations=60),
    )


def _blocks(problem: FitProblem, x: FloatArray) -> Blocks:
    channel = problem.channels[0]
    whitened = problem.miss(problem.predict(x), channel) / np.sqrt(problem.variance[channel])
    driven = problem.driven
    return blocks_of(whitened, driven.time_s, driven.run, driven.independent)


def _tempering(blocks: Blocks, driven: Observations) -> float:
    """Return independent samples over samples, for the balance of data against a prior."""
    if driven.independent or not blocks.correlation_time_s > 0:
        return 1.0
    step = float(np.median(np.diff(driven.time_s)[np.diff(driven.run) == 0]))
    return float(min(1.0, step / blocks.correlation_time_s))


def _load_ratio(prediction: Prediction, driven: Observations) -> LoadRatio:
    ratio = prediction.vertical_load_n / driven.vertical_load_n
    ratio = ratio[np.isfinite(ratio)]
    if not len(ratio):
        return LoadRatio(float("nan"), float("nan"), float("nan"))
    return LoadRatio(float(np.median(ratio)), float(ratio.min()), float(ratio.max()))


def judge_alike(
    fits: Sequence[ModelFit],
    measured: Observations,
    predicted: Sequence[dict[str, FloatArray]],
    threshold: float,
    radius_m: float,
) -> tuple[ModelFit, ...]:
    """Give each model M0, R0 and R2, on the same samples: those that every one of them has an answer for.

    Parameters
    ----------
    fits : sequence of ModelFit
    measured : Observations, n samples
    predicted : for each fit a mapping channel -> array (n,), N or N m; NaN where the model has no answer
    threshold : slip from which on a sample counts
    radius_m : of the wheel: a torque's error is told over load times radius
    """
    answered = np.logical_and.reduce([np.isfinite(p["dp"]) for p in predicted])
    forces = {"dp": measured.vertical_load_n, "t": radius_m * measured.vertical_load_n}
    judged = []
    for fit, values in zip(fits, predicted, strict=True):
        found = {
            c: criteria(
                measured.measured(c),
                np.where(answered, values[c], np.nan),
                measured.slip,
                threshold,
                vertical_load_n=forces[c],
            )
            for c in CHANNELS
            if c == "dp" or np.isfinite(measured.measured(c)).any()
        }
        judged.append(replace(fit, criteria=found))
    return tuple(judged)
