"""How far to trust the result: the ranking of the models, and every check that speaks for or against the best one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from daq import OUTPUTS, DataError, FloatArray, IntArray
from model.diagnosis import Diagnosis, Gain
from model.effects import EFFECTS
from model.fit import CHOSEN, EXTENDED, MODELS, ModelFit, StopReason
from wheelsoil.report.content import Block, Contents, Text, section
from wheelsoil.report.figures import style
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.fit_text import reason_text
from wheelsoil.wording.names import listed, plain_name, upper
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.numbers import number
from wheelsoil.wording.verdict import sentence_of
from wheelsoil.workflows.fit import NOT_AT_AN_END, ended
from wheelsoil.workflows.grading import plausibility_of

_LOAD_TOLERANCE = 0.05
_OFFSET_SHARE, _NOTABLE = 0.5, 0.01
_TORQUE_TOLERANCE = 0.10
_MIN_USED = 0.5
_MIN_SLIP_RANGE = 0.5
_LOW_R2 = 0.5
_LAWS = frozenset(EFFECTS[key].name for effects in MODELS.values() for key in effects)
"""Families of the laws that the paper's models add."""
_STOPS: dict[str, str] = {
    StopReason.CONVERGED_STEP: "the coefficients no longer move",
    StopReason.CONVERGED_COST: "no step could lower the error any further",
    StopReason.AT_BOUNDS: "a coefficient is held by its bound",
    StopReason.SINGULAR: "a combination of coefficients has no influence at all",
    StopReason.NO_PROGRESS: "no step lowered the error, although one should have",
    StopReason.MAX_ITERATIONS: "it was not at an end yet",
    StopReason.NOT_FINITE: "the model had no answer where it started",
}
"""What the reasons mean to the reader."""

_CONVERGED = (StopReason.CONVERGED_STEP, StopReason.CONVERGED_COST)
_MIN_BLOCKS = 6
_CONFIDENCE = 0.95
_RANKED = "dp"


@section("verdict", "Single-law fits: checks")
def verdict(inputs: ReportInputs) -> Contents:
    """Build the section; its numbers hold the sentence that leads the page: the diagnosis', or else the best fit's.

    `DataError` if there is neither a diagnosis nor a fit that could be judged.
    """
    found = inputs.diagnosed
    if found is None:
        blocks, numbers = _of_the_fit(inputs)
        if inputs.no_diagnosis:
            without = f"No diagnosis: {inputs.no_diagnosis}."
            blocks.insert(0, Text(without, "warning"))
            fitted = numbers["sentence"]
            numbers = {**numbers, "fit_sentence": fitted, "sentence": f"{without} {fitted}"}
        return blocks, numbers
    try:
        blocks, numbers = _of_the_fit(inputs, found)
    except DataError as error:
        blocks, numbers = [Text(f"The four models could not be judged: {error.what}.", "warning")], {}
    of_both = {
        **numbers,
        "fit_sentence": numbers.get("sentence"),
        "sentence": sentence_of(found),
        "verdict": found.verdict,
    }
    return blocks, of_both


def _of_the_fit(inputs: ReportInputs, diagnosis: Diagnosis | None = None) -> tuple[list[Block], dict[str, Any]]:
    """Return which of the four models predicts best, and whether to trust it; a diagnosis has the last word."""
    ranking = rank(inputs)
    checks = [check for check in _checks(inputs, ranking) if check.text]
    concerns = sum(check.kind == "warning" for check in checks)
    sentence = " ".join(fit_sentences(inputs, ranking))
    trust = _trust(concerns) if diagnosis is None else _beside(diagnosis, concerns)
    text = trust if diagnosis is None else f"Fitted by themselves: {sentence} {trust}"
    blocks: list[Block] = [Text(text), *sorted(checks, key=lambda check: check.kind == "good")]
    if diagnosis is not None and diagnosis.gain is not None and "dp" in diagnosis.gain.base:
        blocks.insert(1, Text(_two_errors(inputs, ranking, diagnosis.gain)))
    numbers = {
        "sentence": sentence,
        "trust": trust,
        "best": ranking.best.name,
        "R0_N": ranking.r0_n,
        "rivals": ranking.rivals,
        "checks": [{"good": check.kind == "good", "text": check.text} for check in checks],
    }
    return blocks, numbers


def fit_headline(ranking: Ranking) -> str:
    """Return which model predicts best, in one short sentence."""
    error, wong = f"{number(ranking.r0_n)} N", ranking.rival("wong")
    if wong is None or not wong.is_worse:
        return f"No slip-sinkage law predicts the drawbar pull detectably better than Wong's model (error {error})."
    gain = number(100 * (1 - ranking.r0_n / wong.r0_n), 2)
    return f"{upper(_model(ranking.best.name))} predicts the drawbar pull best: {gain} % less error than Wong's model."


