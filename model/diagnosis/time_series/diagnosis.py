"""Diagnosis of campaigns from the samples of their runs.

Linearised campaigns (samples, noise model, whitening, linearised again at the best) -> adequacy -> probabilities over
resampled runs -> gain on held-out runs -> verdict -> final parameters with the whole model -> next run -> plot data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import Fault, Note, Severity
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.consistency import inconsistencies
from model.diagnosis.core.hypotheses import Posterior, candidates, likely_sets
from model.diagnosis.core.naming import Judgement, confirmed, judgement
from model.diagnosis.core.result import (
    Adequacy,
    Cause,
    Clock,
    Detectable,
    Diagnosis,
    Finding,
    Gain,
    Grounds,
    NextRun,
    undecided,
)
from model.diagnosis.findings.adequacy import adequacy, excess, findings
from model.diagnosis.findings.agreement import disagreement_notes, disagreements, other_forms, runs_of, two_soils
from model.diagnosis.findings.explained import Explained, Fits, LookAlike, explain, imitating, look_alikes, plot_data_of
from model.diagnosis.findings.held_out import bagged, held_out
from model.diagnosis.findings.isolability import detectable_in_runs
from model.diagnosis.findings.proposal import propose_for
from model.diagnosis.findings.set_fit import parameters_of
from model.diagnosis.planning.next_run import members_of, next_runs, plausible_grams
from model.diagnosis.time_series.evidence import posterior
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, linearise_campaigns
from model.diagnosis.time_series.noise import Noise
from model.diagnosis.time_series.samples import samples_of
from model.diagnosis.time_series.start import unfit
from model.effects.catalogue import EFFECTS
from model.notes import DiagnosisCode, LackCode
from model.one_thread import one_thread


@one_thread
def diagnose(
    campaigns: Sequence[Campaign], options: DiagnosisOptions | None = None, noises: Sequence[Noise] | None = None
) -> Diagnosis:
    """Diagnose one or several campaigns: what the simulation gets wrong, its cause, what the extension is worth.

    Parameters
    ----------
    campaigns : sequence of Campaign
        Causes are shared, soils are not. One with too little in it is left out, and said to be.
    noises : sequence of Noise, optional
        The noise model of each campaign; estimated where it is not given.

    Returns
    -------
    Diagnosis
        Where nothing can be decided, its verdict is "nothing_detectable" and its grounds say for want of what.
    """
    options = options or DiagnosisOptions()
    faults = [_unfit(c, options) for c in campaigns]
    refused = [fault for fault in faults if fault is not None]
    kept = [i for i, fault in enumerate(faults) if fault is None]
    if not kept:
        return _undecided(refused, options)
    seen = linearise_campaigns([campaigns[i] for i in kept], options, [noises[i] for i in kept] if noises else None)
    return _diagnosis(seen, options, tuple(_excluded(fault) for fault in refused))


def _unfit(campaign: Campaign, options: DiagnosisOptions) -> Fault | None:
    if not campaign.runs:
        return Fault("there is no run", campaign.name, next_step="give recordings of driven runs")
    return unfit(campaign, samples_of(campaign, options.channels))


def _excluded(fault: Fault) -> Note:
    return Note(DiagnosisCode.CAMPAIGN_EXCLUDED, Severity.DOUBT, {"fault": fault})


def _undecided(faults: Sequence[Fault], options: DiagnosisOptions) -> Diagnosis:
    """Return a diagnosis that says what was wanting."""
    families = dict.fromkeys(EFFECTS[key].name for key in options.effects if key in EFFECTS)
    why = Note(LackCode.NOTHING_USABLE, Severity.FAULT, {"faults": tuple(faults)})
    return undecided(why, dict.fromkeys(families, why), tuple(_excluded(fault) for fault in faults))


@dataclass(frozen=True)
class _Weighed:
    """What the numbers say, before words."""

    judged: Adequacy
    found: Posterior
    sizes: dict[str, Detectable]
    gain: Gain | None
    verdict: Judgement
    wrong: list[Finding]


def _diagnosis(seen: LinearisedCampaign, options: DiagnosisOptions, notes: tuple[Note, ...]) -> Diagnosis:
    clock, rng = Clock(), np.random.default_rng(options.seed)
    with clock.stage("adequacy"):
        judged, factor = _judged(seen, options, rng)
    fits = Fits(seen, "several" if judged.ok else "one")
    weighed, remarks = _weighed(seen, options, judged, factor, fits, clock, rng)
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
        shown = plot_data_of(seen, fits[()], fits[explained.extended], explained.sizes, alone)
        disputes = _disputes(seen, verdict, explained, fits)
        one_campaign = verdict.verdict == "unexplained" and len(seen.views) == 1
        grounds = Grounds(
            barred=verdict.barred,
            beside=verdict.beside,
            look_alikes=tuple(one.family for one in alike),
            most_probable=tuple(EFFECTS[key].name for key in seen.best.keys),
            terrains=two_soils(seen.grams) if one_campaign else None,
            cautions=disputes,
        )
    few = (Note(DiagnosisCode.FEW_RUNS),) if not found.calibrated else ()
    return Diagnosis(
        verdict=verdict.verdict,
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
        notes=tuple(dict.fromkeys((*notes, *seen.notes, *few, *remarks, *disputes))),
        sets=likely_sets(found),
        noise=_noise(seen),
        soils=explained.soils,
        seen=shown,
        stages_s={**seen.stages_s, **clock.stages_s},
        grounds=grounds,
    )


def _judged(seen: LinearisedCampaign, options: DiagnosisOptions, rng: np.random.Generator) -> tuple[Adequacy, float]:
    """Judge the most probable set under realistic instrument noise; return also the factor on the noise's variance."""
    judged = adequacy(seen.grams, seen.best.keys, rng)
    factor = excess(seen.grams, seen.best.keys)
    grams = plausible_grams(seen)
    if judged.ok and grams is not seen.grams:
        judged = adequacy(grams, posterior(grams, seen.excluded, options.most_causes).best(), rng)
    return judged, factor


