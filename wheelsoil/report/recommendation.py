"""The model that the report recommends beside the baseline, on the samples that decide between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daq import OUTPUTS, REACTIONS, BoolArray, DataError, FloatArray, IntArray
from model import DiagnosisCode
from model.diagnosis import Cause, Diagnosis
from model.fit import CampaignFit, ModelFit
from processing import ProcessedRun
from wheelsoil.report.figures import EDGES, Bins, binned, matched, style
from wheelsoil.wording.names import CALIBRATED, LABORATORY, page_unit, plain_name
from wheelsoil.wording.numbers import number, signed
from wheelsoil.wording.verdict import model_title
from wheelsoil.workflows.key_figures import Z95

_SAME_SIDE, _LEAST_BINS, _HALF_NOISE = 0.8, 5, 0.5
_LEAST_SAMPLES, _FEWEST_SAMPLES = 10, 4
_ERROR_OF_MEDIAN, _QUARTILES_APART = 1.25, 1.349
"""Standard error of a median, in sigmas by the root of n; distance of a normal distribution's quartiles, in sigmas."""
_LEAST_FOR_SLOPE, _LITTLE = 50, 0.02


class Pool:
    """The used samples of fitted runs, one after the other, with what each model predicts for them.

    All arrays have shape (n,); `time_s` is within the run, `run` the number of the run.
    """

    def __init__(self, runs: Sequence[ProcessedRun], models: Sequence[ModelFit]) -> None:
        self._runs = runs
        self._models = {model.name: model for model in models}
        self.slip = self.values("slip")
        self.vertical_load_n = self.values("vertical_load_n")
        self.sinkage_m = self.values("sinkage_m")
        self.time_s = self.values("time_s")
        self.run = np.repeat(np.arange(len(runs)), [int(run.used.sum()) for run in runs])

    def measured(self, channel: str) -> FloatArray:
        """Return what was measured of "dp" or "t"; `DataError` if it was not."""
        values = self.values(OUTPUTS[channel].field)
        if not np.isfinite(values).any():
            what = OUTPUTS[channel].name
            raise DataError.of(f"the {what} was not measured")
        return values

    def predicted(self, model: str, name: str) -> FloatArray:
        """Return a model's prediction, e.g. ``"drawbar_pull_n"`` or ``"sinkage_m"``."""
        predictions = self._models[model].predictions
        pieces = [getattr(p, name)[run.used] for p, run in zip(predictions, self._runs, strict=True)]
        return np.concatenate(pieces) if pieces else np.zeros(0)

    def values(self, name: str) -> FloatArray:
        """Return what was measured, e.g. ``"slip"``."""
        pieces = [getattr(run, name)[run.used] for run in self._runs]
        return np.concatenate(pieces) if pieces else np.zeros(0)


@dataclass(frozen=True)
class Recommendation:
    """The recommended or most probable model and the one without its causes, on the same samples.

    `title` is what the model is called (`wheelsoil.wording.verdict.model_title`), `name` and `base_name` are it and the
    one beside it in words; with `is_base` nothing better than the base is known, and there is one model. `main_channel`
    is that of the cause's figure; `run` indexes `runs`, the ids. Channels have arrays of shape (n,); `noise` is one
    sigma of a measured sample about the base, NaN where nobody estimated it. `adequate`: a diagnosis, which knows the
    error of the slip, finds no more than noise about the model.
    """

    title: str
    name: str
    base_name: str
    is_base: bool
    main_channel: str
    runs: tuple[str, ...]
    run: IntArray
    time_s: FloatArray
    slip: FloatArray
    vertical_load_n: FloatArray
    measured: Mapping[str, FloatArray]
    base: Mapping[str, FloatArray]
    recommended: Mapping[str, FloatArray]
    noise: Mapping[str, FloatArray]
    adequate: bool = False

    def of_run(self, name: str) -> BoolArray:
        """Return which samples are of a run."""
        return np.isin(self.run, [i for i, known in enumerate(self.runs) if known == name])

    def residual(self, channel: str, *, base: bool = False) -> FloatArray:
        """Return measured - predicted, shape (n,), of the recommended model or of the baseline."""
        predicted = self.base if base else self.recommended
        return np.asarray(self.measured[channel] - predicted[channel])


