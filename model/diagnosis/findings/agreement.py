r"""Agreement of campaigns about a shared cause, and of the runs of a campaign about one soil.

**Campaigns**: Cochran's Q on each campaign's own estimate.

A joint diagnosis takes one size of a cause for all campaigns, and one form of it. Each campaign's own size
:math:`x_c` with variance :math:`v_c`, its soil integrated out, is from its own cross products alone. If the size is
shared,

.. math:: Q = \sum_c (x_c - \bar x)^2 / v_c \sim \chi^2_{C - 1}, \qquad
          \bar x = \sum_c (x_c / v_c) / \sum_c (1 / v_c)

The variances are widened as the final interval of the shared size was (`model.diagnosis.findings.set_fit`). A form is
asked in the same way: by how many nats a campaign of its own prefers another one.

Source: Cochran (1954), Biometrics 10:101.

**Runs**: the evidence of two groups of runs, each with a soil of its own from the laboratory's prior, against one soil
for all. Every pair of groups is tested where there are few runs, else one run after the other is separated. A campaign
of two terrains explains nothing well.

**Runs apart**: a zero of its own in each run, beside the most probable causes, against those of all others: the
deleted residual, Student's with two degrees of freedom less than there are runs (Grubbs 1969, Technometrics 11:1). The
noise model takes such a run for scatter between runs, so that nothing else tells of it.

**Static tests**: each reading of the lifted or coasting wheel against what the runs alone say of the causes in it,
beside their own most probable ones. With m and v mean and variance of the reading after the runs, and u before them,
the runs' own part is m v'/v with v' = 1/(1/v - 1/u): a prior that is narrow contradicts nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import scipy

from daq import OUTPUTS, BoolArray, FloatArray, Note, Severity
from model.diagnosis.core.result import Cause, ParameterEstimate
from model.diagnosis.findings.adequacy import excess
from model.diagnosis.findings.isolability import own_columns
from model.diagnosis.findings.isolability import projected_without_soil as without_soil
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import SetEstimate, best_set, estimate, log_evidence, prior_information
from model.diagnosis.time_series.joining import runs_of as joined_runs
from model.diagnosis.time_series.linearise import SENSORS, coordinate_of
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.noise import rest_variance
from model.diagnosis.time_series.standstills import READ
from model.effects.catalogue import EFFECTS, parted
from model.notes import DiagnosisCode

AT = 0.01
"""Probability of a larger Q by chance, below which campaigns are said to disagree."""
OTHER_FORM = 3.0
"""Nats by which a campaign must prefer another form: 20 to 1."""
_LEAST_SHARE_LEFT = 1e-6
"""Share of a combination that a campaign may leave open and still estimate it."""

LEAST = 20.0
"""Nats by which two soils must be likelier than one."""

_FEW = 8
_APART = 5e-4
"""Chance that a run, of all that are looked at, is so far from the others."""
_APART_RUNS = 5
_ZEROS = {
    key: name
    for key, effect in EFFECTS.items()
    for name, channel in OUTPUTS.items()
    if effect.needs.zero_of == channel.role
}
_STATIC_SIGMAS = 4.0
_LEAST_INFORMED = 1e-3


@dataclass(frozen=True)
class Own:
    """What one campaign says of a parameter by itself: value and one-sigma."""

    campaign: str
    value: float
    sigma: float


@dataclass(frozen=True)
class Disagreement:
    """Campaigns that differ about a parameter by more than chance.

    Attributes
    ----------
    q : float
        Cochran's.
    chance : float
        Of a larger one if the parameter is shared.
    """

    parameter: str
    unit: str
    own: tuple[Own, ...]
    q: float
    chance: float


def disagreements(grams: Grams, runs: dict[str, int], causes: Sequence[Cause]) -> tuple[Disagreement, ...]:
    """Return the shared parameters about which campaigns disagree.

    The campaigns stand one after the other in `grams`; `runs` is how many runs each has, in that order. The causes are
    of one set, with their values; what has no interval is not asked.
    """
    keys = [cause.key for cause in causes]
    columns = [i for key in keys for i in own_columns(grams, key)]
    square = np.ix_(columns, columns)
    whole = without_soil(grams).information[square]
    parts = {name: without_soil(own) for name, own in _by_campaign(grams, runs)}
    found = []
    for cause in causes:
        for parameter in cause.parameters:
            direction = _direction(grams, columns, cause, parameter)
            if not np.isfinite(parameter.interval95).all() or not direction.any():
                continue
            plain = _along(whole, direction)
            widening = max(parameter.sigma / np.sqrt(plain), 1.0) if np.isfinite(plain) and plain > 0 else 1.0
            own = []
            for name, part in parts.items():
                information = part.information[square]
                variance = _along(information, direction)
                if not np.isfinite(variance):
                    continue
                size = direction @ np.linalg.pinv(information, rcond=1e-9, hermitian=True) @ part.score[columns]
                own.append(Own(name, _neutral(grams, cause, parameter) + float(size), widening * float(variance**0.5)))
            found += _judged(parameter, tuple(own))
    return tuple(found)


def other_forms(
    grams: Grams, runs: dict[str, int], causes: Sequence[Cause]
) -> dict[tuple[str, str], tuple[str, float]]:
    """Return which campaigns prefer another form of a cause: (family, campaign) -> form and nats.

    It takes what `disagreements` does.
    """
    keys = tuple(cause.key for cause in causes)
    found = {}
    for name, own in _by_campaign(grams, runs):
        for cause in causes:
            forms = dict.fromkeys(c.key for c in grams.causes if c.family == cause.name)
            nats = {form: log_evidence(own, tuple(form if key == cause.key else key for key in keys)) for form in forms}
            best = max(nats, key=lambda form: nats[form])
            if nats[best] > nats[cause.key] + OTHER_FORM:
                found[cause.name, name] = (best, nats[best] - nats[cause.key])
    return found


def runs_of(linearised: LinearisedCampaign) -> dict[str, int]:
    """Return how many runs each campaign has, in their order; of wheels of one vehicle how many drives."""
    campaigns = [(data.campaign, data.samples) for data in linearised.campaigns]
    owners = [campaigns[members[0][0]][0] for members in joined_runs(campaigns)]
    return dict(Counter(campaign.ground for campaign in owners))


def _by_campaign(grams: Grams, runs: dict[str, int]) -> Iterator[tuple[str, Grams]]:
    """Yield each campaign's own drives, without what lifted wheels read: that is of all campaigns together."""
    whose = np.repeat(np.arange(len(runs)), list(runs.values()))
    for i, name in enumerate(runs):
        yield name, replace(grams.chosen(whose == i), static=0.0)


