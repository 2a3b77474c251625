"""After "unexplained": a small formula for what is left, offered with what it is worth on held-out runs, never named.

The terms are simple functions of what was measured, and their products. Every term in every channel is a column like a
cause's, with a normal prior whose one-sigma lets it be as large as a shape of the catch-all. Sets of up to three are
weighed as sets of causes are, so that a longer formula has to pay for its length. The gain is nested: each run is
predicted with the terms that the others choose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np

from daq import OUTPUTS, FloatArray
from model.diagnosis.core.hypotheses import SIZE_PRIOR
from model.diagnosis.core.result import Proposal
from model.diagnosis.findings.set_fit import SetFit
from model.diagnosis.findings.set_problem import Part
from model.diagnosis.time_series.basis import amplitude_of
from model.diagnosis.time_series.columns import CauseColumn, Columns, Grams
from model.diagnosis.time_series.evidence import estimate, log_likelihood_of_run, without_soil
from model.diagnosis.time_series.joining import joined
from model.wheel_soil.conditions import Conditions

SLIP_SCALE = 0.1
"""Of exp(-|s|/0.1): what is there at little slip only."""
_SPREAD = 1e-3

MOST_TERMS = 3
_FEWEST_RUNS = 2
_BEAM = 12


@dataclass(frozen=True)
class Term:
    """A function of the conditions.

    Attributes
    ----------
    text : str
        As it stands in a formula.
    unit : str
        Empty for a pure number.
    values : array, shape (n,)
    """

    text: str
    unit: str
    values: FloatArray


def terms(conditions: Conditions, sinkage_m: FloatArray) -> tuple[Term, ...]:
    """Return the terms that these samples can tell: a constant, simple functions, products of two.

    Left out is what was not measured, and what is the same in every sample. Conditions and the model's sinkage have the
    shape (n,).
    """
    simple = [_telling(group) for group in _simple(conditions, sinkage_m)]
    found = [Term("1", "", np.ones(len(sinkage_m))), *(term for group in simple for term in group)]
    for first, second in combinations(simple, 2):
        found += [_product(a, b) for a in first for b in second]
    return tuple(term for term in found if term.text == "1" or _varies(term.values))


def _simple(c: Conditions, sinkage_m: FloatArray) -> list[list[Term]]:
    """Return functions of one variable each, a list for each variable."""
    s, load = np.asarray(c.slip, float), np.asarray(c.vertical_load_n, float) / 1e3
    speed, rate = np.asarray(c.ground_speed_mps, float), np.asarray(c.ground_acceleration_mps2, float)
    time, place = np.asarray(c.campaign_time, float), np.asarray(c.line_position, float)
    return [
        [
            Term("s", "", s),
            Term("|s|", "", np.abs(s)),
            Term("max(s,0)", "", np.maximum(s, 0.0)),
            Term("s^2", "", s * s),
            Term("sign(s)", "", np.sign(s)),
            Term(f"exp(-|s|/{SLIP_SCALE:g})", "", np.exp(-np.abs(s) / SLIP_SCALE)),
        ],
        [Term("W", "kN", load)],
        [Term("V", "m/s", speed), Term("1/V", "s/m", 1.0 / np.maximum(speed, 0.1))],
        [Term("z", "m", np.asarray(sinkage_m, float)), Term("z^2", "m2", np.asarray(sinkage_m, float) ** 2)],
        [Term("t", "", time)],
        [Term("x", "", place), Term("x^2", "", place * place)],
        [Term("a", "m/s2", rate)],
    ]


def _telling(group: list[Term]) -> list[Term]:
    """Return the terms that are known, change, and are not one of the others again."""
    found: list[Term] = []
    for term in group:
        known = np.isfinite(term.values).all() and _varies(term.values)
        if known and not any(np.array_equal(term.values, other.values) for other in found):
            found.append(term)
    return found


def _product(a: Term, b: Term) -> Term:
    return Term(f"{a.text} {b.text}", " ".join(unit for unit in (a.unit, b.unit) if unit), a.values * b.values)


def _varies(values: FloatArray) -> bool:
    size = float(np.sqrt(np.mean(values**2)))
    return bool(size > 0 and np.std(values) > _SPREAD * size)


@dataclass(frozen=True)
class TermColumn:
    """What stands behind a term's column: a coefficient of 1 is `scale` in the channel's unit over the term's."""

    channel: str
    text: str
    unit: str
    scale: float


def propose_for(fit: SetFit) -> Proposal | None:
    """Search for a formula (see `propose`) of what a set of causes, or the soil alone, leaves.

    Its soil and causes stay uncertain.
    """
    columns: dict[str, TermColumn] = {}
    return propose(_terms_as_causes(_grams(fit, columns), columns), columns)


