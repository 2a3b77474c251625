"""What four wheels together can tell of an error of one transducer: d and d_sep, from the simulation's truth alone.

As `blind.measures` does for one wheel, with the physics of `blind.wheel`: the truth of `wheelsoil simulate` gives each
wheel's motion and load; the covariance of pull and torque is that of its instruments, with one GNSS error for all
wheels. The laboratory's soil, the scatter of runs and the tilt of the ground at rest, all common to the wheels, are
projected out. A rival is any other family, at all wheels or, where it goes with a wheel, at one of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from blind.causes import ALL, RIVALS
from blind.colour import Colour
from blind.ground import PATCH, RUN_SCATTER, Ground
from blind.measures import explained
from blind.noise import Filtered
from blind.sensors import Suite
from blind.sight import Sight, sight_along, soil_columns
from blind.standing import TILT_RAD
from blind.wheel import Moments, Vehicle
from scipy.linalg import cholesky, solve_triangular

from daq import FloatArray
from model.effects import EFFECTS
from model.simulation import whole
from wheelsoil.simulation.campaign import setup_of_wheel, simulated_stretches, true_soil
from wheelsoil.simulation.options import LAYOUTS

if TYPE_CHECKING:
    from model.simulation import VirtualRun, VirtualSetup
    from wheelsoil.simulation import SimulationOptions

OF_A_WHEEL = frozenset(effect.name for effect in EFFECTS.values() if effect.goes_with_a_wheel())
"""Families that may act at one wheel alone."""
PATCH_M = 2.75
"""Over which length the stiffness usually varies along a track, by `PATCH`; the friction by half as much."""
_UNKNOWN = 1e6
"""Variance of what held brakes carry at rest, N^2."""

Changes = Mapping[str, FloatArray]
"""By wheel how measured less simulated changes, shape (2, n); a wheel that is not there does not change."""


@dataclass(frozen=True)
class Told:
    """What the data of all wheels can tell of one hidden error.

    Attributes
    ----------
    d, d_sep : float
        In all; and what is left where the best other single family explains it, too.
    rival : str
        That family, with its wheel where it acts at one.
    """

    d: float
    d_sep: float
    rival: str


class WheelsYardstick:
    """Measure of signatures in one campaign of several wheels.

    Parameters
    ----------
    options : SimulationOptions
        What they hide is not looked at.
    patchy : bool
        Whether each wheel's ground varies within a run, and each transducer's zeros between runs, as those of
        `blind.ground` and `blind.sensors` usually do. The simulation's do not; a diagnosis has to allow for it.
    """

    def __init__(self, options: SimulationOptions, *, patchy: bool = False) -> None:
        self._options, self._patchy = options, patchy
        self.wheels = LAYOUTS[options.wheels]
        ground = _ground(options)
        self._setup = setup_of_wheel(options, self.wheels[0])
        self.sights = {wheel: self._sight(ground, wheel) for wheel in self.wheels}
        sights = list(self.sights.values())
        self._counts = np.all([sight.rows for sight in sights], axis=0)
        self._filter = Filtered(min(self._setup.gnss.rate_hz, self._setup.wheel_speed.rate_hz))
        self._roots = [self._root(index) for index in range(options.runs)]
        known = np.stack([self.whitened(change) for change in self._nuisances()], axis=1)
        self._known = known
        self._inner = np.linalg.inv(np.eye(known.shape[1]) + known.T @ known)

    def _sight(self, ground: Ground, wheel: str) -> Sight:
        setup = setup_of_wheel(self._options, wheel)
        vehicle = Vehicle(
            self._options.wheel.radius_m,
            self._options.wheel.width_m,
            setup.vehicle.outboard_mass_kg,
            setup.vehicle.outboard_inertia_kgm2,
            setup.vehicle.mass_kg,
            (setup.vehicle.static_load_n,) * 3,
        )
        runs = [whole(simulated_stretches(self._options, index, wheel)) for index in range(self._options.runs)]
        return sight_along([_moments(run, vehicle) for run in runs], ground, [{}] * len(runs))

    def _rows(self, index: int) -> np.ndarray:
        run = next(iter(self.sights.values())).run
        return np.flatnonzero((run == index) & self._counts)

    def _root(self, index: int) -> FloatArray:
        """Return the Cholesky factor of a run's covariance: wheels, then pull and torque, then rows."""
        rows, count = self._rows(index), len(self.wheels)
        blocks = np.zeros((count, 2, len(rows), count, 2, len(rows)))
        setup, by_speed = self._setup, []
        for i, sight in enumerate(self.sights.values()):
            blocks[i, :, :, i] += _own_covariance(sight, rows, setup, self._filter)
            if self._patchy:
                blocks[i, :, :, i] += _of_usual_ground(sight, rows)
            by_speed.append(sight.slopes["speed"][:, rows])
        gnss, at = setup.gnss, self._moments(index).time_s
        apart = at[:, None] - at
        slow = Colour(((1.0, gnss.speed_noise_correlation_s),))
        speed = gnss.speed_noise_mps**2 * self._filter.coloured(apart, slow, gnss.rate_hz)
        speed += gnss.speed_white_noise_mps**2 * self._filter.white(apart, gnss.rate_hz)
        slope = np.array(by_speed)
        blocks += slope[..., None, None, None] * slope * speed[:, None, None]
        size = 2 * count * len(rows)
        return np.asarray(cholesky(blocks.reshape(size, size), lower=True))

    def _moments(self, index: int) -> Moments:
        return next(iter(self.sights.values())).moments.at(self._rows(index))

    def _nuisances(self) -> Iterable[Changes]:
        """Yield one sigma of what all wheels share: the laboratory's soil, each run's scatter, the tilt at rest."""
        sights = self.sights
        columns = {wheel: soil_columns(sight) for wheel, sight in sights.items()}
        for which in range(len(next(iter(columns.values())))):
            yield {wheel: columns[wheel][which] for wheel in sights}
        for index in range(self._options.runs):
            for key, sigma in RUN_SCATTER.items():
                yield {w: sigma * s.slopes[key] * (s.run == index) for w, s in sights.items()}
        yield {w: _tilted(s) for w, s in sights.items()}

    def whitened(self, changes: Changes) -> FloatArray:
        """Return a change in units of the noise, all runs and wheels in one column."""
        still = np.zeros((2, len(self._counts)))
        change = np.stack([changes.get(wheel, still) for wheel in self.wheels])
        parts = [
            solve_triangular(root, change[:, :, self._rows(index)].ravel(), lower=True)
            for index, root in enumerate(self._roots)
        ]
        return np.concatenate(parts)

    def gram(self, columns: FloatArray) -> FloatArray:
        """Return inner products of whitened columns with what all wheels share projected out."""
        cross = self._known.T @ columns
        return np.asarray(columns.T @ columns - cross.T @ self._inner @ cross)

    @cached_property
    def _signatures(self) -> dict[tuple[str, str], FloatArray]:
        """Whitened signatures of every rival, by key and wheel; empty: at all of them."""
        found = {}
        for key in (key for forms in RIVALS for key in forms):
            changes = {wheel: _plausible(sight, key) for wheel, sight in self.sights.items()}
            found[key, ""] = self.whitened(changes)
            if ALL[key].family in OF_A_WHEEL:
                found |= {(key, w): self.whitened({w: change}) for w, change in changes.items()}
        return {at: column / max(float(np.linalg.norm(column)), 1e-12) for at, column in found.items()}

    def told(self, key: str, size: float, wheel: str) -> Told:
        """Return d and d_sep of an error at one wheel."""
        own = self.whitened({wheel: self.sights[wheel].change([(key, size)])})
        at = {which: i for i, which in enumerate(self._signatures, 1)}
        gram = self.gram(np.stack([own, *self._signatures.values()], axis=1))
        least, rival = gram[0, 0], ""
        for forms, where in self._rivals(ALL[key].family, wheel):
            left = gram[0, 0] - explained(gram, [at[form, where] for form in forms], forms)
            if left < least:
                least, rival = left, ALL[forms[0]].family + (f"@{where}" if where else "")
        d, d_sep = np.sqrt(np.maximum([gram[0, 0], least], 0.0)).tolist()
        return Told(d, d_sep, rival)

    def _rivals(self, family: str, wheel: str) -> Iterable[tuple[Sequence[str], str]]:
        for forms in RIVALS:
            for where in ("", *self.wheels):
                if (forms[0], where) in self._signatures and (ALL[forms[0]].family, where) != (family, wheel):
                    yield forms, where


