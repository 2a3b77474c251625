"""After "unexplained": a small formula for what is left, offered with what it is worth on held-out runs, never named.

Every term of `model.diagnosis.terms` in every channel is a column like a cause's, with a normal prior whose one-sigma
makes it as large as what is left. Sets of up to three are weighed as sets of causes are, so that a longer formula has
to pay for its length. The gain is nested: each run is foretold with the terms that the others choose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.diagnosis.evidence import estimate, posterior
from model.diagnosis.grams import Grams
from model.diagnosis.predictive import log_likelihood_of_run, others
from model.diagnosis.result import Proposal

MOST_TERMS = 3
_FEWEST_RUNS = 2
_WORDS = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
_UNITS = {"dp": "N", "t": "N m", "z": "m"}


@dataclass(frozen=True)
class TermColumn:
    """What stands behind a term's column: a coefficient of 1 is `scale` in the channel's unit over the term's."""

    channel: str
    text: str
    unit: str
    scale: float


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
    keys = posterior(grams, most=most).best()
    gain = sum(_gain_of(grams, run, most) for run in range(len(grams.run_names)))
    if not keys or not gain > 0:
        return None
    return Proposal(_formula(grams, terms, keys), float(gain))


def _gain_of(grams: Grams, run: int, most: int) -> float:
    """Return what the terms that the other runs choose are worth on a run, nats."""
    chosen = posterior(others(grams, run), most=most).best()
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
