"""Fit of the wheel-soil model to runs: checks of options and data, estimates with intervals, criteria."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq import (
    OUTPUTS,
    REACTIONS,
    BoolArray,
    ConfigError,
    DataError,
    Fault,
    FloatArray,
    IndexArray,
    Note,
    Severity,
    nearest,
)
from model import AveragedModel, ExtendedModel, FitCode, in_parallel, one_thread
from model.effects import EFFECTS, Effect
from model.fit.criteria import criteria
from model.fit.estimates import correlations, estimates_of, spread_of, warnings_of
from model.fit.gauss_newton import GaussNewtonOptions, GaussNewtonResult, gauss_newton
from model.fit.intervals import Blocks, blocks_of
from model.fit.observations import Measured, Observations, measured_of, observations_of
from model.fit.problem import FitProblem, free_parameters
from model.fit.result import CHOSEN, EXTENDED, MODELS, CampaignFit, FitOptions, LoadRatio, ModelFit
from model.progress import counted
from model.wheel_soil import SOIL_PARAMETERS, Conditions, Prediction, Soil, Wheel, WheelSoilModel, conditions_of
from processing import ProcessedRun

MIN_SAMPLES = 20
"""Driven samples of a time series below which nothing is fitted."""

_WORSE = 1.2
"""R0 over that of Wong's model, from which on a channel that was not fitted is said to be followed worse."""
_RENEWALS = 2
_SHARE_OF_FITS = 0.8
"""Of the time of a fit to runs; the rest goes into what the models predict."""
_BAND_SAMPLES = 1000
"""Samples for which the band of an average is worked out: it is smooth."""
_BLOCK = 1 << 16
"""Samples that are predicted at once."""


def check_options(options: FitOptions) -> None:
    """Raise ConfigError for models or channels that there are not, or an extended model of another reading."""
    faults = [Fault(f"there is no model {m!r}", expected=nearest(m, MODELS)) for m in options.models if m not in MODELS]
    faults += [
        Fault(f"there is no channel {c!r} to fit", expected=", ".join(OUTPUTS), next_step="use --channels dp,t,z")
        for c in options.channels or ("",)
        if c not in OUTPUTS
    ]
    if options.extended is not None and options.extended.reading != options.reading:
        faults.append(
            Fault(
                "the extended model is of the other reading",
                found=f"{options.extended.reading}, and the fit is {options.reading}",
                next_step=f"add --sinkage {options.extended.reading}",
            )
        )
    faults += [
        Fault(
            f"effect {key} is of the {EFFECTS[key].reading} reading only",
            found=f"the fit is {options.reading}",
            next_step=f"add --sinkage {EFFECTS[key].reading}, or leave it out",
        )
        for key in options.chosen
        if EFFECTS[key].reading not in ("any", options.reading)
    ]
    ConfigError.stop_if_any(faults)


def driven_samples(observations: Observations, options: FitOptions) -> Observations:
    """Return the samples that can be fitted: 0 < s <= 1, W > 0, every fitted channel measured.

    Rut readings beside another channel may be missing: they are at single samples.
    """
    DataError.stop_if_any(
        Fault(
            f"{OUTPUTS[c].field} was not measured",
            next_step=f"leave {c!r} out of --channels, or give the signal a role under [signals]",
        )
        for c in options.channels
        if len(observations) and not np.isfinite(observations.measured(c)).any()
    )
    good = (observations.slip > 0) & (observations.slip <= 1) & (observations.vertical_load_n > 0)
    for channel in options.channels:
        if channel != "z" or not observations.readings or len(options.channels) == 1:
            good &= np.isfinite(observations.measured(channel))
    return observations[good]


def check_stiffness(soil: Soil, wheel: Wheel) -> None:
    """Raise ConfigError for a soil that does not resist the wheel."""
    stiffness = soil.stiffness(wheel.width_m)
    if not stiffness > 0:
        raise ConfigError.of(
            "this soil does not resist a wheel of this width: k_c/b + k_phi is not positive",
            where=f"soil {soil.name}",
            found=f"k_c {soil.cohesive_modulus:g} N/m^(n+1), k_phi {soil.frictional_modulus:g} N/m^(n+2), "
            f"b {wheel.width_m:g} m: {stiffness:g} Pa/m^n",
            next_step="check cohesive_modulus_kn, frictional_modulus_kn and width_m",
        )


def check_enough(driven: Observations, lost: int, options: FitOptions) -> None:
    """Raise DataError for too few samples; `lost` more have no answer of the model."""
    fitted = [m for m in options.names if m != EXTENDED or not (options.extended and options.extended.sets)]
    most = max((sum(len(EFFECTS[e].parameters) for e in options.effects_of(m)) for m in fitted), default=0)
    most += len(SOIL_PARAMETERS) if options.soil_prior else 0
    needed = max(4, most + 3) if driven.independent else MIN_SAMPLES
    if len(driven) >= needed:
        return
    found = f"{len(driven)} usable samples with s > 0"
    if lost:
        found += f"; {lost} more whose load this soil and wheel do not carry above the axle"
    raise DataError.of(
        "too few driven samples to fit",
        found=found,
        expected=f"at least {needed}",
        next_step=_why_few(driven, lost),
    )


