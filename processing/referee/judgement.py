"""Posterior probability that a run is sound as declared, and of each mistake that would explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import log

import numpy as np
from numpy.typing import NDArray

from daq import STANDARD_GRAVITY_MPS2, BoolArray, FloatArray
from processing.referee import densities as known
from processing.referee.mends import JUDGED_ROLES, MENDS, RADIUS, UNLISTED, Kind, Mend

REFUSED_BELOW = 1e-3
NAMED_ABOVE = 0.99
SOUND = Mend(Kind.SIGN)
"""Nothing is mistaken."""
_ROWS = 40
_ROUGH = 5
"""Every so many samples are looked at to find the mends that are hopeless."""
_HOPELESS = 40.0
_MOVING_SHARE, _MOVING_SHARES = 0.1, np.array([0.1, 0.25])
_FAST_QUANTILE, _LEAST_QUANTILE = 0.9, 0.1
_LEAST_ROWS = 10
_LEAST_LOAD = 0.2
_CELLS = 4
_USUAL_TRACTION = 0.5
_ABSURD = 1e6
"""Force over load beyond which no more is told by more."""
_MOST_FORCE = 1.5
_V, _OMEGA, _W, _D, _T = range(len(JUDGED_ROLES))


@dataclass(frozen=True)
class Evidence:
    """What the referee looks at.

    Attributes
    ----------
    channels : mapping role -> float64 array, shape (n,)
        As declared, in SI; only those measured.
    mass_kg : float or None
        Of the vehicle with its added load.
    against_track : mapping role -> float
        Size of a channel over the speed of the GNSS positions, where these move.
    """

    channels: Mapping[str, FloatArray]
    radius_m: float
    mass_kg: float | None = None
    against_track: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Ruling:
    """What is probable of a run.

    Attributes
    ----------
    sound : float
        Posterior probability that it is as declared.
    mends : tuple of (Mend, float)
        Mistakes and their probabilities, the most probable first.
    """

    sound: float
    mends: tuple[tuple[Mend, float], ...] = ()

    @property
    def refused(self) -> bool:
        """Whether the run is impossible as declared."""
        return self.sound < REFUSED_BELOW

    @property
    def doubted(self) -> bool:
        """Whether some mistake is more probable than none."""
        return bool(self.mends) and self.mends[0][1] > self.sound

    @property
    def named(self) -> tuple[Mend, ...]:
        """The mistake that is nearly certain, or the fewest that together are."""
        together = np.cumsum([probability for _, probability in self.mends])
        before = int(np.searchsorted(together, NAMED_ABOVE * (1 - self.sound), side="right"))
        return tuple(mend for mend, _ in self.mends[: before + 1])


def is_judged(evidence: Evidence) -> bool:
    """Return whether there are samples enough in motion."""
    return _rows(evidence) is not None


def judge(evidence: Evidence) -> Ruling:
    """Return the posterior over sound and every mend that the measured channels allow."""
    rows = _rows(evidence)
    if rows is None:
        return Ruling(1.0)
    samples = _effective_samples(rows)
    possible = [
        SOUND,
        *(mend for mend in MENDS if all(role == RADIUS or role in evidence.channels for role in mend.roles)),
    ]
    rough = _scores(evidence, rows[:, ::_ROUGH], possible, samples)
    kept = np.flatnonzero((rough > rough.max() - _HOPELESS) | (np.arange(len(possible)) == 0))
    possible = [possible[i] for i in kept]
    logs = np.append(_scores(evidence, rows, possible, samples), known.UNLISTED * samples)
    possible.append(UNLISTED)
    logs[1:] += log(known.MEND_PRIOR)
    shares = np.exp(logs - logs.max())
    shares /= shares.sum()
    order = np.argsort(-shares[1:], kind="stable")
    return Ruling(float(shares[0]), tuple((possible[i + 1], float(shares[i + 1])) for i in order))


def _rows(evidence: Evidence) -> FloatArray | None:
    """Return thinned samples of all channels, shape (5, n), NaN where not measured; None with too few."""
    if not evidence.channels:
        return None
    stack = np.array([evidence.channels[role] for role in JUDGED_ROLES if role in evidence.channels])
    whole = np.flatnonzero(np.isfinite(stack).all(axis=0))
    moving = np.zeros(len(whole), np.bool_)
    for role, noise in zip(
        JUDGED_ROLES, (known.SPEED_SIGMA_MPS, known.SPEED_SIGMA_MPS / evidence.radius_m), strict=False
    ):
        if role in evidence.channels and len(whole):
            size = np.abs(evidence.channels[role][whole])
            moving |= size > np.clip(noise, *np.quantile(size, _FAST_QUANTILE) * _MOVING_SHARES)
    whole = whole[moving]
    if len(whole) < _LEAST_ROWS:
        return None
    chosen = whole[np.unique(np.linspace(0, len(whole) - 1, _ROWS).astype(np.int64))]
    unknown = np.full(stack.shape[1], np.nan)
    return np.array([evidence.channels.get(role, unknown)[chosen] for role in JUDGED_ROLES])


def _scores(evidence: Evidence, rows: FloatArray, mends: Sequence[Mend], samples: float) -> FloatArray:
    """Return the log score of every mend, shape (h,); 0 is perfect. So many `samples` are independent."""
    order = np.tile(np.arange(len(JUDGED_ROLES)), (len(mends), 1))
    factor = np.ones(order.shape)
    radius = np.full(len(mends), evidence.radius_m)
    for i, mend in enumerate(mends):
        radius[i] *= mend.factors.get(RADIUS, 1.0)
        factor[i] = [mend.factors.get(role, 1.0) for role in JUDGED_ROLES]
        if mend.exchanged:
            first, second = (JUDGED_ROLES.index(role) for role in mend.exchanged)
            order[i, first], order[i, second] = second, first
    values = rows[order] * factor[:, :, np.newaxis]
    against = np.array([evidence.against_track.get(role, np.nan) for role in JUDGED_ROLES])
    track = against[order[:, _V]] * np.abs(factor[:, _V])
    return _of_sizes(values, radius, track, evidence.mass_kg) + _of_samples(values, radius, samples)


def _effective_samples(rows: FloatArray) -> float:
    """Return how many samples count as independent: more where speeds and forces vary; the same for every mend."""
    known_rows = rows[np.isfinite(rows).all(axis=1)]
    usual = np.maximum(np.quantile(np.abs(known_rows), _FAST_QUANTILE, axis=1), 1e-12)[:, np.newaxis]
    relative = np.rint(known_rows / usual * _CELLS).astype(np.int64)
    if np.isfinite(rows[:2]).all():
        ratio = np.log(np.maximum(np.abs(rows[_V]), 1e-9) / np.maximum(np.abs(rows[_OMEGA]), 1e-9))
        ratio = np.clip(ratio - np.median(ratio), -3, 3)
        relative = np.vstack([relative[2:], np.rint(ratio * _CELLS)])
    pull = 1 if np.isfinite(rows[_D]).all() else 0
    cells = len(np.unique(relative[[pull, -1]], axis=1).T) if len(relative) > 1 else 1
    return float(known.LEAST_SAMPLES + known.PER_CELL * cells)


def _of_sizes(values: FloatArray, radius: FloatArray, track: FloatArray, mass_kg: float | None) -> FloatArray:
    """Return the log score of speeds, load and radius by their size alone, shape (h,)."""
    fast = np.quantile(np.abs(values), _FAST_QUANTILE, axis=2)
    load = np.median(np.abs(values[:, _W]), axis=1)
    of_load = known.LOG_LOAD if mass_kg is None else known.LOG_SHARE
    weight = 1.0 if mass_kg is None else mass_kg * STANDARD_GRAVITY_MPS2
    found = [
        (radius, known.LOG_RADIUS),
        (fast[:, _V], known.LOG_SPEED),
        (fast[:, _OMEGA] * radius, known.LOG_SPEED),
        (load / weight, of_load),
        (track, known.LOG_TRACK),
    ]
    with np.errstate(divide="ignore"):
        scores = [known.student(np.log(np.maximum(size, 1e-9)) - middle, *shape) for size, (middle, *shape) in found]
    return np.asarray(np.nansum(np.maximum(scores, known.OF_WRONG_REFERENCE), axis=0))


def _of_samples(values: FloatArray, radius: FloatArray, samples: float) -> FloatArray:
    """Return the log score of slip, traction and resistance over all grounds, shape (h,)."""
    wheel = _wheel_ratios(values, radius)
    score = known.student(np.maximum(np.abs(wheel.slip) - 1, 0), known.EXCESS_SIGMA) + wheel.of_load
    if not wheel.measured[[_T, _D]].any():
        score = score + np.array(
            [known.student(wheel.slip, np.where(wheel.slip < 0, *two)) for _, *two in known.FREE_SLIP]
        )
        weight = np.array([of_kind for of_kind, *_ in known.FREE_SLIP])[:, np.newaxis]
    else:
        score = score - (known.TAIL + 1) / 2 * np.log(_odds(wheel))
        weight = known.ground_weights()[:, np.newaxis]
    each = samples * (score * wheel.weight).sum(axis=2) + weight
    best = each.max(axis=0)
    return np.asarray(_of_whole(wheel) + best + np.log(np.exp(each - best).sum(axis=0)), np.float64)


def _of_whole(wheel: _Ratios) -> FloatArray:
    """Return the log score of the least slip and sliding, and of how the pull follows the traction, shape (h,)."""
    score = np.zeros(len(wheel.slip))
    if wheel.measured[[_V, _OMEGA]].all():
        for size, scale in (wheel.slip, known.LEAST_SLIP), (wheel.slip * wheel.faster, known.LEAST_SLIDING_MPS):
            score += known.student(np.quantile(np.abs(size), _LEAST_QUANTILE, axis=1), scale)
    if wheel.measured[[_T, _D]].all():
        both = np.array([wheel.traction, wheel.pull], np.float64)
        both -= (wheel.weight * both).sum(axis=2, keepdims=True)
        (of_traction, shared), (_, of_pull) = np.einsum("hn,ahn,bhn->abh", wheel.weight, both, both)
        most = (of_traction + of_pull + np.hypot(of_traction - of_pull, 2 * shared)) / 2
        by_resistance = known.RESISTANCE_SIGMA**2 / 2 / np.maximum(most, 1e-12)  # which varies along the track
        score += known.student(np.arctan2(of_traction - of_pull, 2 * shared) / 2, known.AXIS_SIGMA + by_resistance)
    return score


def _odds(wheel: _Ratios) -> NDArray[np.float32]:
    """Return 1 + z^2/nu of traction over slip and of resistance, multiplied, on every ground, shape (k, h, n)."""
    curve, slope, resistance = known.grounds()
    level = resistance[:, np.newaxis, np.newaxis]
    odds: NDArray[np.float32] = np.ones((len(level), *wheel.slip.shape), np.float32)
    if wheel.measured[[_V, _OMEGA]].all():
        node = np.rint((np.clip(wheel.slip, -1, 1) + 1) * (len(known.NODES) - 1) / 2).astype(np.int64)
        expected = curve[:, node]
        steep = slope[:, node] * (known.SLIP_SIGMA + known.SPEED_SIGMA_MPS / wheel.faster)
        variance = known.TRACTION_SIGMA**2 + (known.TRACTION_GAIN * expected) ** 2 + steep**2
        measured = wheel.traction if wheel.measured[_T] else wheel.pull + level
        odds += (measured - expected) ** 2 / (known.TAIL * variance)
    if wheel.measured[[_T, _D]].all():
        lost = wheel.traction - wheel.pull - level
        sigma = wheel.balance_sigma + np.where(lost > 0, known.SINKAGE_SIGMA * np.clip(wheel.slip, 0, 1), 0)
        odds *= 1 + (lost / sigma) ** 2 / known.TAIL
    return odds


@dataclass(frozen=True)
class _Ratios:
    """Samples, arrays of shape (h, n): slip, the faster of rim and ground, forces over the load; 0 if not measured.

    `measured` is of the channels, shape (5,).
    """

    weight: NDArray[np.float32]
    slip: NDArray[np.float32]
    faster: NDArray[np.float32]
    traction: NDArray[np.float32]
    pull: NDArray[np.float32]
    balance_sigma: NDArray[np.float32]
    of_load: NDArray[np.float32]
    measured: BoolArray


def _wheel_ratios(values: FloatArray, radius: FloatArray) -> _Ratios:
    measured = np.isfinite(values[0]).all(axis=1)
    values = np.where(np.isfinite(values), values, 0.0)
    has_slip = bool(measured[_V] and measured[_OMEGA])
    ground, rim = values[:, _V], values[:, _OMEGA] * radius[:, np.newaxis]
    faster = np.maximum(np.abs(ground), np.abs(rim))
    usual = np.maximum(np.quantile(faster, _FAST_QUANTILE, axis=1), 1e-9)[:, np.newaxis]
    weight = np.where(faster >= _MOVING_SHARE * usual, 1.0, 0.0) if has_slip else np.ones(faster.shape)
    faster = np.maximum(faster, _MOVING_SHARE * usual)
    forward = np.where(rim + ground < 0, -1.0, 1.0)
    slip = forward * (rim - ground) / faster * has_slip
    rim_force, pull, load = values[:, _T] / radius[:, np.newaxis], values[:, _D], values[:, _W]
    size = np.abs(load)
    if not measured[_W]:  # the usual traction stands for the load
        size = np.maximum(np.abs(rim_force), np.abs(pull)) / _USUAL_TRACTION
        size = np.broadcast_to(np.quantile(size, _FAST_QUANTILE, axis=1)[:, np.newaxis], size.shape)
    carried = np.maximum(np.maximum(size, _LEAST_LOAD * np.median(size, axis=1)[:, np.newaxis]), 1e-9)
    traction, pull = (np.clip(forward * x / carried, -_ABSURD, _ABSURD) for x in (rim_force, pull))
    gain = np.minimum(np.maximum(np.abs(traction), np.abs(pull)), _MOST_FORCE)
    return _Ratios(
        weight=_single(weight / np.maximum(weight.sum(axis=1), 1)[:, np.newaxis]),
        slip=_single(slip),
        faster=_single(faster),
        traction=_single(traction),
        pull=_single(pull),
        balance_sigma=_single(known.RESISTANCE_SIGMA + known.RESISTANCE_GAIN * gain),
        of_load=_single(np.where(load < 0, known.OF_LIFTED_LOAD, 0.0)),
        measured=measured,
    )


def _single(values: FloatArray) -> NDArray[np.float32]:
    return values.astype(np.float32)
