"""The diagnosis: all its parts in their order.

Look (samples, noise model, whitening, linearising again at the best) -> adequacy -> probabilities over resampled runs
-> gain on left-out runs -> verdict -> final parameters with the whole model -> next run -> what is seen, and said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import Fault
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.clock import Clock
from model.diagnosis.core.consistency import inconsistencies
from model.diagnosis.core.naming import Judgement, confirmed, judgement
from model.diagnosis.core.posterior import Posterior, candidates, likely_sets
from model.diagnosis.core.result import Adequacy, Cause, Detectable, Diagnosis, Finding, Gain, NextRun, undecided
from model.diagnosis.core.verdict_words import (
    disagreement_words,
    named_words,
    nothing_words,
    one_of_words,
    unexplained_words,
    want_words,
)
from model.diagnosis.findings.adequacy import adequacy, excess, two_soils
from model.diagnosis.findings.agreement import disagreements, other_forms, runs_of
from model.diagnosis.findings.explained import (
    Explained,
    Fits,
    LookAlike,
    explain,
    imitating,
    look_alikes,
    seen_of,
)
from model.diagnosis.findings.held_out import bagged, held_out
from model.diagnosis.findings.isolability import detectable_in_runs
from model.diagnosis.findings.proposal import propose_for
from model.diagnosis.findings.set_fit import parameters_of
from model.diagnosis.findings.where_wrong import findings
from model.diagnosis.planning.next_run import members_of, next_runs, plausible_grams
from model.diagnosis.time_series.evidence import posterior
from model.diagnosis.time_series.looks import Look, look
from model.diagnosis.time_series.noise import Noise
from model.diagnosis.time_series.samples import samples_of
from model.diagnosis.time_series.start import unfit
from model.effects.catalogue import EFFECTS
from model.one_thread import one_thread

NOTHING_TO_TEST = "nothing explains these runs: there is no extension whose gain could be measured"
FEW_RUNS = "fewer than three runs: probabilities could not be calibrated by drawing runs anew"


@one_thread
def diagnose(
    campaigns: Sequence[Campaign], options: DiagnosisOptions | None = None, noises: Sequence[Noise] | None = None
) -> Diagnosis:
    """Diagnose one or several campaigns: what the simulation gets wrong, its cause, what the extension is worth.

    Parameters
    ----------
    campaigns : sequence of Campaign
        Causes are shared, soils are not. One with too little in it is left out, and said to be.
    options : DiagnosisOptions, optional
    noises : sequence of Noise, optional
        The noise model of each campaign; estimated where it is not given.

    Returns
    -------
    Diagnosis
        Where nothing can be decided, its verdict is "nothing_detectable" and its sentence says for want of what.
    """
    options = options or DiagnosisOptions()
    faults = [_unfit(c, options) for c in campaigns]
    refused = [fault for fault in faults if fault is not None]
    kept = [i for i, fault in enumerate(faults) if fault is None]
    if not kept:
        return _undecided(refused, options)
    seen = look([campaigns[i] for i in kept], options, [noises[i] for i in kept] if noises else None)
    return _diagnosis(seen, options, tuple(_said(fault) for fault in refused))


def _unfit(campaign: Campaign, options: DiagnosisOptions) -> Fault | None:
    if not campaign.runs:
        return Fault("there is no run", campaign.name, next_step="give recordings of driven runs")
    return unfit(campaign, samples_of(campaign, options.channels))


def _said(fault: Fault) -> str:
    return f"{fault.where}: {fault.what}" + (f", {fault.found}" if fault.found else "") + "; left out"


def _undecided(faults: Sequence[Fault], options: DiagnosisOptions) -> Diagnosis:
    """Return a diagnosis that says what was wanting."""
    families = dict.fromkeys(EFFECTS[key].name for key in options.effects if key in EFFECTS)
    why = "; ".join(dict.fromkeys(f"{f.what} ({f.found})" if f.found else f.what for f in faults)) or "no campaign"
    onward = "; ".join(dict.fromkeys(fault.next_step for fault in faults if fault.next_step))
    sentence = f"Nothing can be decided: {why}." + (f" Next: {onward}." if onward else "")
    return undecided(sentence, dict.fromkeys(families, why), tuple(_said(fault) for fault in faults))


@dataclass(frozen=True)
class _Weighed:
    """What the numbers say, before words."""

    judged: Adequacy
    found: Posterior
    sizes: dict[str, Detectable]
    gain: Gain | None
    verdict: Judgement
    wrong: list[Finding]


def _diagnosis(seen: Look, options: DiagnosisOptions, notes: tuple[str, ...]) -> Diagnosis:
    clock, rng = Clock(), np.random.default_rng(options.seed)
    with clock.stage("adequacy"):
        judged, factor = _judged(seen, options, rng)
    fits = Fits(seen, "several" if judged.ok else "one")
    weighed, remark = _weighed(seen, options, judged, factor, fits, clock, rng)
    verdict, found = weighed.verdict, weighed.found
    with clock.stage("final"):
        explained = explain(fits, verdict, found)
        if (after := confirmed(verdict, found, explained.causes)) != verdict:
            verdict, weighed = after, replace(weighed, verdict=after)
            explained = explain(fits, verdict, found)
    with clock.stage("next_run"):
        alike = look_alikes(seen.grams, found, verdict)
        onward = _onward(seen, options, verdict, found, explained, alike)
    with clock.stage("proposal"):
        offered = propose_for(fits[seen.best.keys]) if verdict.verdict == "unexplained" else None
    with clock.stage("figures"):
        alone = {keys[0]: fit for keys, fit in fits.known.items() if len(keys) == 1}
        shown = seen_of(seen, fits[()], fits[explained.extended], explained.sizes, alone)
        disputed = _disputed(seen, verdict, explained, fits)
        said = [_sentence(seen, weighed, explained, onward, alike)]
        sentence = " ".join([*disputed, *said] if verdict.verdict == "unexplained" else [*said, *disputed])
    few = (FEW_RUNS,) if not found.calibrated else ()
    return Diagnosis(
        verdict=verdict.verdict,
        sentence=sentence,
        causes=explained.causes,
        candidates=candidates(found),
        what_is_wrong=tuple(weighed.wrong),
        gain=weighed.gain,
        inconsistent=inconsistencies([v.campaign for v in seen.views]),
        adequacy=weighed.judged,
        proposal=offered,
        minimum_detectable=weighed.sizes,
        next_run=onward,
        cannot_tell=seen.cannot_tell,
        notes=tuple(dict.fromkeys((*notes, *seen.notes, *few, *([remark] if remark else []), *disputed))),
        sets=likely_sets(found),
        noise=_noise(seen),
        soils=explained.soils,
        seen=shown,
        stages_s={**seen.stages_s, **clock.stages_s},
    )


def _judged(seen: Look, options: DiagnosisOptions, rng: np.random.Generator) -> tuple[Adequacy, float]:
    """Judge the likeliest set under noise that instruments can have; return also the factor on the noise's variance."""
    judged = adequacy(seen.grams, seen.best.keys, rng)
    factor = excess(seen.grams, seen.best.keys)
    grams = plausible_grams(seen)
    if judged.ok and grams is not seen.grams:
        judged = adequacy(grams, posterior(grams, seen.excluded, options.most_causes).best(), rng)
    return judged, factor


