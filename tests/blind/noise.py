"""The covariance of measured less simulated at 5 Hz, exactly as the generator makes it."""

from __future__ import annotations

from collections.abc import Callable
from math import log, pi, sqrt

import numpy as np
from blind.colour import Colour
from blind.driving import RATE_HZ
from blind.field import FieldDay
from blind.ground import RUN_SCATTER
from blind.sight import Sight
from blind.standing import rest_covariance

from daq import FloatArray

_FINE_S = 0.005
_BLOCK_S = 0.2


def _window(cutoff_hz: float) -> FloatArray:
    """Return the response of the common filter and a block mean, on a grid of 5 ms, summing to 1."""
    sigma = sqrt(log(2)) / (2 * pi * cutoff_hz)
    at = np.arange(-0.6, 0.6 + _FINE_S / 2, _FINE_S)
    bell = np.exp(-0.5 * (at / sigma) ** 2)
    box = (np.abs(at) <= _BLOCK_S / 2).astype(float)
    both = np.convolve(bell, box, mode="same")
    return both / both.sum()


class Filtered:
    """Correlations of noises after the filter that every channel passes."""

    def __init__(self, slowest_hz: float) -> None:
        self.window = _window(min(5.0, slowest_hz / 5))
        self.overlap = np.correlate(self.window, self.window, mode="full")
        self.lag_s = (np.arange(len(self.overlap)) - len(self.overlap) // 2) * _FINE_S

    def coloured(self, apart_s: FloatArray, colour: Colour, rate_hz: float) -> FloatArray:
        """Return the correlation of noise of unit variance at these distances in time, sampled at a rate."""
        found = self._at(apart_s, colour.correlation)
        return found + colour.white * self.white(apart_s, rate_hz) if colour.white else found

    def white(self, apart_s: FloatArray, rate_hz: float) -> FloatArray:
        """Return the same of unit white noise sampled at a rate."""
        density = self.overlap / _FINE_S / rate_hz
        return np.interp(np.abs(apart_s), self.lag_s, density)

    def ripple(self, omega: FloatArray) -> FloatArray:
        """Return what is left of a ripple once a revolution."""
        at = (np.arange(len(self.window)) - len(self.window) // 2) * _FINE_S
        return np.cos(np.outer(omega, at)) @ self.window

    def _at(self, apart_s: FloatArray, correlation: Callable[[FloatArray], FloatArray]) -> FloatArray:
        grid = np.arange(0.0, float(np.max(np.abs(apart_s), initial=0.0)) + 0.05, 0.05)
        values = correlation(grid[:, None] + self.lag_s) @ self.overlap
        return np.interp(np.abs(apart_s), grid, values)


def filtered(day: FieldDay) -> Filtered:
    """Return the filter that the campaign's slowest channel asks for."""
    return Filtered(min(day.suite.gnss_hz, day.suite.wheel_hz, day.suite.force_hz))


def instrument_covariance(day: FieldDay, sight: Sight) -> FloatArray:
    """Return C_i, shape (n, 2, 2): instruments' noise, speed and load error carried through."""
    suite, f, zero = day.suite, filtered(day), np.zeros(1)
    force = f.coloured(zero, suite.force, suite.force_hz)[0]
    slow = f.coloured(zero, suite.speed, suite.gnss_hz)[0] * suite.speed_mps**2
    speed = slow + f.white(zero, suite.gnss_hz)[0] * suite.speed_white_mps**2
    by_speed, by_load = sight.slopes["speed"], sight.slopes["load"]
    c = np.einsum("in,jn->nij", by_speed, by_speed) * speed
    c += np.einsum("in,jn->nij", by_load, by_load) * (suite.load_n**2 * force + suite.zero_load_n**2)
    c[:, 0, 0] += suite.pull_n**2 * force + suite.zero_pull_n**2
    c[:, 1, 1] += suite.torque_nm**2 * force + suite.zero_torque_nm**2
    return np.asarray(c)


def _angle(day: FieldDay, index: int, time_s: FloatArray) -> FloatArray:
    """Return how far the wheel has turned."""
    motion = day.motions[index]
    return np.interp(time_s - day.plans[index].start_s, motion.time_s, np.cumsum(motion.omega) / RATE_HZ)


def run_covariance(day: FieldDay, sight: Sight, index: int) -> tuple[FloatArray, np.ndarray]:
    """Return a run's covariance, shape (2 k, 2 k) with pull first, and its k rows."""
    rows = np.flatnonzero((sight.run == index) & sight.rows)
    suite, f, m = day.suite, filtered(day), sight.moments.at(rows)
    apart = m.time_s[:, None] - m.time_s
    force = f.coloured(apart, suite.force, suite.force_hz)
    moving = m.rolls
    share = suite.at_rest**2 + (1 - suite.at_rest**2) * np.outer(moving, moving)
    second = m.time_s > 0.5 * (m.time_s[0] + m.time_s[-1])
    same_rest = (second[:, None] == second) * np.outer(1 - moving, 1 - moving)
    blocks = np.zeros((2, len(rows), 2, len(rows)))
    ripple = f.ripple(m.omega) * np.exp(1j * _angle(day, index, m.time_s))
    turning = np.real(np.outer(ripple, np.conj(ripple)))
    white = 1e-3 * np.eye(len(rows))
    load_n = day.plans[index].load_n
    rests = np.outer(1 - moving, 1 - moving)
    standing = rest_covariance(day.stance, m.vehicle, load_n, day.rut_n[load_n], same_rest, rests)
    blocks[0, :, 0] = suite.pull_n**2 * (force * share + white) + suite.rest_pull_n**2 * same_rest
    blocks[0, :, 0] += 0.5 * float(np.sum(np.square(suite.ripple_n))) * turning + suite.zero_pull_n**2
    blocks[1, :, 1] = suite.torque_nm**2 * (force * share + white) + suite.rest_torque_nm**2 * same_rest
    blocks[1, :, 1] += 0.5 * suite.ripple_nm**2 * turning * np.outer(moving, moving) + suite.zero_torque_nm**2
    blocks[0, :, 0] += standing[0]
    blocks[1, :, 1] += standing[1]
    speed = suite.speed_mps**2 * f.coloured(apart, suite.speed, suite.gnss_hz)
    speed += suite.speed_white_mps**2 * f.white(apart, suite.gnss_hz)
    metres = np.abs(m.distance_m[:, None] - m.distance_m)
    patch = np.exp(-metres / day.patchiness.length_m)
    scatter = {key: day.world.scatter * sigma for key, sigma in RUN_SCATTER.items()}
    for key, inner in (
        ("speed", speed),
        ("load", suite.load_n**2 * force * share + suite.zero_load_n**2),
        ("stiffness", day.patchiness.stiffness**2 * patch + scatter["stiffness"] ** 2),
        ("friction", day.patchiness.friction**2 * patch + scatter["friction"] ** 2),
        ("cohesion", np.full(apart.shape, scatter["cohesion"] ** 2)),
    ):
        slope = sight.slopes[key][:, rows]
        blocks += slope[:, :, None, None] * slope[None, None] * inner[None, :, None, :]
    size = 2 * len(rows)
    return blocks.reshape(size, size), rows
