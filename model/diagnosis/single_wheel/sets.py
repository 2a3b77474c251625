"""Which causes the rows of a single-wheel test can identify, and the sets of them with their prior.

Rows with s < 0 do not enter the fit of a driven wheel, whose laws say nothing of them: a locked wheel ploughs, and
pulls back with more than its friction. The sinkage of a braked wheel has a law of its own, fitted to rows with s <= 0
alone: Z = Z0 + H2 s^2, with Z0 the sinkage at no slip, as it was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import OUTPUTS, BoolArray, FloatArray, Note
from model.diagnosis.core.campaign import (
    Bench,
    Coverage,
    considered,
    hypotheses_of,
    not_identifiable,
    ruled_out,
)
from model.diagnosis.core.hypotheses import Hypotheses, listed_sets
from model.diagnosis.single_wheel.noise import groups_of_rows
from model.diagnosis.single_wheel.problem import BenchProblem, CauseUse, Hypothesis
from model.effects.catalogue import EFFECTS
from model.notes import LackCode

NO_SLIP = 0.02
"""Slip below which a wheel neither drives nor brakes: a controller's residue."""
_LEAST_GROUPS = 3

_KNOWN = frozenset({"slip", "vertical_load_n", "unit_weight_n_m3"})
"""What of `Conditions` a table gives."""
_TRACELESS = 1e-6
"""Share of the error of form below which a cause of its prior's size changes nothing that was measured."""


@dataclass(frozen=True)
class SkidLaw:
    """Z = Z0 + H2 s^2.

    Attributes
    ----------
    H2_sigma_m : float
        From the scatter about the law.
    left_out_rms_m : float
        Of groups (one speed each) that the fit has not seen.
    """

    static_sinkage_m: float
    H2_m: float
    H2_sigma_m: float
    left_out_rms_m: float
    rows: int


def driven_rows(table: Bench) -> Bench:
    """Return a table with the rows of its driven wheel; a slip just below 0 counts as 0."""
    rows = table.rows[table.rows.slip > -NO_SLIP]
    return replace(table, rows=replace(rows, slip=np.maximum(rows.slip, 0.0)))


def skid_law(table: Bench) -> SkidLaw | None:
    """Return the law of a table's braked rows; None where sinkage was measured at fewer than three braked speeds."""
    rows = table.rows
    chosen = (rows.slip < NO_SLIP) & np.isfinite(rows.sinkage_m)
    slip, sinkage = np.minimum(rows.slip[chosen], 0.0), rows.sinkage_m[chosen]
    group = groups_of_rows(rows.run[chosen], slip, rows.vertical_load_n[chosen]) if chosen.any() else np.zeros(0)
    if len(np.unique(group[slip < -NO_SLIP])) < _LEAST_GROUPS:
        return None
    design = np.column_stack([np.ones_like(slip), slip**2])
    values = np.linalg.lstsq(design, sinkage, rcond=None)[0]
    error = sinkage - design @ values
    variance = float(error @ error) / max(len(error) - 2, 1)
    sigma = float(np.sqrt(variance * np.linalg.inv(design.T @ design)[1, 1]))
    held_out = [_held_out_error(design, sinkage, group == g) for g in np.unique(group)]
    rms = float(np.sqrt(np.mean(np.concatenate(held_out) ** 2)))
    return SkidLaw(float(values[0]), float(values[1]), sigma, rms, int(chosen.sum()))


def _held_out_error(design: FloatArray, sinkage: FloatArray, rows: BoolArray) -> FloatArray:
    values = np.linalg.lstsq(design[~rows], sinkage[~rows], rcond=None)[0]
    return np.asarray(sinkage[rows] - design[rows] @ values)


@dataclass(frozen=True)
class Library:
    """Causes that a table can identify.

    Attributes
    ----------
    uses : tuple of CauseUse
        Candidates, as they act.
    not_identifiable : mapping family -> why
        Families that are excluded, or never named, for want of something.
    """

    uses: tuple[CauseUse, ...]
    not_identifiable: dict[str, Note]

    @property
    def families(self) -> tuple[str, ...]:
        """Families of the candidates."""
        return tuple(dict.fromkeys(family_of(use) for use in self.uses))


