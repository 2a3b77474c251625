"""What a diagnosis says.

Channels as a diagnosis keys them, names them and measures them.

A diagnosis as small HTML tables, for a notebook; `wheelsoil diagnose` and the report say more.

The contract that other programs read (``wheelsoil/diagnosis/1``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daq import Note
from model.diagnosis.core.shapes import Rows, Shape

NAMES = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
UNITS = {"dp": "N", "t": "N m", "z": "m"}
BRIEF = {**NAMES, "t": "torque"}
"""In a sentence."""
FIELDS = {"dp": "drawbar_pull", "t": "driving_torque", "z": "sinkage"}
"""In a finding and in JSON."""
INPUTS = {"v": ("ground_speed", "measured ground speed", "m/s"), "w": ("vertical_load", "measured load", "N")}
"""What the simulation is given, and a finding can be an error of: key, field, name and unit."""
INPUT_FIELDS = frozenset(field for field, _, _ in INPUTS.values())
FINDING_FIELDS = {**FIELDS, **{key: field for key, (field, _, _) in INPUTS.items()}}
FIELD_NAMES = {
    **{field: NAMES[key] for key, field in FIELDS.items()},
    **{field: name for field, name, _ in INPUTS.values()},
}
FIELD_UNITS = {
    **{field: UNITS[key] for key, field in FIELDS.items()},
    **{field: unit for field, _, unit in INPUTS.values()},
}
FIELD_KEYS = {field: key for key, field in FIELDS.items()}


FloatArray = NDArray[np.float64]

Verdict = Literal["named", "one_of", "unexplained", "nothing_detectable"]


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
    name, form, kind : of the effect; ``form`` is the likeliest one, conditional on the family.
    key : str
        Of the effect in the library.
    probability : of the family
    form_probability : of the form within the family
    parameters : tuple of ParameterEstimate
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
    """Families that are at work together, and nothing else with them; empty: no known cause."""

    causes: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Finding:
    """Where the simulation is off.

    Attributes
    ----------
    channel : "drawbar_pull", "driving_torque" or "sinkage"; or an input, "ground_speed" or "vertical_load"
    place : Shape or Rows
        A shape of recorded runs, or rows of a single-wheel table.
    size : float
        N, N m, m or m/s. Of recorded runs the height of the shape of misfit there, once soil and the stronger findings
        were taken out, where the shape is largest; of rows the mean of measured less simulated. Of an input
        the error, measured less true, that would look like this misfit.
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
class Gain:
    """What the extension is worth on runs that neither the choice nor the fit has seen.

    Attributes
    ----------
    base, extended : mapping channel ("dp", "t", "z") -> Scores
    reduction_percent : of R0 of `channel`
    interval95 : of it, by bootstrap over runs
    log_likelihood_gain : nats, sum over held-out runs
    chosen : tuple of tuple of str
        Keys of the causes that each fold chose.
    channel : "dp", "t" or "z"
    """

    base: dict[str, Scores]
    extended: dict[str, Scores]
    reduction_percent: float
    interval95: tuple[float, float]
    log_likelihood_gain: float
    chosen: tuple[tuple[str, ...], ...]
    channel: str = "dp"


@dataclass(frozen=True)
class Inconsistent:
    """Rows of a channel that break an exact bound: no soil can do that."""

    channel: str
    rows: int
    why: str


@dataclass(frozen=True)
class Adequacy:
    """Whether the best explanation leaves no more than noise."""

    statistic: float
    threshold: float
    ok: bool


@dataclass(frozen=True)
class Proposal:
    """A formula for what is left, offered and not named."""

    formula: str
    gain: float


@dataclass(frozen=True)
class Detectable:
    """The smallest size of a parameter that would have been found."""

    parameter: str
    value: float
    unit: str


@dataclass(frozen=True)
class NextRun:
    """A manoeuvre that would split the candidates."""

    change: str
    separates: tuple[str, ...]
    expected_log_bayes_factor: float


@dataclass(frozen=True)
class Seen:
    """The samples that were looked at, for figures; arrays of shape (n,).

    Attributes
    ----------
    campaign : str
    runs : tuple of str
        Names; ``run`` indexes them.
    run : int array
    time_s, slip, ground_speed_mps, vertical_load_n, line_position : float arrays
    measured, base, extended : mapping channel -> array
        What was measured; what the simulation says with its re-calibrated soil; what the extended model says.
    base_sigma : mapping channel -> array
        One-sigma of measured less base by the noise model.
    signatures : mapping effect key -> mapping channel -> array
        What each candidate changes at its estimated size, less what the soil can imitate.
    implied : mapping effect key -> mapping channel -> array
        What each candidate says as if it were the one, of channels that were not looked at too.
    unseen : tuple of str
        Channels that were measured and not looked at: nothing was chosen or fitted by them.
    """

    campaign: str
    runs: tuple[str, ...]
    run: NDArray[np.intp]
    time_s: FloatArray
    slip: FloatArray
    ground_speed_mps: FloatArray
    vertical_load_n: FloatArray
    line_position: FloatArray
    measured: dict[str, FloatArray]
    base: dict[str, FloatArray]
    extended: dict[str, FloatArray]
    base_sigma: dict[str, FloatArray]
    signatures: dict[str, dict[str, FloatArray]]
    implied: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    unseen: tuple[str, ...] = ()