def _grams(fit: SetFit, columns: dict[str, TermColumn]) -> Grams:
    """Return the Grams of all campaigns with the terms among the causes; fill `columns` with what the terms are."""
    parts = []
    for part in fit.problem.parts:
        data = part.data
        own = _with_terms(part, columns)
        parts.append(part.of_campaign(data.noise.values, own))
    return joined(parts)


def _with_terms(part: Part, columns: dict[str, TermColumn]) -> Columns:
    """Return a campaign's columns with the terms behind the causes; terms that are new are added to `columns`."""
    plain = part.columns(part.frozen)
    samples, linear = part.data.samples, part.frozen
    values = {**part.simulation.space.values(linear.point.soil), **linear.point.causes}
    sinkage = part.simulation.model(linear.point.causes).predict(linear.conditions, values).sinkage_m
    found: list[tuple[int, FloatArray]] = []
    causes = []
    for term in terms(linear.conditions, sinkage):
        size = float(np.sqrt(np.mean(term.values**2)))
        for row, channel in enumerate(linear.channels):
            key = f"{channel}: {term.text}"
            scale = amplitude_of(samples, channel) / size
            known = columns.setdefault(key, TermColumn(channel, term.text, term.unit, scale))
            found.append((row, np.where(plain.present[row], known.scale * term.values, 0.0)))
            causes.append(_column(key, known.scale))
    at = plain.shared
    rows = np.insert(plain.rows, [at] * len(found), 0.0, axis=-1)
    for column, (row, term_values) in enumerate(found, at):
        rows[row, :, column] = term_values
    empty = np.zeros((*plain.rests.shape[:2], len(found)))
    rests = np.concatenate([plain.rests[..., :at], empty, plain.rests[..., at:]], axis=-1)
    return replace(plain, rows=rows, rests=rests, causes=(*plain.causes, *causes))


def _column(key: str, scale: float) -> CauseColumn:
    free = float("inf")
    return CauseColumn(key, key, "coefficient", "", scale, 0.0, 0.0, -free, free, one_sided=False)


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
        grams,
        matrices=grams.matrices[:, np.array(order)[:, None], order],
        static=grams.static[np.ix_(order, order)] if isinstance(grams.static, np.ndarray) else 0.0,
        soil=(*grams.soil, *labels),
        causes=own,
        basis=(),
        order=None,
        own=(),
    )


def propose(grams: Grams, terms: dict[str, TermColumn]) -> Proposal | None:
    """Search for a formula of what is left; None where none predicts held-out runs better than none, or with one run.

    In `grams` terms are in the place of causes, by their keys; what else is uncertain stands among the soil's columns.
    """
    if len(grams.run_names) < _FEWEST_RUNS:
        return None
    keys = chosen_terms(grams)
    gain = sum(_gain_of(grams, run) for run in range(len(grams.run_names)))
    if not keys or not gain > 0:
        return None
    return Proposal(_formula(grams, terms, keys), float(gain))


def chosen_terms(grams: Grams) -> tuple[str, ...]:
    """Return the most probable set of terms, found by adding one at a time to the best few; empty if none helps."""
    reduced = without_soil(grams, grams.total)
    count = len(grams.causes)
    precision, side = np.eye(count) + reduced[1 : 1 + count, 1 : 1 + count], reduced[1 : 1 + count, 0]
    beam: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    best: tuple[float, tuple[int, ...]] = (float(np.log(SIZE_PRIOR[0])), ())
    for size in range(1, min(MOST_TERMS, count, len(SIZE_PRIOR) - 1) + 1):
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


def _gain_of(grams: Grams, run: int) -> float:
    """Return what the terms that the other runs choose are worth on a run, nats."""
    chosen = chosen_terms(grams.without(run))
    if not chosen:
        return 0.0
    return log_likelihood_of_run(grams, run, chosen) - log_likelihood_of_run(grams, run)


def _formula(grams: Grams, terms: dict[str, TermColumn], keys: tuple[str, ...]) -> str:
    found = estimate(grams, keys)
    value = dict(
        zip((grams.causes[i].key for i in found.columns), found.coefficients[list(found.columns)], strict=True)
    )
    formulas = []
    for channel, definition in OUTPUTS.items():
        own = [(value[key] * terms[key].scale, terms[key]) for key in keys if terms[key].channel == channel]
        if own:
            parts = [_part(size, term, first=i == 0) for i, (size, term) in enumerate(own)]
            word = definition.name
            formulas.append(
                f"{word} + ({' '.join(parts)})" if len(parts) > 1 else f"{word} {_part(*own[0], first=False)}"
            )
    return ", ".join(formulas)


def _part(size: float, term: TermColumn, *, first: bool) -> str:
    sign = ("-" if first else "- ") if size < 0 else ("" if first else "+ ")
    unit = OUTPUTS[term.channel].unit_text + (f"/({term.unit})" if term.unit else "")
    factor = "" if term.text == "1" else f" {term.text}"
    return f"{sign}{np.abs(size):.3g} {unit}{factor}"
