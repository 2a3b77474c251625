"""Material point method for soil in plane strain under a rigid body (wheel, plate, shear box).

Explicit MLS-MPM (Hu et al. 2018) with affine transfer (APIC, Jiang et al. 2015; AFLIP, Fei et al. 2021) and quadratic
B-splines. All forces, masses and loads are
per metre of width.

Soil
    Linear elastic; Mohr-Coulomb in the plane, (s1 - s3)/2 <= c cos phi + sin phi (s1 + s3)/2, which is Drucker-Prager
    with its cone matched to plane strain; no dilation, no hardening. The pressure follows the volume, p = -k ln J, and
    is 0 where the soil is looser than at rest. The deviator is rotated by Jaumann's rate and returned radially. The
    rate of volume is averaged over the points of a cell, which prevents volumetric locking.
Contact
    Each point within half a point spacing of the body gets a normal spring and a tangential spring with memory and
    Coulomb's limit (Cundall and Strack 1979). The body's surface is therefore exact; it is not made of cells.
Body
    Horizontal and angular speed are prescribed. The vertical motion is prescribed, or free under a dead load with a
    damper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, radians, sin, sqrt
from typing import Any

import numpy as np
from numba import njit

from daq import FloatArray

GRAVITY_M_S2 = 9.81
WHEEL, PLATE, BOX = 0, 1, 2
"""Kinds of body."""
MARGIN = 3
"""Cells between the edge of the grid and the soil."""
BINS = 120
"""Bins of the contact angle from -90 to 90 degrees."""
_CFL = 0.6
_CONTACT_STIFFNESS, _CONTACT_DAMPING = 0.2, 0.1
"""In units of m/dt^2 and m/dt of a point."""
_KEPT = 0.98
"""Share of a point's own velocity that the grid does not smooth (AFLIP; 0 is APIC, which is viscous)."""
_LOOSEST = 0.05
"""Largest ln J: soil that is looser than this does not remember by how much."""

_compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True, fastmath=True)


@dataclass(frozen=True)
class Soil:
    """Elastic, perfectly plastic soil; SI, angle in degrees."""

    friction_angle_deg: float = 32.0
    cohesion_pa: float = 100.0
    density_kg_m3: float = 1600.0
    youngs_modulus_pa: float = 1.0e6
    poisson_ratio: float = 0.3

    @property
    def shear_modulus_pa(self) -> float:
        """G."""
        return self.youngs_modulus_pa / (2 * (1 + self.poisson_ratio))

    @property
    def bulk_modulus_pa(self) -> float:
        """Bulk modulus of plane strain, Lame's lambda + G."""
        return self.shear_modulus_pa / (1 - 2 * self.poisson_ratio)

    @property
    def wave_speed_mps(self) -> float:
        """Speed of pressure waves."""
        return sqrt((self.bulk_modulus_pa + self.shear_modulus_pa) / self.density_kg_m3)

    @property
    def earth_pressure_at_rest(self) -> float:
        """Horizontal over vertical stress at rest (Jaky 1944)."""
        return 1 - sin(radians(self.friction_angle_deg))

    def constants(self) -> FloatArray:
        """Return k, G, sin phi and c cos phi for the solver, shape (4,)."""
        phi = radians(self.friction_angle_deg)
        return np.array([self.bulk_modulus_pa, self.shear_modulus_pa, sin(phi), self.cohesion_pa * cos(phi)])


@dataclass
class Body:
    """Rigid body; lengths m, speeds m/s, per metre of width.

    Attributes
    ----------
    kind : WHEEL, PLATE or BOX
    size : shape (4,)
        Wheel: radius. Plate: half its width. Box: left side, right side, bottom, height of the split.
    state : shape (5,)
        x and y (wheel: axle; plate: middle of its base; box: displacement of the upper half and height of its lid),
        horizontal speed, vertical speed (upwards), angular speed (rad/s, positive when rolling towards +x).
    friction : tangent of the angle of friction between body and soil
    load_n_m : vertical load; without it, the vertical speed is prescribed
    damping : of the free vertical motion, as a share of the critical one at `stiffness_n_m2`
    """

    kind: int
    size: FloatArray
    state: FloatArray
    friction: float
    load_n_m: float | None = None
    stiffness_n_m2: float = 1.0e5
    damping: float = 1.0

    def dynamics(self) -> FloatArray:
        """Return friction, load, mass and damper for the solver, shape (4,)."""
        load = self.load_n_m or 0.0
        mass = load / GRAVITY_M_S2
        return np.array([self.friction, load, mass, 2 * self.damping * sqrt(self.stiffness_n_m2 * mass)])


