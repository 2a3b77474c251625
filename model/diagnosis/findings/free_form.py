"""A formula set free: where nothing explains the runs, whether a listed cause does whose formula is another.

A cause may be right and its formula not: a soil that gets stiffer in a step and not along a line, a sinkage that grows
with braking in another way. What the cause changes is then multiplied by 1 + a curve, over slip, braking slip, load,
speed or place, of one-sigma `FREE` at each knot. An error of measurement has no other formula: an offset is an offset.
These hypotheses stand beside those of something unlisted (`model.diagnosis.findings.adequacy`), and share the
probability `DEPARTS`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from daq import IndexArray
from model.diagnosis.core.shapes import Kind
from model.diagnosis.findings.adequacy import LIMIT, UNLISTED, Unlisted, kinds_of
from model.diagnosis.time_series.basis import Freed
from model.diagnosis.time_series.columns import Grams, columns_of
from model.diagnosis.time_series.evidence import best_set, log_evidence_of_sets
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, joined_grams
from model.diagnosis.time_series.start import CampaignData
from model.effects.catalogue import EFFECTS

DEPARTS = 0.2
"""Probability that a cause acts by another formula than the listed ones."""
_OVER = (
    *(Kind.SLIP, Kind.BRAKING_SLIP, Kind.LOAD_DRIVING, Kind.LOAD_BRAKING),
    *(Kind.GROUND_SPEED, Kind.LINE_POSITION),
)


@dataclass(frozen=True)
class FreeForm:
    """A cause whose formula is another.

    Attributes
    ----------
    key : str
        Of the effect.
    over : str
        A `Kind`: over what it departs.
    linearised : LinearisedCampaign
        With the curve as an error of form.
    unlisted : Unlisted
        Beside it.
    """

    key: str
    over: str
    linearised: LinearisedCampaign
    unlisted: Unlisted


def with_free_form(linearised: LinearisedCampaign, other: Unlisted) -> FreeForm | None:
    """Return the physical cause of the most probable set whose formula, set free, explains one campaign, if any.

    `other` is what no cause describes, with every formula as listed.
    """
    keys = tuple(key for key in linearised.best.keys if EFFECTS[key].kind == "physical")
    if len(linearised.campaigns) > 1 or not keys:
        return None
    freed = replace(_with(linearised, frozenset((key, kind) for key in keys for kind in _OVER)).grams, own=())
    kinds = [shapes for shapes in kinds_of(freed.basis) if freed.basis[shapes[0]].cause]
    if not kinds:
        return None

    excluded, most = linearised.excluded, linearised.most_causes
    found = [log_evidence_of_sets(_only(freed, own), excluded, most, freed.basis[own[0]].cause) for own in kinds]
    strict = log_evidence_of_sets(_only(freed), excluded, most) + np.log1p(-UNLISTED)
    against = np.logaddexp(
        strict + np.log1p(-DEPARTS), float(scipy.special.logsumexp(found)) + np.log(DEPARTS / len(kinds))
    )
    left = replace(other, log_odds=float(strict + other.log_odds - against))
    if left.probability > LIMIT:
        return None
    shape = freed.basis[kinds[int(np.argmax(found))][0]]
    about = _with(linearised, frozenset({(shape.cause, shape.kind)}))
    best = best_set(about.grams, about.excluded, about.most_causes, linearised.best.keys)
    return FreeForm(shape.cause, shape.kind, replace(about, best=best), left) if shape.cause in best.keys else None


def _only(freed: Grams, shapes: IndexArray | None = None) -> Grams:
    """Return the Gram matrices with one curve, or with none."""
    form = np.where([bool(shape.cause) for shape in freed.basis], 0.0, freed.form)
    if shapes is not None:
        form[shapes] = 1.0
    return replace(freed, form=form)


def _with(linearised: LinearisedCampaign, freed: Freed) -> LinearisedCampaign:
    campaigns = tuple(_of_campaign(data, freed) for data in linearised.campaigns)
    return replace(linearised, campaigns=campaigns, grams=joined_grams(campaigns))


def _of_campaign(data: CampaignData, freed: Freed) -> CampaignData:
    columns = columns_of(data.simulation, data.samples, data.linear, data.speed_variance, freed=freed)
    return replace(data, columns=columns)
