"""Look-alikes of a verdict's causes: families whose signatures are almost theirs, once the soil is projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import Posterior, estimate
from model.diagnosis.explained import likeliest_form
from model.diagnosis.grams import Grams
from model.diagnosis.isolability import isolability
from model.diagnosis.verdict import Judgement

FloatArray = NDArray[np.float64]

ALIKE = 0.95
"""Cosine of two signatures, the soil projected out, from which on they look almost the same."""


@dataclass(frozen=True)
class LookAlike:
    """A family that would look almost as one of the verdict's does.

    Attributes
    ----------
    family, key : str
        Of the other, by its most similar form.
    of : str
        Key of the verdict's cause.
    cosine : float
    """

    family: str
    key: str
    of: str
    cosine: float


def look_alikes(grams: Grams, found: Posterior, verdict: Judgement) -> tuple[LookAlike, ...]:
    """Return the look-alikes of the named causes, or of a set's likeliest member; each family once, most alike first.

    Parameters
    ----------
    grams : Grams
    found : Posterior
    verdict : Judgement
    """
    own = verdict.families if verdict.verdict == "named" else verdict.families[:1]
    apart = isolability(grams)
    alike = []
    for family in own:
        key = likeliest_form(found, family)
        across = apart.cosine[apart.keys.index(key)]
        alike += [
            LookAlike(other, apart.keys[j], key, float(across[j]))
            for j, other in enumerate(apart.families)
            if other not in verdict.families and across[j] > ALIKE
        ]
    first: dict[str, LookAlike] = {}
    for one in sorted(alike, key=lambda one: -one.cosine):
        first.setdefault(one.family, one)
    return tuple(first.values())


def imitating(grams: Grams, named: Sequence[str], one: LookAlike) -> FloatArray:
    """Return the coefficients that a look-alike would have in the place of the named cause, the others kept.

    Parameters
    ----------
    grams : Grams
    named : sequence of str
        Keys of the named causes.
    one : LookAlike
    """
    keys = (*(key for key in named if key != one.of), one.key)
    told = estimate(grams, keys)
    return np.array([told.coefficients[i] for i in told.columns if grams.causes[i].key == one.key])