def _weighed(
    seen: LinearisedCampaign,
    options: DiagnosisOptions,
    judged: Adequacy,
    factor: float,
    fits: Fits,
    clock: Clock,
    rng: np.random.Generator,
) -> tuple[_Weighed, tuple[Note, ...]]:
    """Weigh the sets, test them on left-out runs; return also what is to be remarked of the gain."""
    with clock.stage("bagging"):
        found = bagged(seen.grams, rng, seen.excluded, options.most_causes, factor)
        sizes = detectable_in_runs(seen.grams, seen.excluded, options.name_at, factor)
    gain: Gain | None = None
    remarks: tuple[Note, ...] = (Note(DiagnosisCode.NOTHING_TO_TEST),)
    if judged.ok:
        with clock.stage("held_out"):
            gain, remarks = held_out(seen, options, fits=fits.of((), seen.best.keys))
    verdict = judgement(found, judged, gain, seen.cannot_tell, options.name_at, seen.converged)
    with clock.stage("where"):
        unnamed = verdict.verdict == "unexplained"
        left_by = seen.best.keys if unnamed else ()
        wrong = findings(seen.grams, seen.views, left_by, factor, inputs=unnamed)
    return _Weighed(judged, found, sizes, gain, verdict, wrong), remarks


def _onward(
    seen: LinearisedCampaign,
    options: DiagnosisOptions,
    verdict: Judgement,
    found: Posterior,
    explained: Explained,
    alike: tuple[LookAlike, ...],
) -> tuple[NextRun, ...]:
    """Return the runs to drive next: to separate a set, a name from its rivals, or on request the most probable."""
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


def _disputes(seen: LinearisedCampaign, verdict: Judgement, explained: Explained, fits: Fits) -> tuple[Note, ...]:
    """Return what joint campaigns disagree about: the size of a cause, or its form.

    Asked of the named causes, and of the most probable set where nothing explains the campaigns together.
    """
    causes = explained.causes
    if verdict.verdict == "unexplained":
        values = parameters_of(fits[seen.best.keys], seen) if len(seen.views) > 1 else {}
        effects = {key: EFFECTS[key] for key in values}
        causes = tuple(Cause(e.name, e.form, e.kind, key, 0.0, 0.0, values[key]) for key, e in effects.items())
    if verdict.verdict not in ("named", "unexplained") or len(seen.views) < 2:
        return ()
    runs = runs_of(seen)
    return disagreement_notes(disagreements(seen.grams, runs, causes), other_forms(seen.grams, runs, causes))


def _noise(seen: LinearisedCampaign) -> dict[str, float]:
    """Return the hyper-parameters; with several campaigns behind each one's name."""
    if len(seen.views) == 1:
        return dict(seen.views[0].noise.values)
    return {f"{v.campaign.name}: {name}": x for v in seen.views for name, x in v.noise.values.items()}
