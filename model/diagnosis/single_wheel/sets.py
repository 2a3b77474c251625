"""Which causes make sense for a bench, and the sets of them with their prior.

The sinkage of a braked wheel: a law of its own, fitted to rows with s <= 0 alone.

Z = Z0 + H2 s^2 with Z0 the sinkage at no slip, as it was measured. Rows with s < 0 do not enter the fit of a driven
wheel, whose laws say nothing of them: a locked wheel ploughs, and pulls back with more than its friction.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb, log

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.core.campaign import Bench, DiagnosisOptions
from model.diagnosis.core.prior import SIZE_PRIOR
from model.diagnosis.single_wheel.noise import groups_of_rows
from model.diagnosis.single_wheel.problem import BenchProblem, CauseUse, Hypothesis
from model.effects.catalogue import EFFECTS

FloatArray = NDArray[np.float64]

NO_SLIP = 0.02
"""Slip below which a wheel neither drives nor brakes: a controller's residue."""
_LEAST_GROUPS = 3


@dataclass(frozen=True)
class SkidLaw:
    """Z = Z0 + H2 s^2.

    Attributes
    ----------
    static_sinkage_m, H2_m : float
    H2_sigma_m : float
        From the scatter about the law.
    left_out_rms_m : float
        Of groups (one speed each) that the fit has not seen.
    rows : int
    """

    static_sinkage_m: float
    H2_m: float
    H2_sigma_m: float
    left_out_rms_m: float
    rows: int


def driven_rows(bench: Bench) -> Bench:
    """Return a bench with the rows of its driven wheel; a slip just below 0 counts as 0."""
    rows = bench.rows[bench.rows.slip > -NO_SLIP]
    return replace(bench, rows=replace(rows, slip=np.maximum(rows.slip, 0.0)))


def skid_law(bench: Bench) -> SkidLaw | None:
    """Return the law of a bench's braked rows; None where sinkage was measured at fewer than three braked speeds."""
    rows = bench.rows
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
    left_out = [_left_out(design, sinkage, group == g) for g in np.unique(group)]
    rms = float(np.sqrt(np.mean(np.concatenate(left_out) ** 2)))
    return SkidLaw(float(values[0]), float(values[1]), sigma, rms, int(chosen.sum()))