def of_fit(fit: CampaignFit, runs: tuple[str, ...], pool: Pool) -> Recommendation:
    """Return the single-law fit that predicts the drawbar pull best beside Wong's model without slip sinkage."""
    scored = {m.name: m.criteria["dp"].R0_N for m in fit.models if "dp" in m.criteria}
    best = min((name for name in scored if np.isfinite(scored[name])), key=lambda name: scored[name], default="wong")
    base = "wong" if "wong" in scored else best
    channels = [c for c in REACTIONS if np.isfinite(pool.values(OUTPUTS[c].field)).any()]

    def predicted(model: str) -> dict[str, FloatArray]:
        return {c: pool.predicted(model, OUTPUTS[c].field) for c in channels}

    return Recommendation(
        title=LABORATORY if best == base else style(best).label,
        name=style(best).label,
        base_name=LABORATORY if base == "wong" else style(base).label,
        is_base=best == base,
        main_channel=next(iter(channels), "dp"),
        runs=runs,
        run=pool.run,
        time_s=pool.time_s,
        slip=pool.slip,
        vertical_load_n=pool.vertical_load_n,
        measured={c: pool.values(OUTPUTS[c].field) for c in channels},
        base=predicted(base),
        recommended=predicted(best),
        noise={c: np.full(len(pool.slip), np.nan) for c in channels},
    )


def recommended_causes(found: Diagnosis) -> tuple[Cause, ...]:
    """Return the causes of the model that is shown beside the base: the named ones, or the most probable of several."""
    return found.causes if found.verdict == "named" else found.causes[:1] if found.verdict == "one_of" else ()


def of_diagnosis(found: Diagnosis) -> Recommendation:
    """Return what a diagnosis with samples recommends: the extended model, or the baseline where no cause is likely."""
    runs: list[str] = []
    number, pieces = [], found.plot_data
    for piece in pieces:
        number.append(piece.run + len(runs))
        runs += piece.runs
    channels = [c for c in OUTPUTS if any(c in piece.base for piece in pieces)]

    def joined(name: str) -> dict[str, FloatArray]:
        empty = {piece.campaign: np.full(len(piece.slip), np.nan) for piece in pieces}
        values = {c: [getattr(piece, name).get(c, empty[piece.campaign]) for piece in pieces] for c in channels}
        return {c: np.concatenate(of_campaigns) for c, of_campaigns in values.items()}

    is_base = found.verdict not in ("named", "one_of") or not found.causes
    with_cause = " and ".join(plain_name(cause.name) for cause in recommended_causes(found))
    return Recommendation(
        title=CALIBRATED if is_base else model_title(found),
        name=CALIBRATED if is_base else f"with {with_cause}",
        base_name=CALIBRATED,
        is_base=is_base,
        main_channel=found.main_channel if found.main_channel in channels else next(iter(channels), "dp"),
        runs=tuple(runs),
        run=np.concatenate(number).astype(np.int64),
        time_s=np.concatenate([piece.time_s for piece in pieces]),
        slip=np.concatenate([piece.slip for piece in pieces]),
        vertical_load_n=np.concatenate([piece.vertical_load_n for piece in pieces]),
        measured=joined("measured"),
        base=joined("base"),
        recommended=joined("base" if is_base else "extended"),
        noise=joined("base_sigma"),
        adequate=bool(found.adequacy and found.adequacy.ok) and not found.grounds.table_channels,
    )


@dataclass(frozen=True)
class LoadShift:
    """What brings samples of a channel to one load: the recommended model's change with load, as a function of slip.

    `slope` is a polynomial in slip, highest power first: channel per N of load.
    """

    load_n: float
    slope: FloatArray

    def of(self, slip: FloatArray, load_n: FloatArray) -> FloatArray:
        """Return what to add to samples at these slips and loads."""
        return np.asarray(np.polyval(self.slope, slip) * (self.load_n - load_n))