def _ground(options: SimulationOptions) -> Ground:
    soil = true_soil(options)
    return Ground(
        soil.name,
        soil.cohesion_pa,
        float(np.tan(soil.friction_angle_rad)),
        soil.shear_modulus_m,
        soil.sinkage_exponent,
        soil.cohesive_modulus,
        soil.frictional_modulus,
    )


def _moments(run: VirtualRun, vehicle: Vehicle) -> Moments:
    truth, conditions = run.truth, run.truth.conditions
    ones = np.ones(len(truth.time_s))
    return Moments(
        time_s=truth.time_s,
        speed=truth.ground_speed_mps,
        omega=truth.wheel_speed_radps,
        acceleration=truth.ground_acceleration_mps2,
        alpha=truth.wheel_acceleration_radps2,
        load=truth.vertical_load_n,
        distance_m=np.abs(truth.track_position_m - truth.track_position_m[0]),
        line=conditions.line_position * ones,
        clock=conditions.campaign_time * ones,
        direction=conditions.direction * ones,
        passes=conditions.pass_number * ones,
        inflation=conditions.inflation_kpa * ones,
        later=lambda dt: np.interp(truth.time_s + dt, truth.time_s, truth.ground_speed_mps),
        vehicle=vehicle,
    )


def _own_covariance(sight: Sight, rows: np.ndarray, setup: VirtualSetup, filtered: Filtered) -> FloatArray:
    """Return what the transducer and the standstills of one wheel add, shape (2, k, 2, k)."""
    m, transducer = sight.moments.at(rows), setup.transducer
    apart = m.time_s[:, None] - m.time_s
    force = filtered.coloured(apart, Colour(((1.0, transducer.noise_correlation_s),)), transducer.rate_hz)
    white = filtered.white(apart, transducer.rate_hz)
    by_load = sight.slopes["load"][:, rows]
    second = m.time_s > 0.5 * (m.time_s[0] + m.time_s[-1])
    same_rest = (second[:, None] == second) * np.outer(sight.rests[rows], sight.rests[rows])
    kept = _UNKNOWN * same_rest * (setup.stance.brakes == "held")
    blocks = np.zeros((2, len(rows), 2, len(rows)))
    of_pull, of_torque = (transducer.white_noise_n**2 * white, transducer.white_noise_nm**2 * white)
    blocks[0, :, 0] = transducer.drawbar_pull_noise_n**2 * force + of_pull + kept
    blocks[1, :, 1] = transducer.torque_noise_nm**2 * force + of_torque + m.vehicle.radius_m**2 * kept
    load = transducer.load_noise_n**2 * force + of_pull
    blocks += by_load[:, :, None, None] * by_load * load[:, None]
    offset = float(np.hypot(*transducer.zero_offset_n))
    angle = np.interp(m.time_s, *_rolled(sight, rows))
    turning = offset * filtered.ripple(m.omega) * np.exp(1j * angle)
    ripple = np.stack([turning, 0 * turning]) + 1j * by_load * turning
    blocks += 0.5 * np.real(ripple[:, :, None, None] * np.conj(ripple))
    return blocks + 1e-3 * np.eye(2 * len(rows)).reshape(blocks.shape)