def _direction(grams: Grams, columns: Sequence[int], cause: Cause, parameter: ParameterEstimate) -> FloatArray:
    """Return how a parameter of a cause, or the sum of all of them, goes with the columns' coefficients."""
    known = {grams.causes[i].parameter for i in own_columns(grams, cause.key)}
    wanted = {parameter.name} if parameter.name in known else known
    return np.array(
        [
            grams.causes[i].scale if grams.causes[i].key == cause.key and grams.causes[i].parameter in wanted else 0.0
            for i in columns
        ]
    )


def _neutral(grams: Grams, cause: Cause, parameter: ParameterEstimate) -> float:
    own = [grams.causes[i] for i in own_columns(grams, cause.key)]
    return next((c.neutral for c in own if c.parameter == parameter.name), sum(c.neutral for c in own))


def _along(information: FloatArray, direction: FloatArray) -> float:
    """Return the variance of a combination; infinite where the data leave it open."""
    inverse = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    left = direction - information @ (inverse @ direction)
    if float(left @ left) > _LEAST_SHARE_LEFT * float(direction @ direction):
        return float("inf")
    return float(direction @ inverse @ direction)


def _judged(parameter: ParameterEstimate, own: tuple[Own, ...]) -> list[Disagreement]:
    if len(own) < 2:
        return []
    values, variances = np.array([o.value for o in own]), np.array([o.sigma**2 for o in own])
    mean = float((values / variances).sum() / (1.0 / variances).sum())
    q = float(((values - mean) ** 2 / variances).sum())
    chance = float(scipy.special.gammaincc(0.5 * (len(own) - 1), 0.5 * q))
    return [Disagreement(parameter.name, parameter.unit, own, q, chance)] if chance < AT else []


def disagreement_notes(
    found: Sequence[Disagreement], forms: Mapping[tuple[str, str], tuple[str, float]]
) -> tuple[Note, ...]:
    """Return what joint campaigns disagree about, with their `other_forms`; nothing where they agree."""
    sizes = (
        {
            "parameter": disagreement.parameter,
            "unit": disagreement.unit,
            "own": tuple((own.campaign, own.value, own.sigma) for own in disagreement.own),
            "q": disagreement.q,
            "chance": disagreement.chance,
        }
        for disagreement in found
    )
    others = (
        {"campaign": campaign, "family": family, "form": form, "nats": nats}
        for (family, campaign), (form, nats) in forms.items()
    )
    return (
        *(Note(DiagnosisCode.DISAGREEMENT, Severity.FAULT, facts) for facts in sizes),
        *(Note(DiagnosisCode.OTHER_FORM, Severity.DOUBT, facts) for facts in others),
    )