def load_shift(recommendation: Recommendation, channel: str) -> LoadShift:
    """Return the shift of a channel to the median load; none where the load hardly varies."""
    rows = (
        (recommendation.slip > 0)
        & np.isfinite(recommendation.recommended[channel])
        & np.isfinite(recommendation.vertical_load_n)
    )
    slip, load = recommendation.slip[rows], recommendation.vertical_load_n[rows]
    middle = float(np.median(load)) if len(load) else float("nan")
    if len(load) < _LEAST_FOR_SLOPE or float(np.std(load)) < _LITTLE * middle:
        return LoadShift(middle, np.zeros(1))
    beside, powers = np.vander(slip, 6), np.vander(slip, 3)
    design = np.hstack([beside, powers * (load - middle)[:, None] / middle])
    solution = np.linalg.lstsq(design, recommendation.recommended[channel][rows], rcond=None)[0]
    return LoadShift(middle, np.asarray(solution[-3:] / middle, np.float64))


@dataclass(frozen=True)
class Bias:
    """A side of slip on which the recommended model is off: the slips and the medians of its residual there."""

    channel: str
    driving: bool
    slip: tuple[float, float]
    size: tuple[float, float]
    noise: float = float("nan")
    """Of a sample there."""


def biases(recommendation: Recommendation) -> list[Bias]:
    """Return where the recommended model's residual stays on one side of zero.

    Either nearly everywhere and by more than half the noise of a sample, or in neighbouring bins of slip where the
    median is off by more than the noise of a single sample and two of its own errors. The braked side of an adequate
    model has `unconfirmed`: at measured slip its median is off by what the error of the slip does on the steep curve.
    """
    found = []
    for channel in recommendation.measured:
        for driving in (True,) if recommendation.adequate else (True, False):
            bias = _bias(recommendation, channel, driving=driving)
            found += [bias] if bias else []
    return found


def unconfirmed(recommendation: Recommendation, channel: str) -> str:
    """Return in words that the model swings about the braked samples by more than the noise of a driven one, or "".

    Their own noise is larger by what the slip's noise does on the steep curve, so that this is no bias; but who looks
    at the residual sees it leave zero. A median counts where it is beyond by two of its own standard errors.
    """
    braked, driven = recommendation.slip < 0, recommendation.slip > 0
    bins = binned(recommendation.slip[braked], recommendation.residual(channel)[braked], EDGES)
    noise = recommendation.noise[channel][driven & np.isfinite(recommendation.noise[channel])]
    if not len(bins.median) or not len(noise):
        return ""
    ruler = float(np.median(noise))
    beyond = _beyond(bins, ruler, (bins.upper - bins.lower) / _QUARTILES_APART, _LEAST_SAMPLES)
    if not beyond.any():
        return ""
    factor, unit = page_unit(channel)
    ends = dict.fromkeys(number(factor * float(end)) for end in (min(bins.median[beyond]), max(bins.median[beyond])))
    size = f"median residual {' to '.join(ends)} {unit}, noise of a driven sample {number(factor * ruler, 2)} {unit}"
    return f"The model is not confirmed for braking: {OUTPUTS[channel].name}, {size}."


def caution_text(bias: Bias) -> str:
    """Return a bias of the recommended model in words."""
    factor, unit = page_unit(bias.channel)
    low, high = (number(factor * size, 2) for size in bias.size)
    size = f"{low} {unit}" if low == high else f"{low} to {high} {unit}"
    slips = f"slip {signed(bias.slip[0], '.2f')} to {signed(bias.slip[1], '.2f')}"
    side = "Driving" if bias.driving else "Braking"
    noise = f", the noise of a sample {number(factor * bias.noise, 2)} {unit}" if np.isfinite(bias.noise) else ""
    return f"{side}, {OUTPUTS[bias.channel].name}: at {slips} the median residual is {size}{noise}."