@dataclass
class Record:
    """What the body felt, averaged over short intervals; per metre of width.

    Attributes
    ----------
    rows : shape (n, 6)
        Time (s), forces on the body forwards and upwards (N/m), moment against rolling (N m/m), x and y of the body.
    normal, shear : shape (BINS,)
        Mean stress under the wheel by angle (Pa), shear positive where it pushes the wheel forwards.
    """

    rows: FloatArray
    normal: FloatArray = field(default_factory=lambda: np.zeros(BINS))
    shear: FloatArray = field(default_factory=lambda: np.zeros(BINS))


class Bed:
    """Soil bed of material points, four to a cell, at rest under its weight.

    Parameters
    ----------
    soil : Soil
    cell_m : size of a cell
    length_m, depth_m, room_m : of the soil, and above it
    seed : int, optional
        Scatters the points by up to a tenth of their spacing; without it they are regular.
    """

    def __init__(
        self, soil: Soil, cell_m: float, length_m: float, depth_m: float, room_m: float, seed: int | None = None
    ) -> None:
        self.soil, self.cell_m = soil, cell_m
        self.columns, self.rows = round(length_m / cell_m), round(depth_m / cell_m)
        self.shape = (self.columns + 2 * MARGIN + 1, self.rows + round(room_m / cell_m) + 2 * MARGIN + 1)
        self.dt = _CFL * cell_m / soil.wave_speed_mps
        self.time_s = 0.0
        self._rng = None if seed is None else np.random.default_rng(seed)
        self._grid = np.zeros((*self.shape, 5))
        self._rates = np.zeros((*self.shape, 2))
        self.points = self._fresh(0, self.columns)

    @property
    def left_m(self) -> float:
        """Coordinate of the left end of the soil."""
        return MARGIN * self.cell_m

    @property
    def bottom_m(self) -> float:
        """Height of the soil's base."""
        return MARGIN * self.cell_m

    @property
    def surface_m(self) -> float:
        """Height of the undisturbed surface."""
        return (MARGIN + self.rows) * self.cell_m

    @property
    def right_m(self) -> float:
        """Coordinate of the right end of the soil."""
        return (MARGIN + self.columns) * self.cell_m

    def _fresh(self, first: int, last: int) -> FloatArray:
        """Return undisturbed points of some columns: x, y, vx, vy, C (4), ln J, deviator (2), tangential spring."""
        a = self.cell_m / 2
        x, y = np.meshgrid(a * (np.arange(2 * first, 2 * last) + 0.5), a * (np.arange(2 * self.rows) + 0.5))
        points = np.zeros((x.size, 12))
        points[:, 0], points[:, 1] = self.left_m + x.ravel(), self.bottom_m + y.ravel()
        vertical = self.soil.density_kg_m3 * GRAVITY_M_S2 * (self.surface_m - points[:, 1])
        at_rest = self.soil.earth_pressure_at_rest
        points[:, 8] = -vertical * (1 + at_rest) / 2 / self.soil.bulk_modulus_pa
        points[:, 9] = vertical * (1 - at_rest) / 2
        if self._rng is not None:
            points[:, :2] += 0.1 * a * self._rng.uniform(-1, 1, (len(points), 2))
        return points

    def run(self, body: Body, duration_s: float, *, every_s: float = 5e-3, gravity: float = GRAVITY_M_S2) -> Record:
        """Advance soil and body; the bed's ends follow neither."""
        every = max(1, round(every_s / self.dt))
        count = max(1, round(duration_s / (every * self.dt)))
        rows, bins = np.zeros((count, 6)), np.zeros((BINS, 2))
        for row in rows:
            _advance(
                self.points,
                self._grid,
                self._rates,
                every,
                np.array([self.cell_m, self.dt, self.soil.density_kg_m3, gravity]),
                self.soil.constants(),
                body.kind,
                body.size,
                body.state,
                body.dynamics(),
                row,
                bins,
            )
            self.time_s += every * self.dt
            row[0] = self.time_s
        if body.kind == WHEEL:
            bins /= count * every * body.size[0] * np.pi / BINS
        return Record(rows, bins[:, 0], bins[:, 1])

    def shift(self, body: Body) -> None:
        """Move the bed's ends one cell forwards: drop the points behind, add undisturbed ones in front."""
        self.points[:, 0] -= self.cell_m
        body.state[0] -= self.cell_m
        kept = self.points[self.points[:, 0] > self.left_m]
        self.points = np.concatenate([kept, self._fresh(self.columns - 1, self.columns)])