def fit_sentences(inputs: ReportInputs, ranking: Ranking) -> list[str]:
    """Return which model predicts best, in sentences."""
    best, fit = _model(ranking.best.name), inputs.fit
    over = f"at slips from {number(fit.slip_threshold, 2)} on"
    error = f"{number(ranking.r0_n)} N (root mean square)"
    wong = ranking.rival("wong")
    equal = [rival.name for rival in ranking.rivals if not rival.is_worse]
    if wong is None:
        text = f"Wong's model, without slip sinkage, predicts the drawbar pull best: it is off by {error} {over}."
    elif not wong.is_worse:
        text = (
            f"On these runs no slip-sinkage law predicts the drawbar pull detectably better than Wong's model: "
            f"{best} is off by {error} {over}, Wong's by {number(wong.r0_n)} N."
        )
        equal.remove("wong")
    else:
        gain = 100 * (1 - ranking.r0_n / wong.r0_n)
        text = (
            f"{upper(best)} follows the drawbar pull best, on the runs it was fitted to: it is off by "
            f"{error} {over}, {number(gain, 2)} % less than Wong's model ({number(wong.r0_n)} N)."
        )
    names = listed([_model(name, short=True) for name in equal])
    return [text, f"{names} fit equally well on these runs."] if equal else [text]


def _model(name: str, *, short: bool = False) -> str:
    """Return a model as it is called in a sentence."""
    if name in (EXTENDED, CHOSEN):
        return f"the {name} model"
    return f"{style(name).label}'s" + ("" if short else " model")


def _beside(found: Diagnosis, concerns: int) -> str:
    """Return what the diagnosis leaves of the fit's result: there are not two verdicts."""
    named = [cause.name for cause in found.causes]
    if found.verdict == "named" and _LAWS & set(named):
        return f"The diagnosis names slip sinkage too. {_trust(concerns)}"
    finding = {
        "named": f"The diagnosis names {listed([plain_name(name) for name in named])} and no slip sinkage",
        "one_of": "The diagnosis cannot separate the possible causes",
        "unexplained": "The diagnosis finds nothing known that explains these runs",
        "nothing_detectable": "The diagnosis is sure of no cause in these runs",
    }[found.verdict]
    return (
        f"{finding}: a law of slip sinkage that follows best here is a curve that fits, and its coefficients are not "
        "to be relied on."
    )


def _two_errors(inputs: ReportInputs, ranking: Ranking, gain: Gain) -> str:
    soil = "re-calibrated too" if inputs.fit.options.soil_prior else "as the laboratory states it"
    return (
        f"Two errors of one channel: {number(ranking.r0_n)} N is over all samples of runs that the model was fitted "
        f"to, the soil {soil}; the gain's {number(gain.base['dp'].R0)} N without and "
        f"{number(gain.extended['dp'].R0)} N with what was found are over 5 Hz means of held-out runs, the "
        "soil re-calibrated. They are not to be compared with each other."
    )


def _trust(concerns: int) -> str:
    if concerns == 0:
        return (
            "None of the checks below speaks against relying on it; an error that is the same in every run "
            "(zero, angle, soil values) they cannot see."
        )
    what = "the check that is marked" if concerns == 1 else f"the {concerns} checks that are marked"
    return f"Before relying on it, read {what} below."


def _checks(inputs: ReportInputs, ranking: Ranking) -> list[Text]:
    # Repeat what makes a run implausible: R² cannot see it, and nothing else on the page is worth then.
    found = {note_text(note) for run in inputs.runs for note in plausibility_of(run)}
    return [
        _ended(ranking),
        *(
            Text(f"{style(ranking.best.name).label}: {note_text(warning)}.", "warning")
            for warning in ranking.best.notes
        ),
        _load(inputs, ranking),
        _offset(ranking),
        _follows(ranking),
        _torque(inputs, ranking),
        _coverage(inputs),
        _losses(inputs),
        *[Text(f"{text}.", "warning") for text in sorted(found)[:3]],
        *(Text(f"{note_text(note)}.", "warning") for note in inputs.fit.notes),
    ]


def _ended(ranking: Ranking) -> Text:
    reason, count = ranking.best.stop_reason, ranking.best.iterations
    if reason == "nothing_to_fit":
        return Text("Nothing was fitted in this model: the soil is the laboratory's.", "good")
    ending = _STOPS.get(reason, reason.replace("_", " "))
    kind = "good" if reason in _CONVERGED else "warning"
    advice = "" if ended(ranking.best) else f" {NOT_AT_AN_END[0].upper()}{NOT_AT_AN_END[1:]}."
    return Text(f"Gauss–Newton stopped after {count} iterations: {ending}.{advice}", kind)


def _load(inputs: ReportInputs, ranking: Ranking) -> Text:
    ratio = ranking.best.load_ratio
    if inputs.fit.options.reading == "balanced":
        return Text("Eq. 7 returns the measured load for the model's sinkage (load-consistent).", "good")
    within = max(abs(ratio.lowest - 1), abs(ratio.highest - 1)) <= _LOAD_TOLERANCE
    text = (
        f"The sinkage of the model would carry {number(ratio.lowest)} to {number(ratio.highest)} times the measured "
        f"load (Eq. 7), {number(ratio.median)} in the median"
    )
    return Text(f"{text}.", "good") if within else Text(f"{text}: its sinkage is not that of this wheel.", "warning")


