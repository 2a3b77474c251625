"""What stands behind a verdict: causes with their sizes, the soil with them, confounded causes, and data for figures.

A cause is confounded with one of the verdict where their signatures are nearly equal once the soil is projected out.
The figures show what was measured, what is simulated without and with the causes, and what each candidate changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from daq import FloatArray
from model.diagnosis.core.hypotheses import LEVEL, Posterior, cause_of, most_probable_form
from model.diagnosis.core.naming import Judgement
from model.diagnosis.core.plot_data import PlotData
from model.diagnosis.core.result import Cause, SoilEstimate
from model.diagnosis.findings.isolability import CONFOUNDED_COSINE, isolability
from model.diagnosis.findings.set_fit import SetFit, fit_sets, parameters_of, soils_of, spread_of
from model.diagnosis.findings.wheel_orders import wheel_orders_of
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import estimate
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign
from model.diagnosis.time_series.noise import variance

Sizes = Mapping[str, FloatArray]
"""Coefficients of each effect, in units of the prior scale, by its key."""

Keys = tuple[str, ...]

_MOST_FITTED = 6
"""Members of a set that are fitted each on its own; those beyond are listed by name only."""
_MOST_SHOWN = 6


def plot_data_of(
    linearised: LinearisedCampaign, base: SetFit, extended: SetFit, shown: Sizes, alone: Mapping[str, SetFit]
) -> tuple[PlotData, ...]:
    """Return the data of each campaign for figures.

    `base` has the soil alone, `extended` the causes. `shown` has the coefficients of the candidates whose signatures
    are drawn. What those in `alone`, fitted each by itself, change is what the whole model says, with the soil fitted
    anew, and not what the linearised one does.
    """
    return tuple(
        _plot_data(linearised, index, base, extended, shown, alone) for index in range(len(linearised.campaigns))
    )


def _plot_data(
    linearised: LinearisedCampaign,
    index: int,
    base: SetFit,
    extended: SetFit,
    shown: Sizes,
    alone: Mapping[str, SetFit],
) -> PlotData:
    data = linearised.campaigns[index]
    samples, at = data.samples, data.samples.conditions
    channels, starts_ns = data.linear.channels, np.array([run.start_ns for run in data.campaign.runs])
    without = _predicted(base, index)
    of_noise = variance(data.linear, samples, data.noise.values, data.speed_variance)
    fitted = {key: _predicted(fit, index) for key, fit in alone.items() if key in shown}
    changes = {key: {c: x - without[c] for c, x in predicted.items()} for key, predicted in fitted.items()}
    return PlotData(
        campaign=data.campaign.name,
        runs=samples.run_names,
        run=samples.run,
        time_s=samples.time_s,
        since_first_run_s=1e-9 * (starts_ns - starts_ns.min())[samples.run] + samples.time_s,
        campaign_time=np.asarray(at.campaign_time),
        slip=np.asarray(at.slip),
        ground_speed_mps=np.asarray(at.ground_speed_mps),
        vertical_load_n=np.asarray(at.vertical_load_n),
        line_position=np.asarray(at.line_position),
        measured={c: samples.measured[c] for c in channels},
        base=without,
        extended=_predicted(extended, index),
        base_sigma=dict(zip(channels, np.sqrt(of_noise), strict=True)),
        signatures={
            key: changes.get(key) or dict(zip(channels, _signature(linearised, index, key, size), strict=True))
            for key, size in shown.items()
        },
        wheel_orders=wheel_orders_of(linearised, index),
    )


def _predicted(fit: SetFit, index: int) -> dict[str, FloatArray]:
    """Return what a fitted model says at the measured slip."""
    part, point = fit.problem.parts[index], fit.problem.points(fit.estimate)[index]
    return dict(zip(part.frozen.channels, part.at_measured_slip(point), strict=True))


def _signature(linearised: LinearisedCampaign, index: int, key: str, size: FloatArray) -> FloatArray:
    """Return what a cause changes in a campaign, less what the re-calibrated soil can imitate, shape (c, n)."""
    grams: Grams = linearised.grams
    data = linearised.campaigns[index]
    own = list(grams.columns_of(key))
    total = grams.total
    soil = grams.soil_columns
    imitated = np.linalg.solve(np.eye(len(grams.soil)) + total[soil, soil], total[soil, own] @ size)
    mine = imitated[linearised.soil_of(index)]
    changed = np.zeros(data.linear.value.shape)
    units = {(grams.causes[c - grams.cause_columns.start].parameter): (c, s) for c, s in zip(own, size, strict=True)}
    for i, cause in enumerate(data.columns.causes):
        if cause.key == key:
            column, coefficient = units[cause.parameter]
            scale = grams.causes[column - grams.cause_columns.start].scale
            changed += data.linear.causes[..., i] * scale * coefficient
    return np.asarray(changed - data.linear.soil @ mine)


@dataclass(frozen=True)
class Explained:
    """Causes of a verdict.

    Attributes
    ----------
    causes : tuple of Cause
        The named ones, fitted together, or the members of a set, each, with those that act for sure.
    extended : tuple of str
        Keys of the causes that the extended model has: the named ones, the most probable member of a set, the
        most probable set where nothing explains the data; empty where nothing is detected.
    sizes : mapping key -> array
        Coefficients of the causes, and of the most probable others, in units of the prior scale.
    soils : tuple of SoilEstimate
        With the extended model's causes.
    """

    causes: tuple[Cause, ...]
    extended: Keys
    sizes: dict[str, FloatArray]
    soils: tuple[SoilEstimate, ...]


class Fits:
    """Sets of causes fitted with the whole model, each once.

    Attributes
    ----------
    starts : "one" or "several"
        "one" where nothing explains the data, so that no size is more than a place to look from.
    """

    def __init__(self, linearised: LinearisedCampaign, starts: Literal["one", "several"] = "several") -> None:
        self.linearised = linearised
        self.starts = starts
        self.known: dict[Keys, SetFit] = {}

    def __getitem__(self, keys: Keys) -> SetFit:
        self.fit(keys)
        return self.known[keys]

    def fit(self, *sets: Keys) -> None:
        """Fit sets that are going to be asked for, in parallel."""
        new = [keys for keys in dict.fromkeys(sets) if keys not in self.known]
        self.known |= fit_sets(self.linearised, new, starts=self.starts)


def explain(fits: Fits, verdict: Judgement, found: Posterior) -> Explained:
    """Fit what a verdict is about: the named causes, and of a set each member, with those that act for sure."""
    linearised = fits.linearised
    keys = tuple(most_probable_form(found, family) for family in verdict.families)
    extended = _extended(linearised, verdict, keys)
    chances, order = found.families(), [c.key for c in linearised.grams.causes]
    named = verdict.verdict == "named"
    sure = [most_probable_form(found, f) for f, p in chances.items() if p > LEVEL and (named or f in verdict.families)]
    sets = {
        key: together if found.hypotheses.position(together) is not None else extended if named else (key,)
        for key in keys[:_MOST_FITTED]
        for together in [tuple(sorted({*(keys if named else (key,)), *sure}, key=order.index))]
    }
    fits.fit((), extended, *sets.values())
    whole = fits[extended]
    spread = spread_of(whole.problem, whole.estimate, linearised, extended)
    values = {
        members: parameters_of(fits[members], linearised, spread if extended == members else None)
        for members in dict.fromkeys(sets.values())
    }
    sizes = {key: fits[members].sizes[key] for key, members in sets.items()}
    causes = tuple(
        cause_of(found, family, key, values[sets[key]][key] if key in sets else ())
        for family, key in zip(verdict.families, keys, strict=True)
    )
    return Explained(causes, extended, sizes | _others(linearised, found, sizes), soils_of(whole, linearised, spread))


def _extended(linearised: LinearisedCampaign, verdict: Judgement, keys: Keys) -> Keys:
    if verdict.verdict == "named":
        order = [c.key for c in linearised.grams.causes]
        return tuple(sorted(keys, key=order.index))
    if verdict.verdict == "one_of":
        return keys[:1]
    return linearised.best.keys if verdict.verdict == "unexplained" else ()


def _others(linearised: LinearisedCampaign, found: Posterior, known: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the linear sizes of the most probable families that were not fitted."""
    sizes: dict[str, FloatArray] = {}
    for family in found.families():
        if len(known) + len(sizes) >= _MOST_SHOWN:
            break
        key = most_probable_form(found, family)
        if key not in known:
            alone = estimate(linearised.grams, (key,))
            sizes[key] = alone.coefficients[list(alone.columns)]
    return sizes


