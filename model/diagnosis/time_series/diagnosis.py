"""Diagnosis of campaigns from the samples of their runs.

Linearised campaigns (samples, noise model, whitening, linearised again at the best) -> adequacy -> probabilities over
resampled runs -> gain on held-out runs -> verdict -> final parameters with the whole model -> next run -> plot data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import Fault, Note, Severity
from model.cores import one_thread
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.clock import Clock
from model.diagnosis.core.consistency import inconsistencies
from model.diagnosis.core.hypotheses import Posterior, candidates, likely_sets, notes_of_more_alike, probable_sets
from model.diagnosis.core.naming import (
    BESIDE_USUAL,
    Judgement,
    asked_again,
    barred_causes,
    beside_formed,
    confirmed,
    is_physical,
    judgement,
    less_beside_usual,
    prior_shifts,
    unshown,
)
from model.diagnosis.core.result import (
    Adequacy,
    Cause,
    Detectable,
    Diagnosis,
    Finding,
    Gain,
    Grounds,
    LackOfFit,
    NextRun,
    PriorShift,
    undecided,
)
from model.diagnosis.findings.adequacy import (
    DOUBTFUL,
    Unlisted,
    adequacy,
    excess,
    findings,
    lack_of_fit,
    over_noises,
    unlisted,
)
from model.diagnosis.findings.agreement import (
    disagreement_notes,
    disagreements,
    other_forms,
    runs_apart,
    runs_of,
    static_disputes,
    two_soils,
)
from model.diagnosis.findings.averaging import MOST_SETS, average_of
from model.diagnosis.findings.explained import (
    Confounded,
    Explained,
    Fits,
    coefficients_in_place_of,
    confounded_causes,
    explain,
    plot_data_of,
)
from model.diagnosis.findings.free_form import with_free_form
from model.diagnosis.findings.held_out import bagged, cancelling, held_out
from model.diagnosis.findings.isolability import detectable_in_runs
from model.diagnosis.findings.laboratory import ASKED_AT, refuted_soil, soil_instead
from model.diagnosis.findings.noise_models import grams_around, plausible_grams
from model.diagnosis.findings.proposal import propose_for
from model.diagnosis.findings.set_fit import of_soils, parameters_of
from model.diagnosis.findings.usual_soil import posterior_with_usual_soil, usual_effects
from model.diagnosis.planning.naming_chance import Outlook, outlook
from model.diagnosis.planning.next_run import members_of, next_runs
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, linearise_campaigns
from model.diagnosis.time_series.noise import Noise
from model.diagnosis.time_series.samples import samples_of
from model.diagnosis.time_series.standstills import corrected_zeros
from model.diagnosis.time_series.start import unfit
from model.effects.catalogue import EFFECTS
from model.notes import DiagnosisCode, LackCode


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
    faults = [_unfit(c, options.channels) for c in campaigns]
    refused = [fault for fault in faults if fault is not None]
    kept = [i for i, fault in enumerate(faults) if fault is None]
    if not kept:
        return _undecided(refused, options.effects)
    linearised = linearise_campaigns(
        [campaigns[i] for i in kept], options, [noises[i] for i in kept] if noises else None
    )
    return _diagnosis(linearised, options, tuple(_excluded(fault) for fault in refused))


def _unfit(campaign: Campaign, channels: tuple[str, ...]) -> Fault | None:
    if not campaign.runs:
        return Fault("there is no run", campaign.name, next_step="give recordings of driven runs")
    return unfit(campaign, samples_of(campaign, channels))


def _excluded(fault: Fault) -> Note:
    return Note(DiagnosisCode.CAMPAIGN_EXCLUDED, Severity.DOUBT, {"fault": fault})


def _undecided(faults: Sequence[Fault], effects: Sequence[str]) -> Diagnosis:
    """Return a diagnosis that says what was wanting."""
    families = dict.fromkeys(EFFECTS[key].name for key in effects if key in EFFECTS and not EFFECTS[key].needs.roles)
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
    lack: LackOfFit
    shifts: tuple[PriorShift, ...]
    told: tuple[Note, ...]
    against_static: tuple[Note, ...]


def _diagnosis(linearised: LinearisedCampaign, options: DiagnosisOptions, notes: tuple[Note, ...]) -> Diagnosis:
    clock, rng = Clock(), np.random.default_rng(options.seed)
    with clock.stage("adequacy"):
        judged, factor, other = _judged(linearised)
    with clock.stage("free form"):
        freed = None if judged.ok else with_free_form(linearised, other)
        if freed is not None:
            linearised, other = freed.linearised, freed.unlisted
            factor = excess(linearised.grams, linearised.best.keys)
            judged = adequacy(linearised.grams, linearised.best.keys, other)
    fits = Fits(linearised, "several" if judged.ok else "one")
    formed = "" if freed is None else EFFECTS[freed.key].name
    weighed, remarks = _weighed(fits, judged, other, factor, options.name_at, clock, rng, formed)
    verdict, found = weighed.verdict, weighed.found
    with clock.stage("final"):
        explained = explain(fits, verdict, found)
        if (after := confirmed(verdict, found, explained.causes)) != verdict:
            verdict, weighed = after, replace(weighed, verdict=after)
            explained = explain(fits, verdict, found)
        spaces = [
            (name, linearised.campaigns[i].simulation.space, linearised.soil_of(i))
            for i, name in of_soils(linearised).items()
        ]
        likely = {} if verdict.verdict == "unexplained" else probable_sets(found, MOST_SETS)
        refuted = refuted_soil(linearised.grams, spaces, likely, factor) if likely else ()
        named = explained.extended if verdict.verdict == "named" else ()
        in_place = soil_instead(
            linearised.grams,
            spaces,
            found,
            named or [cause.key for cause in explained.causes if cause.probability >= ASKED_AT],
            factor,
            named,
        )
    with clock.stage("next_run"):
        confounded = confounded_causes(linearised.grams, found, verdict)
        ahead = None
        if verdict.verdict == "one_of" and not linearised.of_vehicles:
            ahead = outlook(
                linearised.grams,
                found,
                rng,
                excess=factor,
                not_identifiable=linearised.not_identifiable | beside_formed(formed, found),
                name_at=options.name_at,
                adequate=judged.listed,
                barred=verdict.barred,
            )
        onward = _onward(linearised, verdict, found, explained, confounded, ahead, on_request=options.next_run)
    with clock.stage("proposal"):
        offered = propose_for(fits[linearised.best.keys]) if verdict.verdict == "unexplained" else None
    with clock.stage("figures"):
        alone = {keys[0]: fit for keys, fit in fits.known.items() if len(keys) == 1}
        instead = [(c.key, coefficients_in_place_of(linearised.grams, explained.extended, c)) for c in confounded[:2]]
        shown = plot_data_of(linearised, fits[()], fits[explained.extended], dict(instead) | explained.sizes, alone)
        disputes = (
            *weighed.told,
            *_disputes(linearised, verdict, explained, fits),
            *weighed.against_static,
            *runs_apart(linearised.grams, linearised.best, runs_of(linearised)),
        )
        one_campaign = verdict.verdict == "unexplained" and len(runs_of(linearised)) == 1
        grounds = Grounds(
            barred=verdict.barred,
            beside=verdict.beside,
            kept_back=barred_causes(found, verdict),
            confounded=tuple(rival.family for rival in confounded),
            most_probable=tuple(EFFECTS[key].name for key in linearised.best.keys),
            terrains=two_soils(linearised.grams) if one_campaign else None,
            lack_of_fit=weighed.lack,
            prior_shifts=weighed.shifts,
            cautions=(*notes_of_more_alike(found, verdict.verdict, verdict.families), *disputes),
            refuted_soil=refuted,
            soil_instead=in_place,
            free_form=None if freed is None else (formed, freed.over),
        )
    average = None
    if options.average and (verdict.verdict == "one_of" or verdict.beside):
        with clock.stage("average"):
            average = average_of(fits, found, options.seed, verdict.families if verdict.beside else ())
    few = () if found.calibrated else (Note(DiagnosisCode.FEW_RUNS, values={"runs": len(linearised.grams.run_names)}),)
    return Diagnosis(
        verdict=verdict.verdict,
        causes=explained.causes,
        candidates=candidates(found),
        what_is_wrong=tuple(weighed.wrong),
        gain=weighed.gain,
        inconsistent=inconsistencies([v.campaign for v in linearised.campaigns]),
        adequacy=weighed.judged,
        proposal=offered,
        minimum_detectable=weighed.sizes,
        next_run=onward,
        not_identifiable=unshown(linearised.not_identifiable, found, weighed.judged),
        notes=tuple(dict.fromkeys((*notes, *linearised.notes, *few, *remarks, *disputes))),
        sets=likely_sets(found),
        noise=_noise(linearised),
        soils=explained.soils,
        plot_data=shown,
        stages_s={**linearised.stages_s, **clock.stages_s},
        grounds=grounds,
        information=linearised.information(factor),
        linearisation=linearised.linearisation,
        average=average,
        static=tuple(test for data in linearised.campaigns for test in data.campaign.static),
        corrected=corrected_zeros([run for data in linearised.campaigns for run in data.campaign.runs]),
    )


def _judged(linearised: LinearisedCampaign) -> tuple[Adequacy, float, Unlisted]:
    """Judge the explanation under realistic instrument noise; return also the factor on the noise's variance."""
    keys, grams, most = linearised.best.keys, plausible_grams(linearised), linearised.most_causes
    found = unlisted(linearised.grams, linearised.excluded, most)
    if grams is not linearised.grams:
        strict = unlisted(grams, linearised.excluded, most)
        found = max(found, strict, key=lambda u: u.probability)
    if found.probability > DOUBTFUL:
        found = over_noises(grams_around(linearised), linearised.excluded, most)
    return adequacy(linearised.grams, keys, found), excess(linearised.grams, keys), found


