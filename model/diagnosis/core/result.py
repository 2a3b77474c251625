"""Result of a diagnosis: the contract that other programs read (``wheelsoil/diagnosis/1``), and its tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Literal

import numpy as np

from daq import OUTPUTS, ROLES, DataError, Note, StaticTest, frame_of_rows
from model.diagnosis.core.average import Average
from model.diagnosis.core.information import Information
from model.diagnosis.core.plot_data import PlotData
from model.diagnosis.core.shapes import Rows, Shape
from model.diagnosis.core.values import Cause as Cause
from model.diagnosis.core.values import Gain as Gain
from model.diagnosis.core.values import ParameterEstimate as ParameterEstimate
from model.diagnosis.core.values import Reduction as Reduction
from model.diagnosis.core.values import RefutedSoil as RefutedSoil
from model.diagnosis.core.values import Scores as Scores
from model.diagnosis.core.values import SoilEstimate as SoilEstimate
from model.diagnosis.core.values import SoilInstead as SoilInstead
from model.inference_data import inference_data

if TYPE_CHECKING:
    import pandas as pd
    from xarray import DataTree


Verdict = Literal["named", "one_of", "unexplained", "nothing_detectable"]

_PLACE = ("where", "lower", "upper", "unit_there", "vertical_load_n", "run", "campaign")


@dataclass(frozen=True)
class BarredCause:
    """A cause, without values, that is likely enough for a name, and the rule that bars it."""

    cause: Cause
    why: Note


@dataclass(frozen=True)
class Candidate:
    """A family and its probability of being among the causes."""

    name: str
    probability: float


@dataclass(frozen=True)
class CauseSet:
    """Families that act together, and no others; empty: no known cause."""

    causes: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Finding:
    """A residual of the simulation.

    Attributes
    ----------
    channel : "drawbar_pull", "driving_torque" or "sinkage"; or an input, "ground_speed" or "vertical_load"
    place : Shape or Rows
        A shape of recorded runs, or rows of a single-wheel table.
    size : float
        N, N m, m or m/s. Of recorded runs the height of the shape of misfit there, once soil and the stronger findings
        were taken out, where the shape is largest; of rows the mean of measured less simulated. Of an input
        the error, measured less true, that would give this misfit.
    statistic : float
        Over its standard deviation (signed).
    """

    channel: str
    place: Shape | Rows
    size: float
    statistic: float

    @property
    def of_rows(self) -> bool:
        """Whether it is of rows of a single-wheel table."""
        return isinstance(self.place, Rows)


@dataclass(frozen=True)
class Inconsistent:
    """Rows of a channel that break an exact bound: no soil can do that.

    Attributes
    ----------
    lines : tuple of int
        Lines of a table's file; empty where the rows are of none.
    slips : tuple of float
        Of each row; of samples of runs the least and the largest.
    """

    channel: str
    rows: int
    why: Note
    lines: tuple[int, ...] = ()
    slips: tuple[float, ...] = ()


@dataclass(frozen=True)
class Adequacy:
    """Whether the best explanation leaves no more than noise.

    Attributes
    ----------
    statistic, threshold : float
        NaN where nothing can be judged.
    measure : "probability" or "lack of fit"
        What the statistic is: of driven runs the probability that something acts that no cause of the library
        describes; of single-wheel tables their lack of fit.
    """

    statistic: float
    threshold: float
    ok: bool
    measure: Literal["probability", "lack of fit"] = "lack of fit"

    @property
    def listed(self) -> float:
        """Probability that nothing unlisted acts, as far as it is known."""
        return 1.0 - self.statistic if self.measure == "probability" and isfinite(self.statistic) else 1.0


@dataclass(frozen=True)
class LackOfFit:
    """What the most probable set of causes leaves.

    Attributes
    ----------
    worst : tuple of Finding
        Of runs the largest members of the kind of shapes that tells it best; or the worst rows of a table.
    rms : mapping role -> float
        Of the curve that all of them make, over all samples, in the channel's unit; empty for tables.
    """

    worst: tuple[Finding, ...] = ()
    rms: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Linearisation:
    """How far the iterated linearisation of driven runs came, and by how many samples.

    Attributes
    ----------
    samples : int
        Usable ones of the recordings.
    used : int
        Those that are not near the cut at little slip, are no outliers, and for which the model has an answer.
    iterations : int
    converged : bool
    """

    samples: int
    used: int
    iterations: int
    converged: bool


@dataclass(frozen=True)
class Proposal:
    """A formula for what is left, offered and not named."""

    formula: str
    gain: float


@dataclass(frozen=True)
class Detectable:
    """The smallest detectable size of a parameter."""

    parameter: str
    value: float
    unit: str


DECIDES = 0.2
"""Probability of the right name after a step, from which on it is said to decide."""


@dataclass(frozen=True)
class NextRun:
    """A run, a calibration or a test that would separate the candidates.

    Attributes
    ----------
    step : Note
        What to do: one of `model.StepCode`.
    separates : tuple of str
        Families.
    cost_runs : float
        What it takes in time, in runs like the others.
    campaign : str
        To which it belongs, where there are several.
    naming_chance : float or None
        Probability that the right name is given after it; None where a name is not what is missing, or where a rule
        bars it of which no step can be foreseen to lift it.
    naming_barred : LackCode or ""
        That rule.
    """

    step: Note
    separates: tuple[str, ...]
    expected_log_bayes_factor: float
    cost_runs: float = 1.0
    campaign: str = ""
    naming_chance: float | None = None
    naming_barred: str = ""

    @property
    def decides(self) -> bool:
        """Whether it may well end in the right name."""
        return (self.naming_chance or 0.0) >= DECIDES


@dataclass(frozen=True)
class PriorShift:
    """What the verdict would be with another prior of a family.

    Attributes
    ----------
    factor : float
        On the prior odds of the sets that hold it.
    """

    family: str
    factor: float
    verdict: Verdict
    families: tuple[str, ...]


@dataclass(frozen=True)
class FormUsed:
    """The error of form that a right model of a single-wheel table may have in one channel.

    Attributes
    ----------
    size : float
        One-sigma, N, N m or m.
    basis : "given", "assumed", "repeats" or "stated"
        By a person, as a share of load, load x radius or radius; so by us; by the scatter of repeats; by the table's
        sigma columns.
    share : float or None
        Where it is given or assumed.
    """

    channel: str
    size: float
    basis: str
    share: float | None


@dataclass(frozen=True)
class Grounds:
    """What the verdict rests on beside the numbers of the diagnosis.

    Attributes
    ----------
    undecided : Note or None
        Why nothing can be decided.
    barred : Note or None
        Why a family that is likely enough is not named; or what makes it "unexplained" where lack of fit does not.
    beside : tuple of str
        Families of which one more probably acts beside the named ones.
    kept_back : tuple of BarredCause
        Of every verdict; beside named ones they are not among the causes.
    confounded : tuple of str
        Families confounded with the named ones or of the set.
    most_probable : tuple of str
        Families of the most probable set.
    terrains : two tuples of str, optional
        Runs that ask for one soil, and those that ask for another.
    lack_of_fit : LackOfFit
        Of "unexplained".
    prior_shifts : tuple of PriorShift
        Changes of one family's prior that change the verdict.
    cautions : tuple of Note
        What speaks against diagnosing these runs or rows together.
    free_form : (family, Kind), optional
        A cause that acts by another formula than the listed ones, and over what it departs from them.
    table_channels : tuple of str
        Channels that were used, of single-wheel tables; empty for driven runs.
    form_errors : tuple of FormUsed
        Of single-wheel tables, one for each of these channels.
    refuted_soil : tuple of RefutedSoil
        Of driven runs that are explained.
    soil_instead : tuple of SoilInstead
        Of named causes, or of those of which one acts.
    form_matters : Note or None
        Which verdicts half and twice an error of form that was assumed or given lead to, where they are others; or the
        error of form at which an unexplained table has an adequate explanation.
    """

    undecided: Note | None = None
    barred: Note | None = None
    beside: tuple[str, ...] = ()
    kept_back: tuple[BarredCause, ...] = ()
    confounded: tuple[str, ...] = ()
    most_probable: tuple[str, ...] = ()
    terrains: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    lack_of_fit: LackOfFit = LackOfFit()
    prior_shifts: tuple[PriorShift, ...] = ()
    cautions: tuple[Note, ...] = ()
    free_form: tuple[str, str] | None = None
    table_channels: tuple[str, ...] = ()
    form_errors: tuple[FormUsed, ...] = ()
    form_matters: Note | None = None
    refuted_soil: tuple[RefutedSoil, ...] = ()
    soil_instead: tuple[SoilInstead, ...] = ()

    @property
    def reasons(self) -> dict[str, Note]:
        """Why each cause that is kept back has no name, by its own."""
        return {kept.cause.name: kept.why for kept in self.kept_back}


@dataclass(frozen=True)
class Corrected:
    """An error of measurement that was known, and taken off the runs before the diagnosis.

    Attributes
    ----------
    name : str
        Family of the effect that it would be.
    value : float
        Mean over the runs; `unit`.
    interval95 : (float, float)
    source : tuple of str
        Recordings that it was determined from.
    """

    name: str
    value: float
    unit: str
    interval95: tuple[float, float]
    source: tuple[str, ...]


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Attributes
    ----------
    causes : the named ones; under "one_of" the set
    candidates : every family, most probable first; "none" among them
    sets : tuple of CauseSet
        Causes that act together, most probable first, up to 95 % or six sets.
    what_is_wrong : worst first
    gain : Gain or None
        None where it cannot be measured (one run).
    minimum_detectable : mapping effect key -> Detectable
    not_identifiable : mapping family -> why
        What the data do not allow to decide, for want of what.
    noise : mapping str -> float
        Hyper-parameters of the noise model, with unit suffix.
    information : Information or None
        Of one campaign of driven runs.
    linearisation : Linearisation or None
        Of driven runs.
    average : Average or None
        Of driven runs under "one_of", or with a further cause beside named ones, where it was asked for.
    corrected : tuple of Corrected
        What is decided already: zeros of the lifted wheel.
    static : tuple of StaticTest
        Readings by hand that were taken as data.
    """

    verdict: Verdict
    causes: tuple[Cause, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    what_is_wrong: tuple[Finding, ...] = ()
    gain: Gain | None = None
    inconsistent: tuple[Inconsistent, ...] = ()
    adequacy: Adequacy | None = None
    proposal: Proposal | None = None
    minimum_detectable: dict[str, Detectable] = field(default_factory=dict)
    next_run: tuple[NextRun, ...] = ()
    not_identifiable: dict[str, Note] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    noise: dict[str, float] = field(default_factory=dict)
    soils: tuple[SoilEstimate, ...] = ()
    plot_data: tuple[PlotData, ...] = ()
    stages_s: dict[str, float] = field(default_factory=dict)
    sets: tuple[CauseSet, ...] = ()
    grounds: Grounds = field(default_factory=Grounds)
    information: Information | None = None
    linearisation: Linearisation | None = None
    average: Average | None = None
    corrected: tuple[Corrected, ...] = ()
    static: tuple[StaticTest, ...] = ()

    @property
    def stated(self) -> tuple[tuple[Cause, Note | None], ...]:
        """Every cause of the verdict and every one that a rule bars beside named ones, with that rule."""
        reasons, names = self.grounds.reasons, {cause.name for cause in self.causes}
        others = {kept.cause.name: kept.cause for kept in self.grounds.kept_back if kept.cause.name not in names}
        return tuple((cause, reasons.get(cause.name)) for cause in (*self.causes, *others.values()))

    @property
    def main_channel(self) -> str:
        """Channel in which the causes are shown: "dp", "t" or "z".

        That which they change most, in sigmas of a sample. Of causes in soil and wheel alone the drawbar pull, where it
        was measured: what they do to it is what is asked of them. Without causes that of the gain.
        """
        usual = self.gain.channel if self.gain is not None else "dp"
        if not self.causes or self.verdict not in ("named", "one_of"):
            return usual
        if all(cause.kind == "physical" for cause in self.causes):
            return "dp" if self.gain is None or "dp" in self.gain.base else usual
        sizes = {channel: self._change_sigmas(channel) for channel in OUTPUTS}
        largest = max(sizes, key=lambda channel: sizes[channel])
        return largest if sizes[largest] > 0 else usual

    def _change_sigmas(self, channel: str) -> float:
        """Return the root mean square of what the extended model changes in a channel, in sigmas of a sample."""
        changes = [
            (data.extended[channel] - data.base[channel]) / data.base_sigma[channel]
            for data in self.plot_data
            if channel in data.base and channel in data.extended
        ]
        known = np.concatenate([*changes, np.zeros(0)])
        known = known[np.isfinite(known)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0

    def to_inference_data(self, *, draws: int = 1000, seed: int = 0) -> DataTree:
        """Return soil and most probable causes for ArviZ, as draws from their normal distribution in four chains.

        Returns
        -------
        xarray.DataTree
            ``posterior`` and ``prior``: the soil in one-sigma of its laboratory, each cause as ``effect.parameter`` in
            the unit of its attribute ``units``, by the model linearised about them.

        Raises
        ------
        DataError
            A diagnosis of a bench table, or one that found nothing usable: it has no information.
        ConfigError
            arviz-base is not installed.
        """
        if self.information is None:
            raise DataError.of("this diagnosis has no linear model", next_step="give campaigns with usable samples")
        posterior, prior = self.information.posterior_and_prior()
        return inference_data(posterior, prior, attributes={"verdict": self.verdict}, draws=draws, seed=seed)

    def to_frames(self) -> dict[str, pd.DataFrame]:
        """Return the tables of the diagnosis as frames.

        Returns
        -------
        dict of pandas.DataFrame
            ``causes`` (one row a parameter, with its 95 % interval; ``barred`` is the `LackCode` that keeps back its
            name), ``candidates``, ``what_is_wrong``, ``gain`` (one row a channel and model), ``minimum_detectable`` and
            ``next_run``; sizes in the unit of the row.
        """
        return _frames(self)

    def median_there(self, found: Finding) -> float:
        """Return the median of measured less simulated over the slips of a finding's shape, as figures show it.

        Returns
        -------
        float
            In the channel's unit; NaN where the shape is none over slip or has no samples.
        """
        slips, campaign = found.place.slips, found.place.campaign
        if slips is None:
            return float("nan")
        (low, high), channel = slips, ROLES[found.channel].key
        left = [
            (data.measured[channel] - data.base[channel])[(data.slip >= low) & (data.slip <= high)]
            for data in self.plot_data
            if channel in data.base and campaign in ("", data.campaign)
        ]
        known = np.concatenate([*left, np.zeros(0)])
        known = known[np.isfinite(known)]
        return float(np.median(known)) if len(known) else float("nan")


def _place(place: Shape | Rows) -> tuple[str, float, float, str, float, str, str]:
    """Return where a finding is, as the values of `_PLACE`; NaN for what does not say where."""
    nan = float("nan")
    if isinstance(place, Rows):
        return "slip", place.slip, place.slip, "1", place.vertical_load_n, "", place.campaign
    low, high = sorted(place.range or (nan, nan))
    unit = place.unit or "1" if place.range else ""
    return str(place.kind), low, high, unit, nan, place.run, place.campaign


def _frames(found: Diagnosis) -> dict[str, pd.DataFrame]:
    none = (ParameterEstimate("", "", float("nan"), (float("nan"), float("nan")), float("nan")),)
    causes = [
        (
            *(c.name, c.form, c.kind, c.probability, c.form_probability, str(why.code) if why else ""),
            *(p.name, p.unit, p.value, p.sigma, *p.interval95),
        )
        for c, why in found.stated
        for p in c.parameters or none
    ]
    wrong = [
        (w.channel, *_place(w.place), ROLES[w.channel].unit, w.size, found.median_there(w), w.statistic)
        for w in found.what_is_wrong
    ]
    scores = (("base", found.gain.base), ("extended", found.gain.extended)) if found.gain else ()
    gain = [
        (OUTPUTS[key].role, which, OUTPUTS[key].unit, score.R0, score.M0_percent, score.R2, score.log_likelihood)
        for which, of in scores
        for key, score in of.items()
    ]
    least = [(key, d.parameter, d.value, d.unit) for key, d in found.minimum_detectable.items()]
    runs = [
        (str(run.step.code), ", ".join(run.separates), run.expected_log_bayes_factor, run.cost_runs)
        for run in found.next_run
    ]
    of_cause = ("name", "form", "kind", "probability", "form_probability", "barred")
    estimate = ("parameter", "unit", "value", "sigma", "lower95", "upper95")
    return {
        "causes": frame_of_rows((*of_cause, *estimate), causes),
        "candidates": frame_of_rows(("name", "probability"), [(c.name, c.probability) for c in found.candidates]),
        "what_is_wrong": frame_of_rows(("channel", *_PLACE, "unit", "size", "median_there", "statistic"), wrong),
        "gain": frame_of_rows(("channel", "model", "unit", "R0", "M0_percent", "R2", "log_likelihood"), gain),
        "minimum_detectable": frame_of_rows(("effect", "parameter", "value", "unit"), least),
        "next_run": frame_of_rows(("step", "separates", "expected_log_bayes_factor", "cost_runs"), runs),
    }


def undecided(
    why: Note, not_identifiable: dict[str, Note], notes: tuple[Note, ...], stages_s: dict[str, float] | None = None
) -> Diagnosis:
    """Return a diagnosis that decides nothing and says for want of what; see `Diagnosis`."""
    return Diagnosis(
        verdict="nothing_detectable",
        grounds=Grounds(undecided=why),
        not_identifiable=not_identifiable,
        notes=notes,
        stages_s=stages_s or {},
    )