def _weighed(
    seen: Look,
    options: DiagnosisOptions,
    judged: Adequacy,
    factor: float,
    fits: Fits,
    clock: Clock,
    rng: np.random.Generator,
) -> tuple[_Weighed, str]:
    """Weigh the sets, test them on left-out runs; return also what is to be remarked of the gain."""
    with clock.stage("bagging"):
        found = bagged(seen.grams, rng, seen.excluded, options.most_causes, factor)
        sizes = detectable_in_runs(seen.grams, seen.excluded, options.name_at, factor)
    gain, remark = None, NOTHING_TO_TEST
    if judged.ok:
        with clock.stage("held_out"):
            gain, remark = held_out(seen, options, fits=fits.of((), seen.best.keys))
    verdict = judgement(found, judged, gain, seen.cannot_tell, options.name_at, seen.settled)
    with clock.stage("where"):
        unnamed = verdict.verdict == "unexplained"
        left_by = seen.best.keys if unnamed else ()
        wrong = findings(seen.grams, seen.views, left_by, factor, inputs=unnamed)
    return _Weighed(judged, found, sizes, gain, verdict, wrong), remark


def _onward(
    seen: Look,
    options: DiagnosisOptions,
    verdict: Judgement,
    found: Posterior,
    explained: Explained,
    alike: tuple[LookAlike, ...],
) -> tuple[NextRun, ...]:
    """Return what to drive next: to split a set, a name from its look-alikes, or on request the likeliest."""
    chances = found.families()
    if verdict.verdict == "named" and alike:
        named = [cause.key for cause in explained.causes]
        sizes = {one.of: explained.sizes[one.of] for one in alike}
        sizes |= {one.key: imitating(seen.grams, named, one) for one in alike}
    elif verdict.verdict == "one_of" or options.next_run:
        members = [cause.key for cause in explained.causes] if verdict.verdict == "one_of" else []
        own = members if len(members) > 1 else list(explained.sizes)
        sizes = {key: explained.sizes[key] for key in own if key in explained.sizes}
    else:
        return ()
    return next_runs(seen, members_of(sizes, {key: chances[EFFECTS[key].name] for key in sizes}))


