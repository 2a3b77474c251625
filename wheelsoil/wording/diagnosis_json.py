"""A diagnosis as the mapping that other programs read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from daq import Note
from model import DiagnosisCode, LackCode
from model.diagnosis import Shape
from model.effects import parted
from wheelsoil.wording.grounds_text import chances_of
from wheelsoil.wording.names import NOT_IDENTIFIABLE, place_text
from wheelsoil.wording.notes import note_text, step_text, texts_of
from wheelsoil.wording.verdict import like_radius, sentence_of

if TYPE_CHECKING:
    from model.diagnosis import Cause, Diagnosis, Finding, Gain, NextRun, Plan, Scores

_SCHEMA = "wheelsoil/diagnosis/1"
_PLAN_SCHEMA = "wheelsoil/plan/1"


def diagnosis_json(found: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as plain mappings; NaN stays NaN, for the writer to turn into null."""
    free = found.grounds.free_form
    lacking = {family: note_text(why) for family, why in found.not_identifiable.items()}
    return {
        "schema": _SCHEMA,
        "verdict": found.verdict,
        "sentence": sentence_of(found),
        "causes": [_cause_json(cause, why) for cause, why in found.stated],
        "further_causes": [_further(family, found) for family in found.grounds.beside],
        "candidates": [{**_family_json(c.name), "probability": c.probability} for c in found.candidates],
        "sets": [{"causes": list(cause_set.causes), "probability": cause_set.probability} for cause_set in found.sets],
        "what_is_wrong": [_finding(finding, found.median_there(finding)) for finding in found.what_is_wrong],
        "gain": None if found.gain is None else _gain_json(found.gain),
        "inconsistent": [{**vars(item), "why": note_text(item.why)} for item in found.inconsistent],
        "adequacy": None if found.adequacy is None else vars(found.adequacy),
        "linearisation": None if found.linearisation is None else vars(found.linearisation),
        "reason": None if found.grounds.barred is None else _reason(found.grounds.barred),
        "proposal": None if found.proposal is None else vars(found.proposal),
        "minimum_detectable": {key: vars(size) for key, size in found.minimum_detectable.items()},
        "next_run": [next_run_json(run) for run in found.next_run],
        **dict.fromkeys(NOT_IDENTIFIABLE, lacking),
        "notes": texts_of(found.notes),
        "noise": found.noise,
        "soils": [{**vars(soil), "off_laboratory_sigmas": soil.off_laboratory} for soil in found.soils],
        "lack_of_fit": [_finding(finding, found.median_there(finding)) for finding in found.grounds.lack_of_fit.worst],
        "lack_of_fit_rms": found.grounds.lack_of_fit.rms,
        "free_form": None if free is None else {"family": free[0], "over": free[1]},
        "prior_sensitivity": [
            {**vars(shift), "families": list(shift.families)} for shift in found.grounds.prior_shifts
        ],
        "stages_s": found.stages_s,
        **({"static": [check.model_dump(exclude_none=True) for check in found.static]} if found.static else {}),
        **({"corrected": [vars(correction) for correction in found.corrected]} if found.corrected else {}),
        **({"like_radius": [dict(note.values) for note in alike]} if (alike := like_radius(found)) else {}),
        **(
            {"more_alike": more}
            if (more := [dict(n.values) for n in found.grounds.cautions if n.code == DiagnosisCode.MORE_ALIKE])
            else {}
        ),
        **({"laboratory": _laboratory(found)} if found.grounds.refuted_soil or found.grounds.soil_instead else {}),
        **({"error_of_form": _form_errors(found)} if found.grounds.form_errors else {}),
    }


def next_run_json(run: NextRun) -> dict[str, Any]:
    """Return what to drive or measure next: the sentence, and its facts."""
    return {
        "change": step_text(run),
        "step": str(run.step.code),
        "values": dict(run.step.values),
        "campaign": run.campaign or None,
        "separates": list(run.separates),
        "expected_log_bayes_factor": run.expected_log_bayes_factor,
        "cost_runs": run.cost_runs,
        "naming_chance": run.naming_chance,
        **({"naming_barred": str(run.naming_barred)} if run.naming_barred else {}),
    }


def _reason(why: Note) -> dict[str, Any]:
    """Return a reason (of a family that is not named, of data that stay unexplained) as code, sentence and values."""
    return {"code": str(why.code), "text": note_text(why), "values": dict(why.values)}