def _why_few(driven: Observations, lost: int) -> str:
    if lost:
        return "check wheel, soil and units"
    if driven.independent:
        return "measure at three slips above 0 or more, and repeat each test"
    return "see `wheelsoil process` for why samples are left out"


def answered_by_extended(wheel: Wheel, driven: Observations, extended: ExtendedModel, answered: BoolArray) -> BoolArray:
    """Return which samples the extended model has an answer for, with the values it comes with."""
    effects = [EFFECTS[key] for key in extended.keys]
    _check_needs(driven, effects, "take another --model")
    found = np.isfinite(replace(extended, wheel=wheel).predict(driven.conditions).drawbar_pull_n)
    if answered.any() and not (found & answered).any():
        raise DataError.of(
            "the extended model has no answer for any sample",
            found=", ".join(effect.key() for effect in effects) or "no effects",
            next_step="check that it is of this wheel and soil",
        )
    return found


def check_chosen(driven: Observations, chosen: Sequence[str]) -> None:
    """Raise DataError for a chosen effect that is not identifiable from these data."""
    _check_needs(driven, [EFFECTS[key] for key in chosen], "leave the effect out")


def _check_needs(driven: Observations, effects: Sequence[type[Effect]], instead: str) -> None:
    lacking = [
        Fault(
            f"effect {effect.key()} needs {', '.join(unknown)}, which these data do not have",
            next_step=f"give it (runs.toml, or the signal's role under [signals]), or {instead}",
        )
        for effect in effects
        if (unknown := [n for n in effect.needs.conditions if not np.isfinite(getattr(driven.conditions, n)).any()])
        and len(driven)
    ]
    DataError.stop_if_any(lacking)