def static_disputes(linearised: LinearisedCampaign) -> Iterator[Note]:
    """Yield the readings of static tests that contradict the runs driven; of several wheels each says its own."""
    if linearised.of_vehicles or not np.any(linearised.grams.static):
        return
    driven = replace(linearised.grams, static=0.0)
    best, whole = best_set(driven, linearised.excluded, linearised.most_causes).keys, linearised.best.keys
    driven = driven.scaled(1.0 / excess(driven, best))
    for data in linearised.campaigns:
        rests, start = data.samples.rests, 1 + len(data.columns.soil)
        variance = rest_variance(data.linear, data.samples, data.noise.values)
        causes = data.columns.rests[..., start : start + len(data.columns.causes)]
        for row, i in np.argwhere(data.columns.rests_present & rests.lifted & causes.any(axis=-1)):
            shown = {
                (c.key, c.parameter): x / c.scale for c, x in zip(data.columns.causes, causes[row, i], strict=True) if x
            }
            off, sigma = float(data.columns.rests[row, i, 0]), float(variance[row, i] ** 0.5)
            runs, of_runs = _of_runs(driven, best, shown)
            sigmas = abs(off - runs) / float(np.hypot(sigma, of_runs))
            if sigmas > _STATIC_SIGMAS:
                channel = READ[row]
                reading, applied = float(rests.measured[channel][i]), rests.applied.get(channel)
                values = {"channel": channel, "reading": reading, "sigma": sigma}
                values |= {"applied": 0.0 if applied is None else float(applied[i])}
                values |= {"runs": reading - off + runs, "runs_sigma": of_runs, "sigmas": sigmas}
                values |= {"radius_m": data.campaign.runs[0].rolling_m} if channel == "slip" else {}
                others, of_others = _of_runs(driven, whole, shown)
                if abs(off - others) <= _STATIC_SIGMAS * np.hypot(sigma, of_others):
                    values["agree"] = tuple(parted(key)[0] for key in whole)
                zeroed = any(run.quality.zeros for run in data.campaign.runs)
                yield Note(DiagnosisCode.STATIC_CONTRADICTS, Severity.FAULT, {**values, "zeroed": zeroed})


def runs_apart(grams: Grams, best: SetEstimate, runs: Mapping[str, int]) -> Iterator[Note]:
    """Yield the runs whose pull or torque is off by a constant that no other run has; the farthest of each campaign.

    `best` is the most probable set; `grams` and `runs` are as for `disagreements`.
    """
    causes = [i for i, c in enumerate(grams.causes) if parted(c.key)[0] in _ZEROS]
    for campaign, (begin, end) in zip(runs, pairwise(np.cumsum([0, *runs.values()])), strict=True):
        found = [each for cause in causes if (each := _apart(grams, best, cause, range(begin, end)))]
        found.sort(key=lambda each: each["chance"])
        if found and found[0]["chance"] < _APART:
            yield Note(
                DiagnosisCode.RUN_APART, Severity.FAULT, {"campaign": campaign if len(runs) > 1 else "", **found[0]}
            )


def _apart(grams: Grams, best: SetEstimate, cause: int, runs: range) -> dict[str, Any] | None:
    """Return the run that is farthest from the others in one column, by how much, and the chance of it."""
    at, scale, key = grams.cause_columns.start + cause, grams.causes[cause].scale, grams.causes[cause].key
    there = [run for run in runs if grams.matrices[run, at, at] > 0]
    others = len(there) - 1
    if others < _APART_RUNS - 1:
        return None
    weight = grams.matrices[there, at, at]
    left = weight * ~np.eye(len(there), dtype=bool)  # row i: of the others

    def off(known: SetEstimate) -> FloatArray:
        """Return each run's own zero less the mean of the others, and one-sigma of that by their scatter."""
        taken = np.concatenate([[1.0], -known.soil, -known.coefficients])
        sizes = scale * (grams.matrices[there, at, : len(taken)] @ taken) / weight
        means = left @ sizes / left.sum(axis=1)
        variance = (left * (sizes - means[:, None]) ** 2).sum(axis=1) / (others - 1)
        return np.array([sizes - means, np.sqrt(variance * (1 / weight + 1 / left.sum(axis=1)))])

    apart, sigma = off(best)
    i = int(np.argmax(np.abs(apart) / sigma))
    apart, sigma = off(estimate(grams.without(there[i]), best.keys))[:, i]  # soil and causes without it
    chance = 2 * len(there) * scipy.special.stdtr(others - 1, -abs(apart) / sigma)
    values = {"run": grams.run_names[there[i]], "family": key, "channel": _ZEROS[parted(key)[0]]}
    return {**values, "size": float(apart), "sigma": float(sigma), "chance": float(chance)}