def _laboratory(found: Diagnosis) -> dict[str, Any]:
    """Return laboratory values that the runs refute, and those whose error may replace a named cause."""
    return {
        "refuted": [vars(refuted) for refuted in found.grounds.refuted_soil],
        "in_place_of": [{"family": rival.family, **vars(rival.soil)} for rival in found.grounds.soil_instead],
    }


def _form_errors(found: Diagnosis) -> dict[str, Any]:
    """Return the error of form that the verdict of a table assumes, and what a different one would change.

    `turned`: the verdicts with half and with twice this error, if they differ; `adequate_at`: the error with which an
    unexplained table would have an adequate explanation.
    """
    turned = found.grounds.form_matters
    code, values = (turned.code, turned.values) if turned else (None, {})
    return {
        "channels": {
            form_error.channel: {k: v for k, v in vars(form_error).items() if k != "channel"}
            for form_error in found.grounds.form_errors
        },
        "turned": {how: list(families) for how, families in values.items()} if code == LackCode.FORM_DECIDES else {},
        "adequate_at": dict(values) if code == LackCode.FORM_ADEQUATE else None,
    }


def _further(family: str, found: Diagnosis) -> dict[str, Any]:
    """Return a family that probably acts beside the named ones; `barred` is None where only its probability bars it."""
    why = (found.not_identifiable | found.grounds.reasons).get(family)
    return {
        "name": family,
        "probability": chances_of(found).get(family),
        "barred": None if why is None else _reason(why),
    }


def _finding(found: Finding, median: float) -> dict[str, Any]:
    """Return a residual, and of one at one of several wheels that wheel."""
    wheel = found.place.wheel if isinstance(found.place, Shape) else ""
    return {
        **({"wheel": wheel} if wheel else {}),
        "channel": found.channel,
        "where": place_text(found.place),
        "size": found.size,
        "statistic": found.statistic,
        "median_there": median,
    }


def _family_json(name: str) -> dict[str, str]:
    """Return a family, and of one that acts at one of several wheels alone that wheel."""
    family, wheel = parted(name)
    return {"wheel": wheel, "name": family} if wheel else {"name": family}


def _cause_json(cause: Cause, why: Note | None) -> dict[str, Any]:
    return {
        **_family_json(cause.name),
        "form": cause.form,
        "kind": cause.kind,
        "probability": cause.probability,
        "form_probability": cause.form_probability,
        "parameters": [
            {"name": p.name, "unit": p.unit, "value": p.value, "interval95": list(p.interval95)}
            for p in cause.parameters
        ],
        **({"barred": _reason(why)} if why else {}),
    }


def _gain_json(gain: Gain) -> dict[str, Any]:
    def scores(found: dict[str, Scores]) -> dict[str, Any]:
        pull = found.get("dp")
        top = {"R0_N": pull.R0, "M0_percent": pull.M0_percent, "R2": pull.R2} if pull else {}
        of_a_run = next((score.log_likelihood for score in found.values()), float("nan"))  # each channel has the same
        return {
            **top,
            "log_likelihood_of_a_run": of_a_run,
            "channels": {channel: vars(s) for channel, s in found.items()},
        }

    return {
        "held_out": {"base": scores(gain.base), "extended": scores(gain.extended)},
        "reduction_percent": gain.reduction_percent,
        "interval95": list(gain.interval95),
        "reductions": {
            channel: {"percent": reduction.percent, "interval95": list(reduction.interval95)}
            for channel, reduction in gain.reductions.items()
        },
        "expected_R0": gain.expected,
        "log_likelihood_gain": gain.log_likelihood_gain,
        "chosen": [list(keys) for keys in gain.chosen],
    }


def plan_json(plan: Plan) -> dict[str, Any]:
    """Return a plan as plain mappings; infinite stays infinite, for the writer to turn into null."""
    found = plan.isolability
    return {
        "schema": _PLAN_SCHEMA,
        "effects": [
            {
                "name": family,
                "key": key,
                "left_by_soil": float(left),
                "d": float(d),
                "d_sep": float(apart),
                "nearest": rival,
                "minimum_detectable": vars(plan.minimum_detectable[key]),
                "minimum_separable": vars(plan.minimum_separable[key]),
            }
            for key, family, left, d, apart, rival in zip(
                found.keys, found.families, found.left, found.deviation, found.separation, found.rivals, strict=True
            )
        ],
        "cosine": found.cosine.tolist(),
        "look_alikes": [
            {"families": list(advice.families), "next_run": [next_run_json(run) for run in advice.next_runs]}
            for advice in plan.confounded
        ],
        **dict.fromkeys(NOT_IDENTIFIABLE, plan.not_identifiable),
        "notes": list(plan.notes),
    }