def _of_usual_ground(sight: Sight, rows: np.ndarray) -> FloatArray:
    """Return what varies along a usual track and between usual runs of one wheel, shape (2, k, 2, k)."""
    m, suite = sight.moments.at(rows), Suite()
    patch = np.exp(-np.abs(m.distance_m[:, None] - m.distance_m) / PATCH_M)
    second = m.time_s > 0.5 * (m.time_s[0] + m.time_s[-1])
    same_rest = (second[:, None] == second) * np.outer(sight.rests[rows], sight.rests[rows])
    blocks = np.zeros((2, len(rows), 2, len(rows)))
    blocks[0, :, 0] = suite.zero_pull_n**2 + suite.rest_pull_n**2 * same_rest
    blocks[1, :, 1] = suite.zero_torque_nm**2 + suite.rest_torque_nm**2 * same_rest
    whole = np.ones_like(patch)
    varied = (("stiffness", PATCH**2 * patch), ("friction", (PATCH / 2) ** 2 * patch))
    for key, inner in (*varied, ("load", suite.zero_load_n**2 * whole)):
        slope = sight.slopes[key][:, rows]
        blocks += slope[:, :, None, None] * slope * inner[:, None]
    return blocks


def _rolled(sight: Sight, rows: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Return times and the angle by which the wheel has turned, of the run that rows are of."""
    run = sight.moments.at(np.flatnonzero(sight.run == sight.run[rows[0]]))
    steps = np.diff(run.time_s, prepend=run.time_s[0])
    return run.time_s, np.cumsum(run.omega * steps)


def _tilted(sight: Sight) -> FloatArray:
    """Return the pull at rest on ground that rises by one sigma."""
    m = sight.moments
    pull = TILT_RAD / np.sqrt(3) * m.direction * m.load * sight.rests
    return np.stack([pull, 0 * pull])


def _plausible(sight: Sight, key: str) -> FloatArray:
    size, _ = ALL[key].plausible(sight.moments.vehicle.radius_m)
    while not np.isfinite(change := sight.change([(key, size)])).all():
        size *= 0.5
    return change