@one_thread
def fit_models(
    runs: Sequence[ProcessedRun],
    wheel: Wheel,
    soil: Soil,
    options: FitOptions | None = None,
    *,
    keep_predictions: bool = True,
    drives: Sequence[int] = (),
) -> CampaignFit:
    """Fit the paper's models to processed runs of one terrain.

    Parameters
    ----------
    drives : sequence of int, optional
        Which drive each run is of, where wheels of one size were driven together: their errors are not independent.
    keep_predictions : bool
        Whether the fits hold what each model predicts for every sample, 2 GB for four models and ten hours.

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
    asked = conditions_of(runs, soil.unit_weight_n_m3) if options and (options.extended or options.chosen) else ()
    fitted = fit_observations(observations_of(runs, conditions=asked, drives=drives), wheel, soil, options)
    rows = _judged_rows(runs, fitted.slip_threshold)
    conditions = asked or conditions_of(runs, soil.unit_weight_n_m3)
    answers = _answers(fitted, conditions, rows, keep_predictions=keep_predictions)
    del asked, conditions  # of ten hours: 100 MB
    models = [replace(fit, predictions=kept) for fit, (kept, _) in zip(fitted.models, answers, strict=True)]
    predicted = [of_rows for _, of_rows in answers]
    judged = judge_alike(models, measured_of(runs, rows), predicted, fitted.slip_threshold, wheel.radius_m)
    return replace(fitted, models=judged)


def _judged_rows(runs: Sequence[ProcessedRun], threshold: float) -> list[IndexArray]:
    """Return the rows of each run that the criteria count; where there are none, all used ones, which tell why."""
    rows = [np.flatnonzero(run.used & (run.slip >= threshold)) for run in runs]
    return rows if any(map(len, rows)) else [np.flatnonzero(run.used) for run in runs]


def _answers(
    fitted: CampaignFit, conditions: Sequence[Conditions], rows: Sequence[IndexArray], *, keep_predictions: bool
) -> list[tuple[tuple[Prediction, ...], dict[str, FloatArray]]]:
    """Return for each model its predictions, where they are kept, and its forces of some rows of each run."""

    def of_model(fit: ModelFit) -> tuple[tuple[Prediction, ...], dict[str, FloatArray]]:
        model = fitted.options.forward(fitted.wheel, fitted.soil, fit.name)
        if keep_predictions:
            kept = tuple(model.predict(of_run, fit.values) for of_run in conditions)
            parts = [_forces(prediction, own) for prediction, own in zip(kept, rows, strict=True)]
        else:
            kept = ()
            blocks = (
                (of_run, own[i : i + _BLOCK])
                for of_run, own in zip(conditions, rows, strict=True)
                for i in range(0, len(own), _BLOCK)
            )
            parts = [_forces(model.predict(of_run.rows(block), fit.values), slice(None)) for of_run, block in blocks]
        return kept, {key: np.concatenate([part[key] for part in parts]) for key in OUTPUTS}

    return list(counted(in_parallel(of_model, fitted.models), len(fitted.models), _SHARE_OF_FITS, 1.0))


def _forces(prediction: Prediction, rows: IndexArray | slice) -> dict[str, FloatArray]:
    return {key: getattr(prediction, channel.field)[rows].copy() for key, channel in OUTPUTS.items()}


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
    threshold = chosen.threshold_on(soil)
    found = in_parallel(lambda name: _fit_one(name, driven, wheel, soil, chosen), chosen.names)
    fits = list(counted(found, len(chosen.names), 0.0, _SHARE_OF_FITS))
    forward = [chosen.forward(wheel, soil, fit.name) for fit in fits]
    predictions = [model.predict(observations.conditions, fit.values) for model, fit in zip(forward, fits, strict=True)]
    predicted = [{key: getattr(p, channel.field) for key, channel in OUTPUTS.items()} for p in predictions]
    models = judge_alike(fits, observations, predicted, threshold, wheel.radius_m)
    models = tuple(
        _with_band(fit, model, driven, chosen, threshold) for fit, model in zip(models, forward, strict=True)
    )
    notes: tuple[Note, ...] = (Note(FitCode.LOAD_NOT_CARRIED, values={"samples": lost}),) if lost else ()
    if chosen.extended is not None and chosen.extended.soil.name != soil.name:
        notes += (Note(FitCode.OTHER_SOIL, Severity.DOUBT, {"model": chosen.extended.soil.name, "soil": soil.name}),)
    return CampaignFit(models, wheel, soil, chosen, threshold, observations, notes)


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


def _with_band(
    fit: ModelFit, model: WheelSoilModel, driven: Observations, options: FitOptions, threshold: float
) -> ModelFit:
    """Return the fit with one-sigma of the prediction of an average, and the note that it is one."""
    if not isinstance(model, AveragedModel) or options.extended is None:
        return fit
    rows = np.flatnonzero(driven.slip >= threshold) if (driven.slip >= threshold).any() else np.arange(len(driven))
    some = rows[:: max(1, len(rows) // _BAND_SAMPLES)]
    sigmas = model.sigmas(driven.conditions.rows(some))
    band = {channel: float(np.sqrt(np.nanmean(x**2))) for channel, x in sigmas.items() if np.isfinite(x).any()}
    facts = {
        "sets": tuple(
            (tuple(e.key for e in model_set.effects), model_set.probability) for model_set in options.extended.sets
        ),
        "rest": options.extended.rest_probability,
        "sigma": band,
    }
    return replace(fit, predicted_sigma=band, warnings=(*fit.warnings, Note(FitCode.AVERAGE_OF_SETS, values=facts)))


def _problem(name: str, driven: Observations, wheel: Wheel, soil: Soil, options: FitOptions) -> FitProblem:
    model = options.forward(wheel, soil, name)
    starts = options.extended.values if name == EXTENDED and options.extended else None
    free = free_parameters(model, options.soil_prior, starts)
    ones = {c: np.ones(len(driven)) for c in options.channels}
    problem = FitProblem(model, driven, options.channels, free, options.soil_prior, ones)
    if isinstance(model, AveragedModel):
        return problem
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
    channel = next((c for c in problem.channels if not problem.at_single_samples(c)), "z")
    whitened = problem.miss(problem.predict(x), channel) / np.sqrt(problem.variance[channel])
    driven = problem.driven
    return blocks_of(whitened, driven.time_s, driven.run, driven.independent, driven.drive)


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
    measured: Measured,
    predicted: Sequence[dict[str, FloatArray]],
    threshold: float,
    radius_m: float,
) -> tuple[ModelFit, ...]:
    """Give each model M0, R0 and R2, on the same samples: those that every one of them has an answer for.

    `predicted` has for each fit the channels, shape (n,), in N, N m or m, NaN where the model has no answer. A sample
    counts from the slip `threshold` on. A torque's error is reported relative to load times the wheel's radius.
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
                vertical_load_n=forces.get(c),
                rows=isinstance(measured, Observations) and measured.independent,
            )
            for c in (*REACTIONS, *(c for c in fit.residual_floor if c not in REACTIONS))
            if c == "dp" or np.isfinite(measured.measured(c)).any()
        }
        judged.append(replace(fit, criteria=found))
    wong = next((fit for fit in judged if fit.name == "wong"), None)
    return tuple(replace(fit, worse=_worse(fit, wong)) if wong else fit for fit in judged)


def _worse(fit: ModelFit, wong: ModelFit) -> tuple[Note, ...]:
    """Return the channels that are not in the fit, and that the model follows worse than Wong's."""
    return tuple(
        Note(FitCode.FOLLOWED_WORSE, Severity.DOUBT, {"channel": channel, "R0": own.R0_N, "R0_wong": before})
        for channel, own in fit.criteria.items()
        if channel not in fit.residual_floor and _WORSE * (before := wong.criteria[channel].R0_N) < own.R0_N
    )