def _weighed(
    fits: Fits,
    judged: Adequacy,
    other: Unlisted,
    factor: float,
    name_at: float,
    clock: Clock,
    rng: np.random.Generator,
    formed: str,
) -> tuple[_Weighed, tuple[Note, ...]]:
    """Weigh the sets, test them on left-out runs; return also what is to be remarked of the gain."""
    linearised = fits.linearised
    with clock.stage("bagging"):
        found = bagged(linearised.grams, rng, linearised.excluded, linearised.most_causes, factor)
        sizes = detectable_in_runs(linearised.grams, linearised.excluded, name_at, factor)
    gain: Gain | None = None
    remarks: tuple[Note, ...] = (Note(DiagnosisCode.NOTHING_TO_TEST),)
    if judged.ok:
        with clock.stage("held_out"):
            fits.fit((), linearised.best.keys)
            gain, remarks = held_out(linearised, fits.known)

    against = tuple(static_disputes(linearised))
    contradiction = (
        Note(LackCode.AGAINST_STATIC, values={"sigmas": against[0].values["sigmas"]})
        if against
        else cancelling(linearised)
    )

    def judge(other: Posterior) -> Judgement:
        lacking = unshown(linearised.not_identifiable, other, judged) | beside_formed(formed, other)
        rules = (other, judged, gain, lacking, name_at, linearised.converged)
        return judgement(*rules, contradiction, of_runs=True)

    verdict = judge(found)
    shifts = prior_shifts(found, verdict, judge)
    usual, told = usual_effects(linearised.grams), tuple[Note, ...]()
    if verdict.verdict == "named" and usual and any(map(is_physical, verdict.families)):
        with clock.stage("usual soil"):
            again = posterior_with_usual_soil(linearised, rng, factor, Clock())
            beside = again.families(), tuple(EFFECTS[key].name for key in usual)
            verdict = asked_again(verdict, *beside, BESIDE_USUAL)
            told = less_beside_usual(verdict, *beside, name_at)
    with clock.stage("where"):
        unnamed = verdict.verdict == "unexplained"
        left_by = linearised.best.keys if unnamed else ()
        lack = lack_of_fit(linearised.grams, linearised.campaigns, left_by, other, factor) if unnamed else LackOfFit()
        wrong = findings(linearised.grams, linearised.campaigns, left_by, factor, inputs=unnamed)
    return _Weighed(judged, found, sizes, gain, verdict, wrong, lack, shifts, told, against), remarks