def _left_out(design: FloatArray, sinkage: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
    values = np.linalg.lstsq(design[~rows], sinkage[~rows], rcond=None)[0]
    return np.asarray(sinkage[rows] - design[rows] @ values)


_KNOWN = ("unit_weight_n_m3",)
"""What of `Conditions` a table gives beyond slip and load."""
_UNSEEN = 1e-6
"""Share of the error of form below which a cause of its prior's size changes nothing that was measured."""
_NEEDS = {
    "ground_speed_mps": "the ground speed",
    "ground_acceleration_mps2": "the acceleration",
    "ground_jerk_mps3": "its change",
    "wheel_acceleration_radps2": "the wheel's acceleration",
    "line_position": "the position along a line",
    "campaign_time": "the time",
    "direction": "the direction of travel",
    "pass_number": "the pass",
    "inflation_kpa": "the inflation pressure",
}


@dataclass(frozen=True)
class Library:
    """Causes that a bench can tell of.

    Attributes
    ----------
    uses : tuple of CauseUse
        Candidates, as they act.
    cannot_tell : mapping family -> why
        Families that are left out for want of something.
    ruled_out : mapping family -> why
        Families that cannot be, as the vehicle is declared.
    """

    uses: tuple[CauseUse, ...]
    cannot_tell: dict[str, str]
    ruled_out: dict[str, str]

    @property
    def families(self) -> tuple[str, ...]:
        """Families of the candidates."""
        return tuple(dict.fromkeys(family_of(use) for use in self.uses))


def family_of(use: CauseUse) -> str:
    """Return the family of a cause."""
    return EFFECTS[use.key].name


def library(problem: BenchProblem, options: DiagnosisOptions, bench: int | None = None) -> Library:
    """Return the causes that the rows can tell of.

    Parameters
    ----------
    problem : BenchProblem
    options : DiagnosisOptions
    bench : int, optional
        Causes of this bench only, with values of their own; else causes of all.
    """
    uses: list[CauseUse] = []
    cannot_tell: dict[str, str] = {}
    ruled_out: dict[str, str] = {}
    tyres = [b.tyre for i, b in enumerate(problem.benches) if bench in (None, i)]
    for key in options.effects:
        effect = EFFECTS[key]
        if effect.reading not in ("any", options.reading):
            continue
        wanted = [need for need in effect.needs if need not in _KNOWN]
        if all(tyre in effect.excluded_tyres for tyre in tyres):
            ruled_out[effect.name] = f"the wheel is declared {tyres[0]}"
        elif wanted:
            words = " and ".join(_NEEDS.get(need, need) for need in wanted)
            cannot_tell[effect.name] = f"a table of single rows does not hold {words}"
        else:
            uses.append(CauseUse(key, bench))
    told = _seen(problem, uses)
    for use in uses:
        if use not in told and family_of(use) not in {family_of(other) for other in told}:
            cannot_tell[family_of(use)] = _unseen_words(problem)
    return Library(told, cannot_tell, ruled_out)


def _seen(problem: BenchProblem, uses: Sequence[CauseUse]) -> tuple[CauseUse, ...]:
    """Return the causes that change something that was measured."""
    hypotheses: list[Hypothesis] = [(use,) for use in uses]
    if not hypotheses:
        return ()
    widest = max(problem.size(h) for h in hypotheses)
    lab = np.zeros((len(hypotheses) + 1, widest))
    for row, hypothesis in zip(lab[1:], hypotheses, strict=True):
        row[problem.soil_offsets[-1] : problem.size(hypothesis)] = 1.0
    said, _ = problem.evaluate([(), *hypotheses], lab)
    change = np.zeros(len(hypotheses))
    for noise, rows in zip(problem.noises, problem.rows, strict=True):
        size = np.abs(said[noise.channel][1:, rows] - said[noise.channel][0, rows]) / noise.form_scale
        change = np.maximum(change, np.nan_to_num(size, nan=1.0).max(axis=1))
    return tuple(use for use, size in zip(uses, change, strict=True) if size > _UNSEEN)


def _unseen_words(problem: BenchProblem) -> str:
    driven = "s > 0" if (problem.slip > 0).any() else "s < 0"
    return f"it changes nothing that was measured ({', '.join(problem.channels)}; rows with {driven} only)"


@dataclass(frozen=True)
class Sets:
    """Sets of causes with the logarithm of their prior.

    Attributes
    ----------
    uses : tuple of CauseUse
    log_prior : mapping Hypothesis -> float
        Of the listed sets among all sets of up to the largest size.
    most : int
    """

    uses: tuple[CauseUse, ...]
    log_prior: dict[Hypothesis, float]
    most: int

    @staticmethod
    def of(uses: Sequence[CauseUse], most: int) -> Sets:
        """Return none, every cause, and every pair; sets of three wait for `with_thirds`."""
        empty = Sets(tuple(uses), {}, most)
        return empty._with(s for size in range(min(most, 2) + 1) for s in combinations(uses, size))

    def with_thirds(self, pairs: Iterable[Hypothesis]) -> Sets:
        """Return the sets with every third cause added to some pairs."""
        order = {use: i for i, use in enumerate(self.uses)}
        return self._with(
            tuple(sorted((*pair, third), key=order.__getitem__))
            for pair in pairs
            for third in self.uses
            if third not in pair
        )

    def _with(self, more: Iterable[Hypothesis]) -> Sets:
        families = [family_of(use) for use in self.uses]
        count = len(set(families))
        possible = [p if comb(count, size) and size <= self.most else 0.0 for size, p in enumerate(SIZE_PRIOR)]
        found = dict(self.log_prior)
        for chosen in more:
            own = [family_of(use) for use in chosen]
            if len(set(own)) < len(own):
                continue
            each = possible[len(chosen)] / sum(possible) / comb(count, len(chosen))
            found[chosen] = log(each) - sum(log(families.count(family)) for family in own)
        return Sets(self.uses, found, self.most)