@_compiled
def _spring(depth, nx, ny, vx, vy, memory, stiffness, damper, friction, dt):  # type: ignore[no-untyped-def]
    """Return the force on a point and its tangential spring; the normal points out of the body."""
    normal = stiffness * depth - damper * (vx * nx + vy * ny)
    if depth <= 0.0 or normal <= 0.0:
        return 0.0, 0.0, 0.0
    tx, ty = -ny, nx
    memory += (vx * tx + vy * ty) * dt
    limit = friction * normal / stiffness
    memory = min(max(memory, -limit), limit)
    shear = -stiffness * memory
    return normal * nx + shear * tx, normal * ny + shear * ty, memory


@_compiled
def _wheel_contact(p, size, state, half, stiffness, damper, friction, dt):  # type: ignore[no-untyped-def]
    """Return force on a point, spring, and the force on the body that counts."""
    dx, dy = p[0] - state[0], p[1] - state[1]
    reach = size[0] + half
    square = dx * dx + dy * dy
    if square >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    distance = sqrt(square)
    vx, vy = p[2] - state[2] - state[4] * dy, p[3] - state[3] + state[4] * dx
    fx, fy, memory = _spring(
        reach - distance, dx / distance, dy / distance, vx, vy, p[11], stiffness, damper, friction, dt
    )
    return fx, fy, memory, -fx, -fy


@_compiled
def _plate_contact(p, size, state, half, stiffness, damper, friction, dt):  # type: ignore[no-untyped-def]
    """Return force on a point, spring, and the force on the body that counts; the sides are smooth."""
    down = p[1] + half - state[1]
    side = size[0] + half - abs(p[0] - state[0])
    if down <= 0.0 or side <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    vx, vy = p[2] - state[2], p[3] - state[3]
    if down <= side:
        fx, fy, memory = _spring(down, 0.0, -1.0, vx, vy, p[11], stiffness, damper, friction, dt)
        return fx, fy, memory, -fx, -fy
    out = 1.0 if p[0] > state[0] else -1.0
    fx, fy, memory = _spring(side, out, 0.0, vx, vy, 0.0, stiffness, damper, 0.0, dt)
    return fx, fy, 0.0, 0.0, 0.0


@_compiled
def _box_contact(p, size, state, half, stiffness, damper, friction, dt):  # type: ignore[no-untyped-def]
    """Return force on a point, spring, and the force on the upper half; walls smooth, lid and base rough.

    Where a half overhangs the other, its ledge carries the points.
    """
    upper = p[1] > size[3]
    shift, speed = (state[0], state[2]) if upper else (0.0, 0.0)
    left, right = size[0] + shift + half - p[0], p[0] + half - size[1] - shift
    ledge = half + abs(p[1] - size[3])
    if ledge < max(left, right):
        fx, fy, memory = _spring(ledge, 0.0, -1.0 if upper else 1.0, p[2], p[3], 0.0, stiffness, damper, 0.0, dt)
        return fx, fy, 0.0, 0.0, 0.0
    wall, _, _ = _spring(left, 1.0, 0.0, p[2] - speed, p[3], 0.0, stiffness, damper, 0.0, dt)
    facing, _, _ = _spring(right, -1.0, 0.0, p[2] - speed, p[3], 0.0, stiffness, damper, 0.0, dt)
    if upper:
        depth, out, vy = p[1] + half - state[1], -1.0, p[3] - state[3]
    else:
        depth, out, vy = size[2] + half - p[1], 1.0, p[3]
    fx, fy, memory = _spring(depth, 0.0, out, p[2] - speed, vy, p[11], stiffness, damper, friction, dt)
    fx += wall + facing
    return fx, fy, memory, -fx if upper else 0.0, -fy if upper else 0.0


