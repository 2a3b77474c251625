"""After "unexplained": a small formula for what is left, offered with what it is worth on held-out runs, never named.

Every term of `model.diagnosis.terms` in every channel is a column like a cause's, with a normal prior whose one-sigma
lets it be as large as a shape of the catch-all. Sets of up to three are weighed as sets of causes are, so that a longer
formula has to pay for its length. The gain is nested: each run is foretold with the terms that the others choose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.basis import AMPLITUDE
from model.diagnosis.columns import Columns
from model.diagnosis.evidence import estimate, without_soil
from model.diagnosis.final import SetFit
from model.diagnosis.grams import CauseColumn, Grams
from model.diagnosis.joint import joined
from model.diagnosis.predictive import log_likelihood_of_run, others
from model.diagnosis.prior import SIZE_PRIOR
from model.diagnosis.result import Proposal
from model.diagnosis.set_problem import Part
from model.diagnosis.terms import terms
from model.diagnosis.whitening import run_grams

FloatArray = NDArray[np.float64]

MOST_TERMS = 3
_FEWEST_RUNS = 2
_BEAM = 12
_WORDS = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
_UNITS = {"dp": "N", "t": "N m", "z": "m"}


@dataclass(frozen=True)
class TermColumn:
    """What stands behind a term's column: a coefficient of 1 is `scale` in the channel's unit over the term's."""

    channel: str
    text: str
    unit: str
    scale: float


def propose_for(fit: SetFit, most: int = MOST_TERMS) -> Proposal | None:
    """Search for a formula of what a set of causes, or the soil alone, leaves.

    Parameters
    ----------
    fit : SetFit
        What the formula stands beside; its soil and causes stay uncertain.
    most : int
        Terms in the longest formula.

    Returns
    -------
    Proposal or None
        See `propose`.
    """
    columns: dict[str, TermColumn] = {}
    parts = []
    for part in fit.problem.parts:
        view = part.view
        own = _with_terms(part, fit, columns)
        matrices = run_grams(view.samples, part.frozen, own, view.noise.values, view.speed_variance)
        parts.append((view.campaign.name, view.samples.run_names, own, matrices))
    return propose(_terms_as_causes(joined(parts), columns), columns, most)


def _with_terms(part: Part, fit: SetFit, columns: dict[str, TermColumn]) -> Columns:
    """Return a campaign's columns with the terms behind the causes; terms that are new are added to `columns`."""
    plain = fit.problem.columns(part)
    samples, linear = part.view.samples, part.frozen
    values = {**part.simulation.space.values(linear.point.soil), **linear.point.causes}
    sinkage = part.simulation.model(linear.point.causes).predict(linear.conditions, values).sinkage_m
    load = float(np.median(samples.conditions.vertical_load_n))
    unit = {"dp": load, "t": load * samples.wheel_radius_m, "z": samples.wheel_radius_m}
    found, causes = [], []
    for term in terms(linear.conditions, sinkage):
        size = float(np.sqrt(np.mean(term.values**2)))
        for row, channel in enumerate(linear.channels):
            key = f"{channel}: {term.text}"
            scale = AMPLITUDE[channel] * unit[channel] / size
            known = columns.setdefault(key, TermColumn(channel, term.text, term.unit, scale))
            shape = np.zeros(linear.value.shape)
            shape[row] = known.scale * term.values
            found.append(np.where(plain.present, shape, 0.0))
            causes.append(_column(key, known.scale))
    at = plain.shared
    rows = np.concatenate([plain.rows[..., :at], np.stack(found, axis=-1), plain.rows[..., at:]], axis=-1)
    empty = np.zeros((*plain.rests.shape[:2], len(found)))
    rests = np.concatenate([plain.rests[..., :at], empty, plain.rests[..., at:]], axis=-1)
    return replace(plain, rows=rows, rests=rests, causes=(*plain.causes, *causes))


def _column(key: str, scale: float) -> CauseColumn:
    free = float("inf")
    return CauseColumn(key, key, "", "physical", "coefficient", "", scale, 0.0, 0.0, -free, free, one_sided=False)


def _terms_as_causes(grams: Grams, columns: Mapping[str, TermColumn]) -> Grams:
    """Return the Grams with the set's causes among the soil's columns: uncertain, and not in question."""
    beside = tuple(c for c in grams.causes if c.key not in columns)
    own = tuple(c for c in grams.causes if c.key in columns)
    start = grams.cause_columns.start
    order = [
        *range(start),
        *(start + i for i, c in enumerate(grams.causes) if c.key not in columns),
        *(start + i for i, c in enumerate(grams.causes) if c.key in columns),
    ]
    labels = tuple(f"{c.key}: {c.parameter}" for c in beside)
    return replace(
        grams, matrices=grams.matrices[:, order][:, :, order], soil=(*grams.soil, *labels), causes=own, basis=()
    )