def _offset(ranking: Ranking) -> Text:
    bias = -float(np.mean(ranking.error_n))
    share = bias**2 / float(np.mean(ranking.error_n**2))
    part = f"{number(100 * share, 2)} %" if share >= _NOTABLE else "Next to nothing"
    text = f"{part} of the squared error is a constant offset" + (f" of {number(bias)} N" if share >= _NOTABLE else "")
    if share <= _OFFSET_SHARE:
        return Text(f"{text}.", "good")
    return Text(f"{text}: measured − predicted; look at the transducer's zero and angle before the soil.", "warning")


def _follows(ranking: Ranking) -> Text:
    r2 = ranking.best.criteria["dp"].R2
    if not np.isfinite(r2):
        return Text(reason_text(ranking.best.criteria["dp"]), "warning")
    text = f"The prediction follows the measured drawbar pull with R² = {r2:.3f}"
    if r2 >= _LOW_R2:
        return Text(f"{text}.", "good")
    return Text(f"{text}: most of what the drawbar pull does is not in the model.", "warning")


def _torque(inputs: ReportInputs, ranking: Ranking) -> Text:
    if "t" in inputs.fit.options.channels:
        return Text("")
    try:
        measured = inputs.pool.measured("t")
    except DataError:
        return Text("The driving torque was not measured: nothing independent checks the model.", "warning")
    counted = inputs.pool.slip >= inputs.fit.slip_threshold
    size = float(np.sqrt(np.nanmean(measured[counted] ** 2)))
    share = ranking.best.criteria["t"].R0_N / size if size > 0 else np.nan
    text = f"The driving torque, which was not fitted, is predicted within {number(100 * share, 2)} % of its size"
    return Text(f"{text}.", "good" if share <= _TORQUE_TOLERANCE else "warning")


def _coverage(inputs: ReportInputs) -> Text:
    used = float(np.mean(np.concatenate([run.used for run in inputs.fitted])))
    slip = inputs.pool.slip
    low, high = float(np.min(slip)), float(np.max(slip))
    text = (
        f"{100 * used:.0f} % of the samples could be used; their slip runs from {number(low, 2)} to {number(high, 2)}"
    )
    few, narrow = used < _MIN_USED, high < _MIN_SLIP_RANGE
    if few or narrow:
        why = listed([*["many samples are missing"] * few, *["high slip was not reached"] * narrow])
        return Text(f"{text}: {why}.", "warning")
    return Text(f"{text}.", "good")


def _losses(inputs: ReportInputs) -> Text:
    lost = [source for source in inputs.sources if source.dropped_frames or source.loss]
    if not lost:
        return Text("")
    names = listed([source.run_id for source in lost])
    return Text(f"Frames are missing from {names}: see data quality.", "warning")


@dataclass(frozen=True)
class Rival:
    """Comparison of another model with the best one.

    `t` is the mean difference of the squared errors over nearly independent blocks of samples, divided by its standard
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


def rank(inputs: ReportInputs) -> Ranking:
    """Compare the models by drawbar pull above the slip threshold; `DataError` where there is nothing to compare.

    The errors of two models on one sample are paired, and neighbouring samples are correlated: the difference of the
    squared errors is averaged over blocks; their length is the longer one of the two fits.

    Source: Diebold & Mariano (1995), J. Bus. Econ. Stat. 13:253, with block means for the variance.
    """
    fit, pool = inputs.fit, inputs.pool
    scored = [m for m in fit.models if _RANKED in m.criteria and np.isfinite(m.criteria[_RANKED].R0_N)]
    if not scored:
        reasons = {reason_text(m.criteria[_RANKED]) for m in fit.models if _RANKED in m.criteria}
        raise DataError("; ".join(sorted(reasons)) or "no model has an R0")
    ordered = sorted(scored, key=lambda model: model.criteria[_RANKED].R0_N)
    measured = pool.measured(_RANKED)
    errors = {model.name: pool.predicted(model.name, OUTPUTS[_RANKED].field) - measured for model in ordered}
    counted = pool.slip >= fit.slip_threshold
    for error in errors.values():
        counted &= np.isfinite(error)
    best = ordered[0]
    rivals = []
    for other in ordered[1:]:
        length_s = float(np.nanmax([best.blocks.length_s, other.blocks.length_s]))
        difference = errors[other.name][counted] ** 2 - errors[best.name][counted] ** 2
        t, critical, blocks = _block_t(difference, pool.time_s[counted], pool.run[counted], length_s)
        rivals.append(Rival(other.name, other.criteria[_RANKED].R0_N, t, critical, blocks))
    return Ranking(best, best.criteria[_RANKED].R0_N, tuple(rivals), errors[best.name][counted])


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
    critical = float(scipy.special.stdtrit(blocks - 1, _CONFIDENCE))
    return (float(mean / error) if error > 0 else float("nan")), critical, blocks