@_compiled
def _contact(kind, p, size, state, half, stiffness, damper, friction, dt):  # type: ignore[no-untyped-def]
    """Return force on a point, spring, and the force on the body that counts."""
    if kind == WHEEL:
        return _wheel_contact(p, size, state, half, stiffness, damper, friction, dt)
    if kind == PLATE:
        return _plate_contact(p, size, state, half, stiffness, damper, friction, dt)
    return _box_contact(p, size, state, half, stiffness, damper, friction, dt)


@_compiled
def _weights(at, w):  # type: ignore[no-untyped-def]
    """Fill in the quadratic B-spline's weights, shape (3,), and return the first node."""
    base = int(at - 0.5)
    f = at - base
    w[0] = 0.5 * (1.5 - f) ** 2
    w[1] = 0.75 - (f - 1.0) ** 2
    w[2] = 0.5 * (f - 0.5) ** 2
    return base


@_compiled
def _to_grid(points, grid, sizes, constants, kind, size, state, dynamics, total, bins):  # type: ignore[no-untyped-def]
    """Transfer mass, momentum, stress and contact to the grid; add up what acts on the body."""
    dx, dt, density = sizes[0], sizes[1], sizes[2]
    half = dx / 4
    volume = dx * dx / 4
    m = density * volume
    stiffness, damper = _CONTACT_STIFFNESS * m / (dt * dt), _CONTACT_DAMPING * m / dt
    wx, wy = np.empty(3), np.empty(3)
    grid[:] = 0.0
    for i in range(points.shape[0]):
        p = points[i]
        fx, fy, p[11], bx, by = _contact(kind, p, size, state, half, stiffness, damper, dynamics[0], dt)
        if bx != 0.0 or by != 0.0:
            rx, ry = p[0] - state[0], p[1] - state[1]
            total[0] += bx
            total[1] += by
            if kind == WHEEL:
                distance = sqrt(rx * rx + ry * ry)
                total[2] += (rx * by - ry * bx) * size[0] / distance
                angle = int((np.arctan2(rx, -ry) / np.pi + 0.5) * bins.shape[0])
                if 0 <= angle < bins.shape[0]:
                    bins[angle, 0] -= (bx * rx + by * ry) / distance
                    bins[angle, 1] += (rx * by - ry * bx) / distance
        pressure = max(0.0, -constants[0] * p[8])
        k = -volume * (1.0 + p[8]) * dt * 4.0 / (dx * dx)
        a00, a01 = m * p[4] + k * (p[9] - pressure), m * p[5] + k * p[10]
        a10, a11 = m * p[6] + k * p[10], m * p[7] + k * (-p[9] - pressure)
        px, py = m * p[2] + fx * dt, m * p[3] + fy * dt
        ix, iy = _weights(p[0] / dx, wx), _weights(p[1] / dx, wy)
        for u in range(3):
            ox = (ix + u) * dx - p[0]
            for v in range(3):
                oy = (iy + v) * dx - p[1]
                w = wx[u] * wy[v]
                node = grid[ix + u, iy + v]
                node[0] += w * m
                node[1] += w * (px + a00 * ox + a01 * oy)
                node[2] += w * (py + a10 * ox + a11 * oy)
                node[3] += w * m * (p[2] + p[4] * ox + p[5] * oy)
                node[4] += w * m * (p[3] + p[6] * ox + p[7] * oy)


