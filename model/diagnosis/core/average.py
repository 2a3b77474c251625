"""The sets of causes that remain possible, as a diagnosis leaves them for predictions under doubt."""

from __future__ import annotations

from dataclasses import dataclass

from daq import FloatArray
from model.diagnosis.core.values import Cause, Gain, SoilEstimate


@dataclass(frozen=True)
class FittedSet:
    """A set of causes fitted to everything.

    Attributes
    ----------
    probability : float
        Of the set, forms apart, among all sets that were weighed.
    causes : tuple of Cause
        With their values as members of this set; empty: no cause acts.
    soils : tuple of SoilEstimate
        Of each campaign.
    names : tuple of str, p of them
        Parameters of the covariances, as a model takes them: the soil's and the causes'.
    covariances : tuple of array, shape (p, p)
        Of each campaign, SI units: of the parameters within this set.
    """

    probability: float
    causes: tuple[Cause, ...]
    soils: tuple[SoilEstimate, ...]
    names: tuple[str, ...]
    covariances: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Average:
    """Several sets of causes, whose predictions are averaged by their probabilities.

    Attributes
    ----------
    sets : tuple of FittedSet
        Most probable first; "none" is among them, or where causes are named, each holds these.
    rest_probability : float
        Of the sets that are not listed.
    gain : Gain or None
        Of the average itself over the base model on held-out runs; None with one run.
    """

    sets: tuple[FittedSet, ...]
    rest_probability: float
    gain: Gain | None
