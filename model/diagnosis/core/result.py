"""What a diagnosis says.

A diagnosis as small HTML tables, for a notebook; `wheelsoil diagnose` and the report say more.

The contract that other programs read (``wheelsoil/diagnosis/1``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from daq import OUTPUTS, ROLES, frame_of_rows, html_paragraph, html_table, number, probability

if TYPE_CHECKING:
    import pandas as pd

_LEAST_SHOWN = 0.01
_MOST_FINDINGS = 6


def diagnosis_html(found: Diagnosis) -> str:
    """Return the verdict, the causes and where the simulation is off."""
    shown = [html_paragraph(found.sentence)]
    causes = [row for cause in found.causes for row in _cause(cause)]
    if causes:
        head = ["cause", "parameter", "probability", "value", "95 % interval", "unit"]
        shown.append(html_table(head, causes, left=2, caption=f"verdict: {_plain(found.verdict)}"))
    likely = [[_plain(c.name), probability(c.probability)] for c in found.candidates if c.probability >= _LEAST_SHOWN]
    if likely:
        shown.append(html_table(["candidate", "probability"], likely))
    wrong = [
        [
            ROLES[w.channel].name,
            w.where,
            f"{number(w.size, 3)} {ROLES[w.channel].unit_text}",
            number(w.statistic, 3),
        ]
        for w in found.what_is_wrong[:_MOST_FINDINGS]
    ]
    if wrong:
        shown.append(html_table(["channel", "where the simulation is off", "by", "sigmas"], wrong, left=2))
    if found.gain is not None:
        rows = _gain(found.gain)
        head = ["on runs left out", "R0 base", "R0 extended", "unit"]
        shown.append(html_table(head, rows, caption=f"gain: {number(found.gain.log_likelihood_gain, 4)} nats"))
    if found.next_run:
        runs = [[run.change, number(run.expected_log_bayes_factor, 3)] for run in found.next_run]
        shown.append(html_table(["next run, best first", "expected ln Bayes factor"], runs))
    return "".join(shown)


def _gain(gain: Gain) -> list[list[str]]:
    return [
        [channel.name, number(gain.base[key].R0), number(gain.extended[key].R0), channel.unit_text]
        for key, channel in OUTPUTS.items()
        if key in gain.base and key in gain.extended
    ]


def _cause(cause: Cause) -> list[list[str]]:
    name, sure = _plain(cause.name), probability(cause.probability)
    if not cause.parameters:
        return [[name, "", sure, "", "", ""]]
    rows = []
    for p in cause.parameters:
        low, high = p.interval95
        interval = f"{number(low, 3)} .. {number(high, 3)}" if isfinite(low) and isfinite(high) else "-"
        rows.append([name, p.name, sure, number(p.value, 3), interval, "" if p.unit == "1" else p.unit])
    return rows


def _plain(name: str) -> str:
    return name.replace("_", " ")


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
    where : str
        e.g. "slip 0.4 to 0.9, driving".
    size : float
        N, N m, m or m/s. Of recorded runs the height of the shape of misfit there, once soil and the stronger findings
        were taken out, where the shape is largest; of a bench table the mean of measured less simulated. Of an input
        the error, measured less true, that would look like this misfit.
    statistic : float
        Over its standard deviation (signed).
    slips : tuple of float, optional
        Range of slip that the shape covers, where it is one over slip.
    campaign : str
        Whose shape it is, where there are several.
    of_rows : bool
        Whether it is of a bench table's rows.
    """

    channel: str
    where: str
    size: float
    statistic: float
    slips: tuple[float, float] | None = None
    campaign: str = ""
    of_rows: bool = False


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

    def to_frames(self) -> dict[str, pd.DataFrame]:
        """Return the tables of the diagnosis as frames.

        Returns
        -------
        dict of pandas.DataFrame
            ``causes`` (one row a parameter, with its 95 % interval), ``candidates``, ``what_is_wrong``, ``gain`` (one
            row a channel and model), ``minimum_detectable`` and ``next_run``; sizes in the unit of the row.
        """
        return _frames(self)

    def _repr_html_(self) -> str:
        return diagnosis_html(self)

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
        if found.slips is None:
            return float("nan")
        (low, high), channel = found.slips, ROLES[found.channel].key
        left = [
            (seen.measured[channel] - seen.base[channel])[(seen.slip >= low) & (seen.slip <= high)]
            for seen in self.seen
            if channel in seen.base and found.campaign in ("", seen.campaign)
        ]
        known = np.concatenate([*left, np.zeros(0)])
        known = known[np.isfinite(known)]
        return float(np.median(known)) if len(known) else float("nan")

    def as_json(self) -> dict[str, Any]:
        """Return the contract's mapping; NaN stays NaN, for the writer to turn into null."""
        return diagnosis_json(self)


def _frames(found: Diagnosis) -> dict[str, pd.DataFrame]:
    none = (ParameterEstimate("", "", float("nan"), (float("nan"), float("nan")), float("nan")),)
    causes = [
        (c.name, c.form, c.kind, c.probability, c.form_probability, p.name, p.unit, p.value, p.sigma, *p.interval95)
        for c in found.causes
        for p in c.parameters or none
    ]
    wrong = [
        (w.channel, w.where, ROLES[w.channel].unit, w.size, found.median_there(w), w.statistic)
        for w in found.what_is_wrong
    ]
    scores = (("base", found.gain.base), ("extended", found.gain.extended)) if found.gain else ()
    gain = [
        (OUTPUTS[key].role, which, OUTPUTS[key].unit, one.R0, one.M0_percent, one.R2, one.log_likelihood)
        for which, of in scores
        for key, one in of.items()
    ]
    least = [(key, d.parameter, d.value, d.unit) for key, d in found.minimum_detectable.items()]
    runs = [(run.change, ", ".join(run.separates), run.expected_log_bayes_factor) for run in found.next_run]
    estimate = ("parameter", "unit", "value", "sigma", "lower95", "upper95")
    return {
        "causes": frame_of_rows(("name", "form", "kind", "probability", "form_probability", *estimate), causes),
        "candidates": frame_of_rows(("name", "probability"), [(c.name, c.probability) for c in found.candidates]),
        "what_is_wrong": frame_of_rows(("channel", "where", "unit", "size", "median_there", "statistic"), wrong),
        "gain": frame_of_rows(("channel", "model", "unit", "R0", "M0_percent", "R2", "log_likelihood"), gain),
        "minimum_detectable": frame_of_rows(("effect", "parameter", "value", "unit"), least),
        "next_run": frame_of_rows(("change", "separates", "expected_log_bayes_factor"), runs),
    }


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