def _of_runs(grams: Grams, best: tuple[str, ...], shown: Mapping[tuple[str, str], float]) -> tuple[float, float]:
    """Return what runs alone say of a reading less the applied force, and its one-sigma.

    `shown` is the change of the reading per unit of each (effect, parameter) that it shows.
    """
    keys = tuple(dict.fromkeys((*best, *(key for key, _ in shown))))
    found = estimate(grams, keys)
    own = [grams.causes[at] for at in found.columns]
    by = np.array([shown.get((c.key, c.parameter), 0.0) * c.scale for c in own])
    direction = np.r_[np.zeros(len(grams.soil)), by]
    before = float(direction**2 @ (1.0 / prior_information(grams, keys)))
    after = float(direction @ found.covariance @ direction)
    variance = 1.0 / max(1.0 / after - 1.0 / before, _LEAST_INFORMED / before)
    return float(by @ found.coefficients[list(found.columns)]) * variance / after, variance**0.5


def two_soils(grams: Grams) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the runs of the one soil and of the other, the smaller group first; None where one soil will do.

    The cross products are of one campaign, or of the wheels of one vehicle.
    """
    count, columns = len(grams.run_names), grams.soil_columns.stop
    if count < 2 or not grams.soil:
        return None
    matrices = grams.matrices[:, :columns, :columns]
    soils = columns - sum(coordinate_of(label) in SENSORS for label in grams.soil)
    gain, own = max(_groups(matrices, soils), key=lambda found: found[0])
    if gain - float(_evidence(matrices.sum(axis=0))) < LEAST:
        return None
    names = np.array(grams.run_names)
    first, second = names[own], names[~own]
    return tuple(first.tolist()), tuple(second.tolist())


def _groups(matrices: FloatArray, soils: int) -> list[tuple[float, BoolArray]]:
    """Return groups and the log evidence of each and of the other runs, each with its own soil.

    All groups of up to half of the runs, or those that parting one run at a time goes through. `soils`: number of
    columns with the residual and the soil, without the sensors'.
    """
    count, total = len(matrices), matrices.sum(axis=0)
    if count <= _FEW:
        sizes = range(1, count // 2 + 1)
        groups = [np.isin(np.arange(count), own) for size in sizes for own in combinations(range(count), size)]
        sums = np.array(groups, float) @ matrices.reshape(count, -1)
        return list(zip(_parted(sums.reshape(-1, *total.shape), total, soils).tolist(), groups, strict=True))
    found = []
    group, inside = np.zeros(count, bool), np.zeros_like(total)
    for _ in range(count // 2):
        left = np.flatnonzero(~group)
        gains = _parted(inside + matrices[left], total, soils)
        best = int(np.argmax(gains))
        group = group | (np.arange(count) == left[best])
        inside = inside + matrices[left[best]]
        found.append((float(gains[best]), group))
    return found


def _parted(sums: FloatArray, total: FloatArray, soils: int) -> FloatArray:
    """Return the log evidence of groups of runs and the runs outside each, up to a constant, shape (groups,).

    Each has its own soil; what is off in sensors, the columns behind the soils', all runs share.
    """
    own = total.shape[-1] - soils
    every = np.eye(total.shape[-1] + soils - 1)
    inside, outside = every[np.r_[:soils, len(every) - own : len(every)]], every[np.r_[0, soils : len(every)]]
    together = inside.T @ sums @ inside + outside.T @ (total - sums) @ outside
    return _evidence(together)


def _evidence(sums: FloatArray) -> FloatArray:
    """Return the log evidence of runs, up to a constant; shape (..., 1 + q, 1 + q) to (...)."""
    side = sums[..., 1:, :1]
    inner = np.eye(side.shape[-2]) + sums[..., 1:, 1:]
    explained = (side * np.linalg.solve(inner, side)).sum(axis=(-2, -1))
    return np.asarray(0.5 * (explained - sums[..., 0, 0]) - 0.5 * np.linalg.slogdet(inner)[1])
