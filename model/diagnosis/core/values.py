"""Values that several answers share: causes with their parameters, soils, and the gain on held-out data."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter of a cause; the interval is NaN where none can be given."""

    name: str
    unit: str
    value: float
    interval95: tuple[float, float]
    sigma: float


@dataclass(frozen=True)
class Cause:
    """A cause with its parameters; of a set, as if it acted with those that act for sure, and no other.

    Attributes
    ----------
    name, form, kind : of the effect; ``form`` is the most probable one, conditional on the family.
    key : str
        Of the effect in the library.
    probability : of the family
    form_probability : of the form within the family
    """

    name: str
    form: str
    kind: str
    key: str
    probability: float
    form_probability: float
    parameters: tuple[ParameterEstimate, ...]


@dataclass(frozen=True)
class Scores:
    """R0 in the channel's unit, M0 in percent, R2; and the mean predictive log-likelihood of a run, nats."""

    R0: float
    M0_percent: float
    R2: float
    log_likelihood: float


NOTABLE_GROWTH = 5.0
"""Percent of R0 below which a growth contradicts nothing: R0 is at the measured slip, whose error enters any model."""


@dataclass(frozen=True)
class Reduction:
    """By how much R0 of a channel falls, percent; with the 95 % interval, NaN with fewer than three runs."""

    percent: float
    interval95: tuple[float, float]

    @property
    def grows(self) -> bool:
        """Whether the error grows for certain, and by `NOTABLE_GROWTH` at least."""
        return self.interval95[1] < 0.0 and self.percent <= -NOTABLE_GROWTH

    @property
    def falls(self) -> bool:
        """Whether the error falls for certain."""
        return self.interval95[0] > 0.0


@dataclass(frozen=True)
class Gain:
    """Gain of the extension on runs that neither the choice nor the fit has used.

    Attributes
    ----------
    base, extended : mapping channel ("dp", "t", "z") -> Scores
    reduction_percent : of R0 of `channel`
    interval95 : of it
    log_likelihood_gain : nats, sum over held-out runs
    chosen : tuple of tuple of str
        Keys of the causes that each fold chose.
    channel : "dp", "t" or "z"
    reductions : mapping channel -> Reduction
        Of every measured channel.
    expected : mapping channel -> float
        R0 of the base that noise, errors of speed and load, scatter and uncertainty of the soil alone would give, in
        the channel's unit; empty for tables.
    """

    base: dict[str, Scores]
    extended: dict[str, Scores]
    reduction_percent: float
    interval95: tuple[float, float]
    log_likelihood_gain: float
    chosen: tuple[tuple[str, ...], ...]
    channel: str = "dp"
    reductions: dict[str, Reduction] = field(default_factory=dict)
    expected: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SoilEstimate:
    """The soil as the data leave it, with the named causes (or none) in the model.

    Attributes
    ----------
    laboratory : mapping parameter -> (value, one-sigma)
        What was known before; without those that it is said to know exactly.
    """

    campaign: str
    values: dict[str, float]
    sigmas: dict[str, float]
    laboratory: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def off_laboratory(self) -> dict[str, float]:
        """By how many of the laboratory's one-sigmas each parameter is off."""
        return {name: (self.values[name] - x) / s for name, (x, s) in self.laboratory.items() if name in self.values}


@dataclass(frozen=True)
class RefutedSoil:
    """A parameter of the laboratory's soil that does not hold, judged beside every probable set of causes.

    Attributes
    ----------
    sigmas : float
        Of the laboratory, by which it is off.
    """

    campaign: str
    parameter: str
    probability: float
    sigmas: float


@dataclass(frozen=True)
class SoilInstead:
    """What the laboratory may have wrong in place of a named family, and how probable that is."""

    family: str
    soil: RefutedSoil