@dataclass(frozen=True)
class SoilEstimate:
    """The soil as the data leave it, with the named causes (or none) in the model."""

    campaign: str
    values: dict[str, float]
    sigmas: dict[str, float]


@dataclass(frozen=True)
class Grounds:
    """What the verdict rests on beside the numbers of the diagnosis.

    Attributes
    ----------
    undecided : Note or None
        Why nothing can be decided.
    barred : Note or None
        Why a family that is likely enough is not named.
    beside : tuple of str
        Families of which one more is likely at work beside the named ones.
    look_alikes : tuple of str
        Families whose signatures are almost those of the named ones or of the set.
    likeliest : tuple of str
        Families of the likeliest set.
    terrains : two tuples of str, optional
        Runs that ask for one soil, and those that ask for another.
    cautions : tuple of Note
        What speaks against diagnosing these runs or rows together.
    table_channels : tuple of str
        Channels that were used, of single-wheel tables; empty for driven runs.
    """

    undecided: Note | None = None
    barred: Note | None = None
    beside: tuple[str, ...] = ()
    look_alikes: tuple[str, ...] = ()
    likeliest: tuple[str, ...] = ()
    terrains: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    cautions: tuple[Note, ...] = ()
    table_channels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Attributes
    ----------
    verdict : see `Verdict`
    causes : the named ones; under "one_of" the set
    candidates : every family, likeliest first; "none" among them
    sets : tuple of CauseSet
        What is at work together, likeliest first, up to 95 % or six sets.
    what_is_wrong : worst first
    gain : Gain or None
        None where it cannot be measured (one run).
    inconsistent, adequacy, proposal, next_run
    minimum_detectable : mapping effect key -> Detectable
    cannot_tell : mapping family -> why
        What the data do not allow to decide, for want of what.
    notes : tuple of Note
    noise : mapping str -> float
        Hyper-parameters of the noise model, with unit suffix.
    soils : tuple of SoilEstimate
    seen : tuple of Seen
    stages_s : mapping stage -> seconds
    grounds : Grounds
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    candidates: tuple[Candidate, ...]
    what_is_wrong: tuple[Finding, ...]
    gain: Gain | None
    inconsistent: tuple[Inconsistent, ...]
    adequacy: Adequacy | None
    proposal: Proposal | None
    minimum_detectable: dict[str, Detectable]
    next_run: tuple[NextRun, ...]
    cannot_tell: dict[str, Note] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    noise: dict[str, float] = field(default_factory=dict)
    soils: tuple[SoilEstimate, ...] = ()
    seen: tuple[Seen, ...] = ()
    stages_s: dict[str, float] = field(default_factory=dict)
    sets: tuple[CauseSet, ...] = ()
    grounds: Grounds = field(default_factory=Grounds)

    def median_there(self, found: Finding) -> float:
        """Return the median of measured less simulated over the slips of a finding's shape, as figures show it.

        Parameters
        ----------
        found : Finding

        Returns
        -------
        float
            In the channel's unit; NaN where the shape is none over slip or has no samples to be seen.
        """
        slips, campaign = found.place.slips, found.place.campaign
        if slips is None:
            return float("nan")
        (low, high), channel = slips, FIELD_KEYS.get(found.channel, "")
        left = [
            (seen.measured[channel] - seen.base[channel])[(seen.slip >= low) & (seen.slip <= high)]
            for seen in self.seen
            if channel in seen.base and campaign in ("", seen.campaign)
        ]
        known = np.concatenate([*left, np.zeros(0)])
        known = known[np.isfinite(known)]
        return float(np.median(known)) if len(known) else float("nan")


def undecided(
    why: Note, cannot_tell: dict[str, Note], notes: tuple[Note, ...], stages_s: dict[str, float] | None = None
) -> Diagnosis:
    """Return a diagnosis that decides nothing and says for want of what; see `Diagnosis`."""
    return Diagnosis(
        verdict="nothing_detectable",
        grounds=Grounds(undecided=why),
        causes=(),
        candidates=(),
        what_is_wrong=(),
        gain=None,
        inconsistent=(),
        adequacy=None,
        proposal=None,
        minimum_detectable={},
        next_run=(),
        cannot_tell=cannot_tell,
        notes=notes,
        stages_s=stages_s or {},
    )