def _onward(
    linearised: LinearisedCampaign,
    verdict: Judgement,
    found: Posterior,
    explained: Explained,
    confounded: tuple[Confounded, ...],
    ahead: Outlook | None,
    *,
    on_request: bool,
) -> tuple[NextRun, ...]:
    """Return the runs to drive next: to separate a set, a name from its rivals, or on request the most probable.

    Of several wheels together none: each wheel by itself says what it needs.
    """
    if linearised.of_vehicles:
        return ()
    chances = found.families()
    if verdict.verdict == "named" and confounded:
        named = [cause.key for cause in explained.causes]
        sizes = {rival.of: explained.sizes[rival.of] for rival in confounded}
        sizes |= {rival.key: coefficients_in_place_of(linearised.grams, named, rival) for rival in confounded}
    elif verdict.verdict == "one_of" or on_request:
        members = [cause.key for cause in explained.causes] if verdict.verdict == "one_of" else []
        own = members if len(members) > 1 else list(explained.sizes)
        sizes = {key: explained.sizes[key] for key in own if key in explained.sizes}
    else:
        return ()
    these = members_of(sizes, {key: chances[EFFECTS[key].name] for key in sizes})
    return next_runs(linearised, these, ahead=ahead)


def _disputes(linearised: LinearisedCampaign, verdict: Judgement, explained: Explained, fits: Fits) -> tuple[Note, ...]:
    """Return what joint campaigns disagree about: the size of a cause, or its form.

    Asked of the named causes, and of the most probable set where nothing explains the campaigns together.
    """
    causes = explained.causes
    if verdict.verdict == "unexplained":
        values = parameters_of(fits[linearised.best.keys], linearised) if len(linearised.campaigns) > 1 else {}
        effects = {key: EFFECTS[key] for key in values}
        causes = tuple(Cause(e.name, e.form, e.kind, key, 0.0, 0.0, values[key]) for key, e in effects.items())
    runs = runs_of(linearised)
    if verdict.verdict not in ("named", "unexplained") or len(runs) < 2:
        return ()
    return disagreement_notes(
        disagreements(linearised.grams, runs, causes), other_forms(linearised.grams, runs, causes)
    )


def _noise(linearised: LinearisedCampaign) -> dict[str, float]:
    """Return the hyper-parameters; with several campaigns behind each one's name."""
    if len(linearised.campaigns) == 1:
        return dict(linearised.campaigns[0].noise.values)
    return {f"{v.campaign.name}: {name}": x for v in linearised.campaigns for name, x in v.noise.values.items()}
