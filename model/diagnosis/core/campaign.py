"""Campaign: the measured runs on one terrain with one wheel, and the prior knowledge of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from daq import OUTPUTS
from model.effects.catalogue import EFFECTS
from model.fit.observations import Observations
from model.wheel_soil.conditions import Wheel
from model.wheel_soil.soils import Soil, SoilPrior
from model.wheel_soil.wheel_soil_model import Reading
from processing import ProcessedRun

FAMILIES = tuple(dict.fromkeys(effect.name for effect in EFFECTS.values()))
"""Families of causes that the library knows."""


@dataclass(frozen=True)
class Campaign:
    """Processed runs of one terrain.

    Attributes
    ----------
    name : str
        For messages: the folder's.
    soil : Soil
        The laboratory's.
    soil_prior : SoilPrior
        How sure the laboratory is.
    tyre : "smooth", "lugged" or ""
        As vehicle.toml declares it.
    outboard_mass_kg : float
        As vehicle.toml declares it. Its inertia is in the drawbar pull of the runs, by the slope of the measured speed.
    """

    name: str
    runs: tuple[ProcessedRun, ...]
    wheel: Wheel
    soil: Soil
    soil_prior: SoilPrior
    tyre: str = ""
    outboard_mass_kg: float = 0.0


@dataclass(frozen=True)
class Bench:
    """Rows of single-wheel tests on one soil, independent of each other.

    Attributes
    ----------
    name : str
        Of the table.
    rows : Observations
        With ``independent`` set; sinkage where it was measured.
    sigmas : mapping channel ("dp", "t", "z") -> one-sigma of a repeat, N, N m, m
        Empty where the table states none: then it is estimated from repeats.
    wheel, soil, soil_prior, tyre
        See `Campaign`.
    """

    name: str
    rows: Observations
    wheel: Wheel
    soil: Soil
    soil_prior: SoilPrior
    sigmas: dict[str, float] = field(default_factory=dict)
    tyre: str = ""


@dataclass(frozen=True)
class DiagnosisOptions:
    """How to look.

    Attributes
    ----------
    reading : "balanced" or "literal"
        Of the simulation under test.
    effects : tuple of str
        Keys of the library to consider.
    channels : of "dp", "t", "z"
        Measured channels to use where they are there.
    most_causes : int
        Largest set of causes that is weighed.
    name_at : float
        Probability from which on a family is named.
    seed : int
        Of the resampling of runs and of simulated thresholds.
    next_run : bool
        Rank manoeuvres even where the verdict does not ask for it.
    """

    reading: Reading = "balanced"
    effects: tuple[str, ...] = tuple(EFFECTS)
    channels: tuple[str, ...] = tuple(OUTPUTS)
    most_causes: int = 3
    name_at: float = 0.9
    seed: int = 0
    next_run: bool = False
