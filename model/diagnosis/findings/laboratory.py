r"""Whether the laboratory's soil holds, judged beside every set of causes that remains possible.

One parameter of the soil may be `WIDER` times as uncertain as the laboratory states. The prior probability of that is
`PRIOR_PROBABILITY`, which all parameters of all campaigns share. The soil's coordinates are then normal with covariance

.. math:: T T', \qquad T = I + R^+ (D - I) R,

with D the factor on that parameter, and R from the coordinates to the parameters (`SoilSpace`). Given a set of causes,
its evidence with that prior over the one with the laboratory's own weighs it; these probabilities are averaged over the
sets. A parameter that the data determine well has to be about 4.3 of the laboratory's one-sigmas off for 95 %.

Judged beside one cause where two act, the soil takes up what the second one does, and is refuted for that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from daq import FloatArray, IndexArray
from model.diagnosis.core.hypotheses import Posterior
from model.diagnosis.core.result import RefutedSoil, SoilInstead
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import box, in_box, prior_information
from model.diagnosis.time_series.linearise import SENSORS, SoilSpace
from model.wheel_soil.soils import SOIL_PARAMETERS

Keys = tuple[str, ...]
Place = tuple[str, SoilSpace, IndexArray]

WIDER = 5.0
"""Factor on the one-sigma of a parameter that the laboratory may have wrong."""
PRIOR_PROBABILITY = 0.1
"""Probability, before any data, that it has one wrong; all parameters of all campaigns share it."""
SAID_AT = 0.95
"""Probability from which on it is said."""
INSTEAD_AT, ASKED_AT = 0.01, 0.05
"""Probability from which on it is said that the laboratory may have been wrong in place of a cause; and that of a cause
that is not named from which on this is asked."""


@dataclass(frozen=True)
class _Wider:
    """One parameter of one campaign with a wider prior."""

    campaign: str
    parameter: str
    precision: FloatArray
    in_sigmas: FloatArray
    """From all coordinates to the parameter's distance from the laboratory, in one-sigmas."""


def refuted_soil(
    grams: Grams, spaces: Sequence[Place], sets: Mapping[Keys, float], factor: float
) -> tuple[RefutedSoil, ...]:
    """Return the parameters of the laboratory's soil that do not hold, most probable first.

    `spaces` has each soil's campaign, its space and where its columns are among those of all. `sets` are the most
    probable ones with their probabilities; `factor` is on the noise's variance.
    """
    grams = grams.scaled(1.0 / factor)
    asked = list(_wider(spaces, len(grams.soil)))
    if not asked:
        return ()
    own = np.eye(len(grams.soil))
    chances, sizes = np.zeros(len(asked)), np.zeros(len(asked))
    log_odds = np.log(PRIOR_PROBABILITY / len(asked) / (1.0 - PRIOR_PROBABILITY))
    for keys, probability in sets.items():
        plain, _ = _weighed(grams, keys, own)
        wider = [_weighed(grams, keys, prior.precision) for prior in asked]
        given = scipy.special.softmax([0.0, *(log_odds + found - plain for found, _ in wider)])[1:]
        share = probability / sum(sets.values()) * given
        chances += share
        sizes += share * [prior.in_sigmas @ soil for prior, (_, soil) in zip(asked, wider, strict=True)]
    found = [
        RefutedSoil(prior.campaign, prior.parameter, float(chance), float(size / chance))
        for prior, chance, size in zip(asked, chances, sizes, strict=True)
        if chance > SAID_AT
    ]
    return tuple(sorted(found, key=lambda refuted: -refuted.probability))


def _wider(spaces: Sequence[Place], count: int) -> Iterator[_Wider]:
    """Yield the parameters that the laboratories do not know exactly, each with its wider prior of all coordinates."""
    for campaign, space, places in spaces:
        soil = len(space) - len(SENSORS)
        root, at = space.root[:, :soil], places[:soil]
        sigma, inverse = np.sqrt((root**2).sum(axis=1)), np.linalg.pinv(root)
        for i in np.flatnonzero(sigma > 0).tolist():
            scale = np.where(np.arange(len(sigma)) == i, WIDER, 1.0)
            turned = np.eye(soil) + inverse @ ((scale - 1.0)[:, None] * root)
            precision, in_sigmas = np.eye(count), np.zeros(count)
            precision[np.ix_(at, at)] = np.linalg.inv(turned @ turned.T)
            in_sigmas[at] = root[i] / sigma[i]
            yield _Wider(campaign, SOIL_PARAMETERS[i], precision, in_sigmas)


def _weighed(grams: Grams, keys: Keys, precision: FloatArray) -> tuple[float, FloatArray]:
    """Return the log evidence of a set, up to what does not depend on the soil's prior, and the soil, shape (q,).

    `precision`, shape (q, q), is that of the soils' coordinates before the data.
    """
    soils, start = len(grams.soil), grams.cause_columns.start
    own = [position for key in keys for position in grams.columns_of(key)]
    at = np.r_[grams.soil_columns, own].astype(np.intp)
    prior = np.diag(prior_information(grams, keys))
    prior[:soils, :soils] = precision
    total = grams.net
    inner, side = total[np.ix_(at, at)] + prior, total[at, 0]
    lower, upper = (x[[position - start for position in own]] for x in box(grams.causes))
    free = np.full(soils, np.inf)
    best = in_box(inner, side, np.r_[-free, lower], np.r_[free, upper])
    fit = float(side @ best - 0.5 * best @ inner @ best)
    return fit + 0.5 * float(np.linalg.slogdet(precision)[1] - np.linalg.slogdet(inner)[1]), best[:soils]


def soil_instead(
    grams: Grams,
    spaces: Sequence[Place],
    found: Posterior,
    causes: Sequence[str],
    factor: float,
    named: Keys = (),
) -> tuple[SoilInstead, ...]:
    """Return what the laboratory may have wrong in place of each cause, where that is above `INSTEAD_AT`.

    Weighed by the data as they are, with the sets' own prior: the factor on the friction at the rim and the tangent of
    the friction angle, for instance, are one number to the forces. Beside the `named` causes; where there are none,
    each is asked in the most probable set that holds it, and weighed against all sets.
    """
    listed = found.hypotheses
    log_weight = found.log_evidence + listed.log_prior
    grams, asked = grams.scaled(1.0 / factor), list(_wider(spaces, len(grams.soil)))
    if not asked:
        return ()
    each, own = np.log(PRIOR_PROBABILITY / len(asked)), np.eye(len(grams.soil))
    instead = []
    for key in causes:
        together = named or listed.keys_of(
            max(np.flatnonzero(listed.has_effect[:, listed.effects.index(key)]).tolist(), key=log_weight.__getitem__)
        )
        fewer = tuple(other for other in together if other != key)
        whole, place = listed.position(together), listed.position(fewer)
        if whole is None or place is None:
            continue
        plain, _ = _weighed(grams, fewer, own)
        wider = [_weighed(grams, fewer, prior.precision) for prior in asked]
        others = [float(log_weight[place] + each + value - plain) for value, _ in wider]
        against = float(log_weight[whole] if named else scipy.special.logsumexp(log_weight))
        chances = scipy.special.softmax([against + np.log1p(-PRIOR_PROBABILITY), *others])[1:]
        best = int(np.argmax(chances))
        size = float(asked[best].in_sigmas @ wider[best][1])
        refuted = RefutedSoil(asked[best].campaign, asked[best].parameter, float(chances[best]), size)
        instead.append(SoilInstead(next(c.family for c in grams.causes if c.key == key), refuted))
    return tuple(each for each in instead if each.soil.probability > INSTEAD_AT)