def propose(grams: Grams, terms: dict[str, TermColumn], most: int = MOST_TERMS) -> Proposal | None:
    """Search for a formula of what is left.

    Parameters
    ----------
    grams : Grams
        With terms in the place of causes, by their keys; what else is uncertain stands among the soil's columns.
    terms : mapping key -> TermColumn
    most : int
        Terms in the longest formula.

    Returns
    -------
    Proposal or None
        None where no formula foretells left-out runs better than none, or there is but one run.
    """
    if len(grams.run_names) < _FEWEST_RUNS:
        return None
    keys = chosen_terms(grams, most)
    gain = sum(_gain_of(grams, run, most) for run in range(len(grams.run_names)))
    if not keys or not gain > 0:
        return None
    return Proposal(_formula(grams, terms, keys), float(gain))


def chosen_terms(grams: Grams, most: int = MOST_TERMS) -> tuple[str, ...]:
    """Return the likeliest set of terms, found by adding one at a time to the best few; empty where none is better.

    Parameters
    ----------
    grams : Grams
    most : int
    """
    reduced = without_soil(grams, grams.total())
    count = len(grams.causes)
    precision, side = np.eye(count) + reduced[1 : 1 + count, 1 : 1 + count], reduced[1 : 1 + count, 0]
    beam: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    best: tuple[float, tuple[int, ...]] = (float(np.log(SIZE_PRIOR[0])), ())
    for size in range(1, min(most, count, len(SIZE_PRIOR) - 1) + 1):
        grown = {}
        for value, members in beam:
            gained = _added(precision, side, members)
            for j in np.argsort(-gained)[:_BEAM].tolist():
                grown[tuple(sorted((*members, j)))] = value + float(gained[j])
        beam = sorted(((v, m) for m, v in grown.items()), reverse=True)[:_BEAM]
        joint = beam[0][0] + float(np.log(SIZE_PRIOR[size]) - np.log(comb(count, size)))
        best = max(best, (joint, beam[0][1]))
    return tuple(grams.causes[i].key for i in best[1])


def _added(precision: FloatArray, side: FloatArray, members: tuple[int, ...]) -> FloatArray:
    """Return what each further term adds to the log evidence of a set; minus infinity for its own."""
    own = list(members)
    solved = np.linalg.solve(precision[np.ix_(own, own)], np.c_[side[own], precision[own]])
    left = side - precision[:, own] @ solved[:, 0]
    spread = np.diag(precision) - np.einsum("ji,ij->j", precision[:, own], solved[:, 1:])
    spread[own] = 1.0
    gained = 0.5 * left**2 / spread - 0.5 * np.log(spread)
    gained[own] = -np.inf
    return np.asarray(gained)


def _gain_of(grams: Grams, run: int, most: int) -> float:
    """Return what the terms that the other runs choose are worth on a run, nats."""
    chosen = chosen_terms(others(grams, run), most)
    if not chosen:
        return 0.0
    return log_likelihood_of_run(grams, run, chosen) - log_likelihood_of_run(grams, run)


def _formula(grams: Grams, terms: dict[str, TermColumn], keys: tuple[str, ...]) -> str:
    found = estimate(grams, keys)
    value = dict(
        zip((grams.causes[i].key for i in found.columns), found.coefficients[list(found.columns)], strict=True)
    )
    said = []
    for channel, word in _WORDS.items():
        own = [(value[key] * terms[key].scale, terms[key]) for key in keys if terms[key].channel == channel]
        if own:
            parts = [_part(size, term, first=i == 0) for i, (size, term) in enumerate(own)]
            said.append(f"{word} + ({' '.join(parts)})" if len(parts) > 1 else f"{word} {_signed(*own[0])}")
    return ", ".join(said)


def _signed(size: float, term: TermColumn) -> str:
    return _part(size, term, first=False)


def _part(size: float, term: TermColumn, *, first: bool) -> str:
    sign = ("-" if first else "- ") if size < 0 else ("" if first else "+ ")
    unit = _UNITS[term.channel] + (f"/({term.unit})" if term.unit else "")
    factor = "" if term.text == "1" else f" {term.text}"
    return f"{sign}{np.abs(size):.3g} {unit}{factor}"
