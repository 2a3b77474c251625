r"""How much a channel swings with the turning wheel, by order: by cycles a turn.

A spectrum of measured less simulated shows the errors of slip above all. Here each order is a pair of columns,
cos k psi and sin k psi with the wheel's angle psi, fitted to a run under the diagnosis's own noise model, so that what
the errors of speed, load and soil explain does not count. With a the two amplitudes of a run and v half the trace of
their covariance, runs are put together as

.. math:: A^2 = \frac{\sum |a|^2/v}{\sum 1/v}, \qquad \sum |a|^2/v \sim \chi^2_{2R} \text{ under noise alone.}

A run begins at an unknown angle: only the size of its swing counts, not its phase.
"""

from __future__ import annotations

import numpy as np
import scipy

from daq import BoolArray, FloatArray
from model.diagnosis.core.plot_data import WheelOrders
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, notes_of
from model.diagnosis.time_series.noise import named, swing_seen
from model.diagnosis.time_series.samples import places_of
from model.diagnosis.time_series.start import CampaignData
from model.diagnosis.time_series.whitening import some_runs, state_space, whiten
from model.notes import DiagnosisCode

_STEP = 0.05
_LOWEST, _HIGHEST = 0.3, 3.0
_OF_NYQUIST = 0.8
_LEAST_SAMPLES = 30
_AT_ONCE = 14
"""Orders that are whitened together: what bounds the memory of a long campaign."""
_CHANCE = 0.95
_SLOWEST_RADPS = 0.1
_LARGEST = 1e6
"""Of a swing, in N or N m: what keeps a pair that a run does not show from being singular."""


def wheel_orders_of(linearised: LinearisedCampaign, index: int) -> dict[str, WheelOrders]:
    """Return the orders of each channel of a campaign that is said to swing once a turn of the wheel."""
    data = linearised.campaigns[index]
    channels = [str(note.values["channel"]) for note in notes_of(data) if note.code == DiagnosisCode.WHEEL_ORDER]
    if not channels:
        return {}
    left = _left(linearised, index)
    return {channel: orders for channel in channels if (orders := _orders(data, left, channel)) is not None}


def _left(linearised: LinearisedCampaign, index: int) -> FloatArray:
    """Return what the best explanation leaves of a campaign's channels, shape (c, n)."""
    data, best = linearised.campaigns[index], linearised.best
    sizes = {(c.key, c.parameter): x * c.scale for c, x in zip(linearised.grams.causes, best.coefficients, strict=True)}
    causes = [sizes[c.key, c.parameter] / c.scale for c in data.columns.causes]
    known = np.concatenate([best.soil[linearised.soil_of(index)], causes])
    return np.asarray(data.columns.rows[..., 0] - data.columns.rows[..., 1 : 1 + len(known)] @ known)


def _orders(data: CampaignData, left: FloatArray, channel: str) -> WheelOrders | None:
    """Return the orders of one channel; None where no run is long enough, or blocks too long for the first order."""
    samples, row = data.samples, data.linear.channels.index(channel)
    long = np.bincount(samples.run[data.columns.present[row]], minlength=samples.runs) >= _LEAST_SAMPLES
    speed = max(float(np.median(np.abs(samples.conditions.wheel_speed_radps))), _SLOWEST_RADPS)
    highest = min(_HIGHEST, _OF_NYQUIST * np.pi / (samples.block_s * speed))
    if not long.any() or highest < 1.0:
        return None
    order = np.arange(_LOWEST, highest + _STEP / 2, _STEP)
    pieces = [_swings(data, left, row, order[i : i + _AT_ONCE], long) for i in range(0, len(order), _AT_ONCE)]
    power, weight = np.concatenate(pieces, axis=1)
    by_chance = float(scipy.special.chdtri(2 * int(long.sum()), 1.0 - _CHANCE))
    return WheelOrders(order, np.sqrt(power / weight), np.sqrt(by_chance / weight))


def _swings(data: CampaignData, left: FloatArray, row: int, order: FloatArray, long: BoolArray) -> FloatArray:
    """Return the sums over runs of |a|^2/v and of 1/v, shape (2, k)."""
    samples, columns, values = data.samples, data.columns, data.noise.values
    turning = order[:, None] * samples.wheel_angle_rad
    seen = np.stack([swing_seen(samples, float(each)) for each in order])
    pairs = np.zeros((*left.shape, 2 * len(order)))
    pairs[row] = np.stack([seen * np.cos(turning), seen * np.sin(turning)], axis=1).reshape(-1, len(samples)).T
    pairs *= columns.present[..., None]
    own = named(data.linear.channels[row], "wheel_order")
    others = [i for i, name in enumerate(columns.constants) if name != own]
    constants = columns.rows[..., columns.varying :][..., others] * [values[columns.constants[i]] for i in others]
    together = np.concatenate([constants, left[..., None], pairs], axis=-1)
    space = state_space(samples, data.linear, columns.present, values, data.speed_variance)
    at = places_of(samples.run, samples.runs)
    found = np.zeros((2, len(order)))
    for first, last in some_runs(samples.runs):
        rows = whiten(space.runs(first, last), at.padded_runs(together, first, last)).columns
        found += _of_runs(_without(rows[long[first:last]], len(others)))
    return found


def _without(rows: FloatArray, keep: int) -> FloatArray:
    """Return cross products of whitened columns, shape (runs, m, m), with the first `keep` integrated out."""
    full = rows.swapaxes(1, 2) @ rows
    across = full[:, :keep, keep:]
    solved = np.linalg.solve(np.eye(keep) + full[:, :keep, :keep], across)
    return np.asarray(full[:, keep:, keep:] - across.swapaxes(1, 2) @ solved)


def _of_runs(grams: FloatArray) -> FloatArray:
    """Return the sums over runs of |a|^2/v and of 1/v by order; `grams` of what is left and of each order's pair."""
    found = np.zeros((2, grams.shape[-1] // 2))
    for i in range(found.shape[1]):
        own = slice(1 + 2 * i, 3 + 2 * i)
        covariance = np.linalg.inv(grams[:, own, own] + np.eye(2) / _LARGEST**2)
        a = (covariance @ grams[:, own, 0][..., None])[..., 0]
        v = 0.5 * np.trace(covariance, axis1=1, axis2=2)
        found[:, i] = ((a**2).sum(axis=1) / v).sum(), (1.0 / v).sum()
    return found