@_compiled
def _move_grid(grid, sizes):  # type: ignore[no-untyped-def]
    """Turn momentum into velocity with gravity; rough base, smooth ends."""
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            node = grid[i, j]
            if node[0] > 0.0:
                node[3] /= node[0]
                node[4] /= node[0]
                node[1] /= node[0]
                node[2] = node[2] / node[0] - sizes[3] * sizes[1]
                if i <= MARGIN or i >= grid.shape[0] - 1 - MARGIN:
                    node[1] = 0.0
                if j <= MARGIN:
                    node[1] = 0.0
                    node[2] = 0.0
                if j >= grid.shape[1] - 1 - MARGIN:
                    node[2] = min(node[2], 0.0)


@_compiled
def _from_grid(points, grid, rates, sizes):  # type: ignore[no-untyped-def]
    """Transfer velocity and its gradient to the points, move them, add up the rate of volume of each cell."""
    dx, dt = sizes[0], sizes[1]
    wx, wy = np.empty(3), np.empty(3)
    rates[:] = 0.0
    for i in range(points.shape[0]):
        p = points[i]
        ix, iy = _weights(p[0] / dx, wx), _weights(p[1] / dx, wy)
        vx, vy, c00, c01, c10, c11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        old_x, old_y = 0.0, 0.0
        for u in range(3):
            ox = (ix + u) * dx - p[0]
            for v in range(3):
                oy = (iy + v) * dx - p[1]
                node = grid[ix + u, iy + v]
                w = wx[u] * wy[v]
                gx, gy = w * node[1], w * node[2]
                vx += gx
                old_x += w * node[3]
                old_y += w * node[4]
                vy += gy
                c00 += gx * ox
                c01 += gx * oy
                c10 += gy * ox
                c11 += gy * oy
        k = 4.0 / (dx * dx)
        p[0] += dt * vx
        p[1] += dt * vy
        p[2], p[3] = vx + _KEPT * (p[2] - old_x), vy + _KEPT * (p[3] - old_y)
        p[4], p[5], p[6], p[7] = k * c00, k * c01, k * c10, k * c11
        cell = rates[int(p[0] / dx), int(p[1] / dx)]
        cell[0] += p[4] + p[7]
        cell[1] += 1.0


@_compiled
def _update_stress(points, rates, sizes, constants):  # type: ignore[no-untyped-def]
    """Update the stress; the rate of volume is the mean of the cell."""
    dx, dt = sizes[0], sizes[1]
    for i in range(points.shape[0]):
        p = points[i]
        cell = rates[int(p[0] / dx), int(p[1] / dx)]
        p[8] = min(p[8] + dt * cell[0] / cell[1], _LOOSEST)
        turn = (p[6] - p[5]) * dt
        a = p[9] - turn * p[10] + constants[1] * (p[4] - p[7]) * dt
        b = p[10] + turn * p[9] + constants[1] * (p[5] + p[6]) * dt
        strength = constants[2] * -constants[0] * p[8] + constants[3] if p[8] < 0.0 else 0.0
        size = sqrt(a * a + b * b)
        if size > strength:
            a *= strength / size
            b *= strength / size
        p[9], p[10] = a, b


@_compiled
def _move_body(state, dynamics, total, dt):  # type: ignore[no-untyped-def]
    """Move the body: free in the vertical under its load, or as prescribed."""
    if dynamics[2] > 0.0:
        force = total[1] - dynamics[1]
        state[3] = (state[3] + force / dynamics[2] * dt) / (1.0 + dynamics[3] / dynamics[2] * dt)
    state[0] += state[2] * dt
    state[1] += state[3] * dt


@_compiled
def _advance(points, grid, rates, steps, sizes, constants, kind, size, state, dynamics, row, bins):  # type: ignore[no-untyped-def]
    """Advance soil and body by some steps; `row` gets the mean forces and the last position."""
    total = np.zeros(3)
    for _ in range(steps):
        total[:] = 0.0
        _to_grid(points, grid, sizes, constants, kind, size, state, dynamics, total, bins)
        _move_grid(grid, sizes)
        _from_grid(points, grid, rates, sizes)
        _update_stress(points, rates, sizes, constants)
        _move_body(state, dynamics, total, sizes[1])
        row[1:4] += total / steps
    row[4], row[5] = state[0], state[1]