def rows_not_used(found: Diagnosis) -> str:
    """Return in words which rows of single-wheel tables a diagnosis did not use, for they are braked; "" for none."""
    rows = sum(note.values["rows"] for note in found.notes if note.code == DiagnosisCode.BRAKED_ROWS_EXCLUDED)
    braked_only = any(note.code == DiagnosisCode.BRAKED_ROWS_ONLY for note in found.notes)
    return f"{rows} {'driven' if braked_only else 'braked'} rows are not used" if rows else ""


def slips_of_rows(recommendation: Recommendation) -> tuple[float, float]:
    """Return the axis that holds the slips of tables' rows, with those at zero inside it."""
    low, high = float(np.min(recommendation.slip, initial=0.0)), float(np.max(recommendation.slip, initial=0.2))
    return low - 0.02, 0.05 * float(np.ceil(high / 0.05 - 1e-9)) + 0.02


def rows_check(recommendation: Recommendation, channel: str) -> tuple[bool, str]:
    """Return whether the rows of tables scatter about the model as they should, and how many are beyond 95 %."""
    left, half = recommendation.residual(channel), Z95 * recommendation.noise[channel]
    known = np.isfinite(left) & np.isfinite(half)
    beyond, rows = int((np.abs(left) > half)[known].sum()), int(known.sum())
    factor, unit = page_unit(channel)
    size = number(factor * float(np.median(half[known])), 2) if rows else "–"
    name = OUTPUTS[channel].name.capitalize()
    text = f"{name}: {rows - beyond} of {rows} rows are within ±{size} {unit} of the model, where 95 % are expected."
    return beyond <= 0.05 * rows + 2 * float(np.sqrt(0.0475 * rows)), text


def checks_of(found: Diagnosis) -> list[str]:
    """Return where the model that a diagnosis of runs recommends is off, in words; empty for tables."""
    return [caution_text(bias) for bias in biases(of_diagnosis(found))] if found.plot_data else []


def _bias(recommendation: Recommendation, channel: str, *, driving: bool) -> Bias | None:
    side = (recommendation.slip > 0) == driving
    median = binned(recommendation.slip[side], recommendation.residual(channel)[side], EDGES)
    noise = binned(recommendation.slip[side], recommendation.noise[channel][side], EDGES)
    sigma = matched(median.centre, noise)
    if len(median.centre) == 0 or not np.isfinite(sigma).any():
        return None
    sides = np.sign(median.median)
    same = max(float(np.mean(sides > 0)), float(np.mean(sides < 0)))
    everywhere = (
        len(sides) >= _LEAST_BINS
        and same >= _SAME_SIDE
        and float(np.nanmedian(np.abs(median.median) / sigma)) > _HALF_NOISE
    )
    chosen = np.ones(len(sides), np.bool_) if everywhere else _off_most(median, sigma)
    if not chosen.any():
        return None
    half = (EDGES[1] - EDGES[0]) / 2
    centres, sizes = median.centre[chosen], median.median[chosen]
    slips = (round(float(centres.min() - half), 2), round(float(centres.max() + half), 2))
    return Bias(channel, driving, slips, (float(sizes.min()), float(sizes.max())), float(np.nanmedian(sigma[chosen])))


def _beyond(bins: Bins, ruler: FloatArray | float, scatter: FloatArray, fewest: int) -> BoolArray:
    """Return which medians are beyond a ruler by two of the standard errors that the scatter of samples gives them."""
    error = _ERROR_OF_MEDIAN * scatter / np.sqrt(bins.count)
    return np.asarray((np.abs(bins.median) > ruler + 2 * error) & (bins.count >= fewest))


def _off_most(median: Bins, sigma: FloatArray) -> BoolArray:
    """Return the neighbours on one side of zero that are beyond the noise, whose residuals are largest together."""
    off = _beyond(median, sigma, sigma, _FEWEST_SAMPLES)
    sides = np.where(off, np.sign(median.median), 0.0)
    apart = np.diff(median.centre, prepend=np.nan) > 1.5 * (EDGES[1] - EDGES[0])
    stretch = np.cumsum((np.diff(sides, prepend=np.nan) != 0) | apart)
    sums = np.bincount(stretch, np.where(off, np.abs(median.median) / sigma, 0.0))
    return np.asarray(off & (stretch == int(np.argmax(sums))))