@dataclass(frozen=True)
class Confounded:
    """A family that would look almost as one of the verdict's does.

    Attributes
    ----------
    family, key : str
        Of the other, by its most similar form.
    of : str
        Key of the verdict's cause.
    """

    family: str
    key: str
    of: str
    cosine: float


def confounded_causes(grams: Grams, found: Posterior, verdict: Judgement) -> tuple[Confounded, ...]:
    """Return the families confounded with the named causes, or with a set's most probable member, closest first."""
    own = verdict.families if verdict.verdict == "named" else verdict.families[:1]
    apart = isolability(grams)
    confounded = []
    for family in own:
        key = most_probable_form(found, family)
        across = apart.cosine[apart.keys.index(key)]
        confounded += [
            Confounded(other, apart.keys[j], key, float(across[j]))
            for j, other in enumerate(apart.families)
            if other not in verdict.families and across[j] > CONFOUNDED_COSINE
        ]
    first: dict[str, Confounded] = {}
    for rival in sorted(confounded, key=lambda c: -c.cosine):
        first.setdefault(rival.family, rival)
    return tuple(first.values())


def coefficients_in_place_of(grams: Grams, named: Sequence[str], confounded: Confounded) -> FloatArray:
    """Return the coefficients that a confounded cause would have in place of the named one, the others kept."""
    keys = (*(key for key in named if key != confounded.of), confounded.key)
    refitted = estimate(grams, keys)
    return np.array([refitted.coefficients[i] for i in refitted.columns if grams.causes[i].key == confounded.key])