def _disputed(seen: Look, verdict: Judgement, explained: Explained, fits: Fits) -> tuple[str, ...]:
    """Return in words what joint campaigns disagree about: the size of a cause, or its form.

    Asked of the named causes, and of the likeliest set where nothing explains the campaigns together.
    """
    causes = explained.causes
    if verdict.verdict == "unexplained":
        values = parameters_of(fits[seen.best.keys], seen) if len(seen.views) > 1 else {}
        effects = {key: EFFECTS[key] for key in values}
        causes = tuple(Cause(e.name, e.form, e.kind, key, 0.0, 0.0, values[key]) for key, e in effects.items())
    if verdict.verdict not in ("named", "unexplained") or len(seen.views) < 2:
        return ()
    runs = runs_of(seen)
    return disagreement_words(disagreements(seen.grams, runs, causes), other_forms(seen.grams, runs, causes))


def _sentence(
    seen: Look, weighed: _Weighed, explained: Explained, onward: tuple[NextRun, ...], alike: tuple[LookAlike, ...]
) -> str:
    verdict, found = weighed.verdict, weighed.found
    chances = found.families()
    others = tuple(one.family for one in alike)
    if verdict.verdict == "named":
        said = named_words(verdict, explained.causes, chances, weighed.gain, others, onward if alike else ())
    elif verdict.verdict == "one_of":
        said = one_of_words(verdict, chances, found.none, others, onward, likely_sets(found))
    elif verdict.verdict == "unexplained":
        best = tuple(EFFECTS[key].name for key in seen.best.keys)
        soils = two_soils(seen.grams) if len(seen.views) == 1 else None
        said = unexplained_words(weighed.judged, weighed.wrong, best, soils)
    else:
        said = nothing_words(chances, found.none, _by_family(weighed.sizes), weighed.wrong)
    return said + want_words(seen.cannot_tell)


def _by_family(sizes: dict[str, Detectable]) -> dict[str, Detectable]:
    """Return the size of each family's first form."""
    first: dict[str, Detectable] = {}
    for key, size in sizes.items():
        first.setdefault(EFFECTS[key].name, size)
    return first


def _noise(seen: Look) -> dict[str, float]:
    """Return the hyper-parameters; with several campaigns behind each one's name."""
    if len(seen.views) == 1:
        return dict(seen.views[0].noise.values)
    return {f"{v.campaign.name}: {name}": x for v in seen.views for name, x in v.noise.values.items()}