def family_of(use: CauseUse) -> str:
    """Return the family of a cause."""
    return EFFECTS[use.key].name


def library(problem: BenchProblem, keys: Sequence[str] = tuple(EFFECTS), table: int | None = None) -> Library:
    """Return the causes that the rows can identify.

    Parameters
    ----------
    keys : sequence of str
        Of the effects to consider.
    table : int, optional
        Causes of this table only, with values of their own; else causes of all.
    """
    coverage = coverage_of(problem, table)
    effects = hypotheses_of(coverage, keys, problem.reading)
    lacking = {e.name: why for e in effects if (why := ruled_out(e, coverage))}
    uses = [CauseUse(e.key(), table) for e in considered(coverage, keys, problem.reading)]
    traced = _traced(problem, uses)
    left = {family_of(use) for use in traced}
    braked = not (problem.slip > 0).any()
    traceless = Note(LackCode.NO_TRACE, values={"channels": problem.channels, "braked": braked})
    unused_channels = {family_of(use): traceless for use in uses if family_of(use) not in left}
    return Library(traced, {**not_identifiable(coverage), **lacking, **unused_channels})


def coverage_of(problem: BenchProblem, table: int | None = None) -> Coverage:
    """Return what the rows cover.

    With `table` its tyre is asked for; else a tyre counts that all tables have.
    """
    tyres = {b.tyre for i, b in enumerate(problem.tables) if table in (None, i)}
    measured = {channel for channel in OUTPUTS if np.isfinite(problem.measured(channel)).any()}
    return Coverage(
        conditions=_KNOWN,
        channels=frozenset(OUTPUTS[c].role for c in problem.channels),
        unused_channels=frozenset(OUTPUTS[c].role for c in measured - set(problem.channels)),
        load_spread=float(np.ptp(problem.load_n) / problem.load_n.mean()),
        both_directions=False,
        several_passes=False,
        several_runs=False,
        pressures=False,
        standstill=False,
        driven=bool((problem.slip > 0).any()),
        braked=bool((problem.slip < 0).any()),
        largest_slip=float(problem.slip.max(initial=0.0)),
        tyre=tyres.pop() if len(tyres) == 1 else "",
    )


def _traced(problem: BenchProblem, uses: Sequence[CauseUse]) -> tuple[CauseUse, ...]:
    """Return the causes that change something that was measured."""
    hypotheses: list[Hypothesis] = [(use,) for use in uses]
    if not hypotheses:
        return ()
    widest = max(problem.size(h) for h in hypotheses)
    lab = np.zeros((len(hypotheses) + 1, widest))
    for row, hypothesis in zip(lab[1:], hypotheses, strict=True):
        row[problem.soil_offsets[-1] : problem.size(hypothesis)] = 1.0
    predicted, _ = problem.evaluate([(), *hypotheses], lab)
    change = np.zeros(len(hypotheses))
    for noise, rows in zip(problem.noises, problem.rows, strict=True):
        size = np.abs(predicted[noise.channel][1:, rows] - predicted[noise.channel][0, rows]) / noise.form_scale
        change = np.maximum(change, np.nan_to_num(size, nan=1.0).max(axis=1))
    return tuple(use for use, size in zip(uses, change, strict=True) if size > _TRACELESS)


def sets_of(uses: Sequence[CauseUse], listed: Hypotheses) -> dict[Hypothesis, float]:
    """Return the listed sets with the logarithm of their prior.

    Parameters
    ----------
    uses : sequence of CauseUse
        Of the effects that are listed, in their order.
    """
    rows = zip(listed.members.tolist(), listed.log_prior.tolist(), strict=True)
    return {tuple(uses[i] for i in members if i >= 0): p for members, p in rows}


def listed_uses(uses: Sequence[CauseUse], most: int) -> Hypotheses:
    """List the sets of up to two causes, with a prior that counts those of up to `most`; see `listed_sets`."""
    return listed_sets({use.key: family_of(use) for use in uses}, most, triples=False)
