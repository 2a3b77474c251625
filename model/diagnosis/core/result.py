"""Result of a diagnosis: the contract that other programs read (``wheelsoil/diagnosis/1``), and its tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Literal

import numpy as np

from daq import OUTPUTS, ROLES, DataError, Note, frame_of_rows
from model.diagnosis.core.information import Information
from model.diagnosis.core.plot_data import PlotData
from model.diagnosis.core.shapes import Rows, Shape
from model.inference_data import inference_data

if TYPE_CHECKING:
    import pandas as pd
    from xarray import DataTree


Verdict = Literal["named", "one_of", "unexplained", "nothing_detectable"]

_PLACE = ("where", "lower", "upper", "unit_there", "vertical_load_n", "run", "campaign")


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
    """A cause with its parameters, as if it were the one.

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
class Scores:
    """R0 in the channel's unit, M0 in percent, R2; and the mean predictive log-likelihood of a run, nats."""

    R0: float
    M0_percent: float
    R2: float
    log_likelihood: float


@dataclass(frozen=True)
class Reduction:
    """By how much R0 of a channel falls, percent; with the 95 % interval, NaN with fewer than three runs."""

    percent: float
    interval95: tuple[float, float]

    @property
    def grows(self) -> bool:
        """Whether the error grows for certain: the interval of its fall is below 0."""
        return self.interval95[1] < 0.0


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
    """

    step: Note
    separates: tuple[str, ...]
    expected_log_bayes_factor: float
    cost_runs: float = 1.0
    campaign: str = ""


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
    form_matters : Note or None
        Which verdicts half and twice an error of form that was assumed or given lead to, where they are others.
    """

    undecided: Note | None = None
    barred: Note | None = None
    beside: tuple[str, ...] = ()
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

    @property
    def main_channel(self) -> str:
        """Channel that the causes change most, in sigmas of a sample: "dp", "t" or "z"; without causes the gain's."""
        usual = self.gain.channel if self.gain is not None else "dp"
        if not self.causes or self.verdict not in ("named", "one_of"):
            return usual
        sizes = {channel: self._change_sigmas(channel) for channel in OUTPUTS}
        largest = max(sizes, key=lambda channel: sizes[channel])
        return largest if sizes[largest] > 0 else usual

    def _change_sigmas(self, channel: str) -> float:
        """Return the root mean square of what the extended model changes in a channel, in sigmas of a sample."""
        changes = [
            (one.extended[channel] - one.base[channel]) / one.base_sigma[channel]
            for one in self.plot_data
            if channel in one.base and channel in one.extended
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
        said = {"verdict": self.verdict}
        return inference_data(posterior, prior, attributes=said, draws=draws, seed=seed)

    def to_frames(self) -> dict[str, pd.DataFrame]:
        """Return the tables of the diagnosis as frames.

        Returns
        -------
        dict of pandas.DataFrame
            ``causes`` (one row a parameter, with its 95 % interval), ``candidates``, ``what_is_wrong``, ``gain`` (one
            row a channel and model), ``minimum_detectable`` and ``next_run``; sizes in the unit of the row.
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
            (one.measured[channel] - one.base[channel])[(one.slip >= low) & (one.slip <= high)]
            for one in self.plot_data
            if channel in one.base and campaign in ("", one.campaign)
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
        (c.name, c.form, c.kind, c.probability, c.form_probability, p.name, p.unit, p.value, p.sigma, *p.interval95)
        for c in found.causes
        for p in c.parameters or none
    ]
    wrong = [
        (w.channel, *_place(w.place), ROLES[w.channel].unit, w.size, found.median_there(w), w.statistic)
        for w in found.what_is_wrong
    ]
    scores = (("base", found.gain.base), ("extended", found.gain.extended)) if found.gain else ()
    gain = [
        (OUTPUTS[key].role, which, OUTPUTS[key].unit, one.R0, one.M0_percent, one.R2, one.log_likelihood)
        for which, of in scores
        for key, one in of.items()
    ]
    least = [(key, d.parameter, d.value, d.unit) for key, d in found.minimum_detectable.items()]
    runs = [
        (str(run.step.code), ", ".join(run.separates), run.expected_log_bayes_factor, run.cost_runs)
        for run in found.next_run
    ]
    estimate = ("parameter", "unit", "value", "sigma", "lower95", "upper95")
    return {
        "causes": frame_of_rows(("name", "form", "kind", "probability", "form_probability", *estimate), causes),
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
