"""What a diagnosis says.

Channels as a diagnosis keys them, names them and measures them.

A diagnosis as small HTML tables, for a notebook; `wheelsoil diagnose` and the report say more.

The contract that other programs read (``wheelsoil/diagnosis/1``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.core.shapes import Rows, Shape, place_text

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


SCHEMA = "wheelsoil/diagnosis/1"


def diagnosis_json(found: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as plain mappings; NaN stays NaN, for the writer to turn into null."""
    return {
        "schema": SCHEMA,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "causes": [_cause_json(cause) for cause in found.causes],
        "candidates": [{"name": c.name, "probability": c.probability} for c in found.candidates],
        "sets": [{"causes": list(one.causes), "probability": one.probability} for one in found.sets],
        "what_is_wrong": [_finding(one, found.median_there(one)) for one in found.what_is_wrong],
        "gain": None if found.gain is None else _gain_json(found.gain),
        "inconsistent": [vars(item) for item in found.inconsistent],
        "adequacy": None if found.adequacy is None else vars(found.adequacy),
        "proposal": None if found.proposal is None else vars(found.proposal),
        "minimum_detectable": {key: vars(size) for key, size in found.minimum_detectable.items()},
        "next_run": [{**vars(run), "separates": list(run.separates)} for run in found.next_run],
        "cannot_tell": found.cannot_tell,
        "notes": list(found.notes),
        "noise": found.noise,
        "soils": [vars(soil) for soil in found.soils],
        "stages_s": found.stages_s,
    }


def _finding(found: Finding, median: float) -> dict[str, Any]:
    return {
        "channel": found.channel,
        "where": found.where,
        "size": found.size,
        "statistic": found.statistic,
        "median_there": median,
    }


def _cause_json(cause: Cause) -> dict[str, Any]:
    return {
        "name": cause.name,
        "form": cause.form,
        "kind": cause.kind,
        "probability": cause.probability,
        "form_probability": cause.form_probability,
        "parameters": [
            {"name": p.name, "unit": p.unit, "value": p.value, "interval95": list(p.interval95)}
            for p in cause.parameters
        ],
    }


def _gain_json(gain: Gain) -> dict[str, Any]:
    def scores(found: dict[str, Scores]) -> dict[str, Any]:
        pull = found.get("dp")
        top = {"R0_N": pull.R0, "M0_percent": pull.M0_percent, "R2": pull.R2} if pull else {}
        likelihood = next((one.log_likelihood for one in found.values()), float("nan"))  # of a run, all its channels
        return {
            **top,
            "log_likelihood_of_a_run": likelihood,
            "channels": {channel: vars(s) for channel, s in found.items()},
        }

    return {
        "held_out": {"base": scores(gain.base), "extended": scores(gain.extended)},
        "reduction_percent": gain.reduction_percent,
        "interval95": list(gain.interval95),
        "log_likelihood_gain": gain.log_likelihood_gain,
        "chosen": [list(keys) for keys in gain.chosen],
    }


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

    @property
    def where(self) -> str:
        """The place in words."""
        return place_text(self.place)


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
class Diagnosis:
    """The whole answer.

    Attributes
    ----------
    verdict : see `Verdict`
    sentence : str
        For people: the verdict, and what to do next.
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
    notes : tuple of str
    noise : mapping str -> float
        Hyper-parameters of the noise model, with unit suffix.
    soils : tuple of SoilEstimate
    seen : tuple of Seen
    stages_s : mapping stage -> seconds
    """

    verdict: Verdict
    sentence: str
    causes: tuple[Cause, ...]
    candidates: tuple[Candidate, ...]
    what_is_wrong: tuple[Finding, ...]
    gain: Gain | None
    inconsistent: tuple[Inconsistent, ...]
    adequacy: Adequacy | None
    proposal: Proposal | None
    minimum_detectable: dict[str, Detectable]
    next_run: tuple[NextRun, ...]
    cannot_tell: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    noise: dict[str, float] = field(default_factory=dict)
    soils: tuple[SoilEstimate, ...] = ()
    seen: tuple[Seen, ...] = ()
    stages_s: dict[str, float] = field(default_factory=dict)
    sets: tuple[CauseSet, ...] = ()

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

    def as_json(self) -> dict[str, Any]:
        """Return the contract's mapping; NaN stays NaN, for the writer to turn into null."""
        return diagnosis_json(self)


def undecided(
    sentence: str, cannot_tell: dict[str, str], notes: tuple[str, ...], stages_s: dict[str, float] | None = None
) -> Diagnosis:
    """Return a diagnosis that decides nothing and says for want of what; see `Diagnosis`."""
    return Diagnosis(
        verdict="nothing_detectable",
        sentence=sentence,
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
