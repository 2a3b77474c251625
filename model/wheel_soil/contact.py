r"""Contact-patch quadrature: Eq. 7-9 for many samples at once, exact at the entry-angle singularity.

:math:`\sigma \sim (\theta_1-\theta)^n` is not analytic at the entry. Every panel that ends where the stress vanishes
is mapped by :math:`\delta = \Delta\,u^p` before Gauss-Legendre: the integrand becomes :math:`u^{pn+p-1}` times an
analytic function, whatever n is, so that one set of nodes serves every sample, every exponent (Ding's N(s)) and every
derivative, by n too. When braking, the panel is split where j changes sign, or behind the thin layer in which the
shear stress builds up (docs/decisions/quadrature.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from daq import FloatArray
from model import compiled
from model.core_library import library
from model.wheel_soil import pressure_sinkage, stresses
from model.wheel_soil.dual import Dual, Number, concatenate_rows, rows, value_of, weighted_sum, where

CHUNK = 1024
"""Samples at a time: small enough that a chunk's arrays stay in the cache."""

_Panel = tuple[Number | None, Number, str, bool]
"""Start (None: the entry) and stop in delta, the end at which the stress vanishes, and whether behind the peak."""


@dataclass(frozen=True)
class Quadrature:
    """Nodes per panel and the power of the map at a vanishing stress.

    The defaults keep the error below 1e-6 of the load; ``Quadrature(48, 4)`` below 1e-10
    (``tests/certified/test_contact_certified.py``). A braked patch has thin layers and gets twice the nodes.
    """

    nodes: int = 12
    power: int = 3


@dataclass(frozen=True)
class Patch:
    """What decides the stresses; each entry is a scalar or a column (n, 1), of any `Number` kind.

    Attributes
    ----------
    entry_angle : rad, theta_1
    speed_ratio : V/(r omega)
    tan_phi : 1
    stiffness : Pa/m^n, k of Eq. 2
    exponent : n of Eq. 2
    peak_angle : rad, theta_m; the normal stress peaks there (0: at the bottom, as in the paper)
    exit_angle : rad, theta_2 <= 0 (0 in the paper)
    lug_height : m, h: soil shears at r + h, and torque acts there
    softening : 1, q: the shear stress falls to (1 - q) of Eq. 4 with displacement
    """

    entry_angle: Number
    speed_ratio: Number
    radius: Number
    width: Number
    cohesion: Number
    tan_phi: Number
    shear_modulus: Number
    stiffness: Number
    exponent: Number
    peak_angle: Number = 0.0
    exit_angle: Number = 0.0
    lug_height: Number = 0.0
    softening: Number = 0.0

    def map(self, function: Callable[[Number], Number]) -> Patch:
        """Return the patch with `function` applied to every entry."""
        return Patch(**{name: function(getattr(self, name)) for name in self.__dataclass_fields__})


@dataclass(frozen=True)
class Resultants:
    """Eq. 7-9, split into what scales with the normal stress and what cohesion adds; columns (n, 1), N and N m."""

    load_stress: Number
    load_cohesion: Number
    pull_stress: Number
    pull_cohesion: Number
    torque_stress: Number
    torque_cohesion: Number

    def load(self, scale: Number = 1.0) -> Number:
        """Return W of Eq. 7 in N with the normal stress scaled by `scale`."""
        return self.load_stress * scale + self.load_cohesion

    def pull(self, scale: Number = 1.0) -> Number:
        """Return Dp of Eq. 8 in N with the normal stress scaled by `scale`."""
        return self.pull_stress * scale + self.pull_cohesion

    def torque(self, scale: Number = 1.0) -> Number:
        """Return T of Eq. 9 in N m with the normal stress scaled by `scale`."""
        return self.torque_stress * scale + self.torque_cohesion


@dataclass(frozen=True)
class Rule:
    """Nodes on [0, 1], what is left from them to 1 (exact also at that end), and weights."""

    at: FloatArray
    left: FloatArray
    weights: FloatArray


@lru_cache(maxsize=64)
def rule(nodes: int, power: int, vanishing: str) -> Rule:
    """Return nodes and weights on [0, 1]; `vanishing` names the end where the stress is zero: start, end or none."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    u, w = 0.5 * (x + 1.0), 0.5 * w
    if vanishing == "none":
        return Rule(u, 1.0 - u, w)
    at, weights = u**power, w * power * u ** (power - 1)
    return Rule(at, 1.0 - at, weights) if vanishing == "start" else Rule(1.0 - at, at, weights)


def resultants(patch: Patch, quadrature: Quadrature | None = None) -> Resultants:
    """Integrate the stresses over the contact patch (Eq. 7-9).

    Parameters
    ----------
    patch : Patch
        Entries scalar or of shape (n, 1); ``0 < entry_angle <= pi/2``. NaN gives NaN.

    Returns
    -------
    Resultants
        Columns of shape (n, 1).

    Notes
    -----
    Source: Yang et al. (2016), Eq. 7-9; peak and exit angle after Wong & Reece (1967).
    """
    chosen = quadrature or Quadrature()
    if (core := library()) and (count := _compilable(patch)):
        return _compiled(core, patch, chosen, count)
    own = {name: x for name in patch.__dataclass_fields__ if isinstance(x := getattr(patch, name), Dual)}
    if len({key for x in own.values() for key in x.partials}) <= len(own):
        return _resultants(patch, chosen)
    seeded = replace(patch, **{name: Dual(x.value, {name: 1.0}) for name, x in own.items()})
    found = _resultants(seeded, chosen)
    return Resultants(*(_chained(getattr(found, name), own) for name in Resultants.__dataclass_fields__))


def _compilable(patch: Patch) -> int:
    """Return the number of samples of a patch of columns, real or with derivatives; 0 of any other kind."""
    count = 0
    for name in patch.__dataclass_fields__:
        x = getattr(patch, name)
        if not isinstance(x, Dual) and np.iscomplexobj(x):
            return 0
        shape = np.shape(value_of(x))
        if shape not in ((), (1,), (1, 1)):
            if len(shape) != 2 or shape[1] != 1 or count not in (0, shape[0]):
                return 0
            count = shape[0]
        elif shape == (1, 1):
            count = count or 1
    return count


def _compiled(core: Any, patch: Patch, quadrature: Quadrature, count: int) -> Resultants:
    """Return what `_resultants` does, by the compiled core: derivatives by the entries, then the chain rule."""
    numbers = {name: getattr(patch, name) for name in patch.__dataclass_fields__}
    wanted = sum(1 << i for i, x in enumerate(numbers.values()) if isinstance(x, Dual))
    entries = [value_of(x) for x in numbers.values()]
    values, slopes = compiled.contact(core, entries, count, rules_of(quadrature), wanted)
    if not wanted:
        return Resultants(*(x[:, None] for x in values))
    partials: dict[str, FloatArray] = {}
    for slope, x in zip(slopes, (x for x in numbers.values() if isinstance(x, Dual)), strict=True):
        for key, d in x.partials.items():
            term = slope * np.ravel(d)
            partials[key] = partials[key] + term if key in partials else term
    return Resultants(
        *(Dual(x[:, None], {k: d[i][:, None] for k, d in partials.items()}) for i, x in enumerate(values))
    )


@lru_cache(maxsize=8)
def rules_of(quadrature: Quadrature) -> FloatArray:
    """Return the numbers of the rules as the compiled core takes them."""
    found = []
    for nodes in (quadrature.nodes, 2 * quadrature.nodes):
        for vanishing in ("start", "end", "none"):
            of_panel = rule(nodes, quadrature.power, vanishing)
            found += [of_panel.at, of_panel.left, of_panel.weights]
    return np.concatenate(found)


def _chained(x: Number, inner: dict[str, Dual]) -> Number:
    """Replace derivatives by entries of a patch with those by what the entries depend on."""
    if not isinstance(x, Dual):  # it depends on none of them
        return x
    partials: dict[str, Any] = {}
    for name, slope in x.partials.items():
        for key, d in inner[name].partials.items():
            partials[key] = partials[key] + slope * d if key in partials else slope * d
    return Dual(x.value, partials)


def _resultants(patch: Patch, quadrature: Quadrature) -> Resultants:
    """Integrate the stresses, with the derivatives that the entries of the patch carry."""
    shape = np.broadcast_shapes(*(np.shape(value_of(getattr(patch, name))) for name in patch.__dataclass_fields__))
    n = shape[0] if shape else 1
    braking = np.broadcast_to(np.reshape(value_of(patch.speed_ratio) > 1.0, (-1,)), (n,))
    if n <= CHUNK and (not braking.any() or braking.all()):
        return _integrate(patch, quadrature, bool(braking.any()))
    order = np.concatenate([np.flatnonzero(~braking), np.flatnonzero(braking)])
    edge = n - int(braking.sum())
    starts = [*range(0, edge, CHUNK), *range(edge, n, CHUNK)]
    parts = []
    for start, stop in zip(starts, [*starts[1:], n], strict=True):
        chosen: Any = order[start:stop] if braking.any() else slice(start, stop)
        parts.append(_integrate(patch.map(partial(rows, n=n, index=chosen)), quadrature, start >= edge))
    back = np.argsort(order, kind="stable") if braking.any() else slice(None)
    return Resultants(
        *(concatenate_rows([getattr(p, name) for p in parts])[back] for name in Resultants.__dataclass_fields__)
    )


def _integrate(patch: Patch, quadrature: Quadrature, braking: bool) -> Resultants:
    """Sum the panels of samples that all drive or all brake."""
    total: list[Number] | None = None
    for start, stop, vanishing, rear in _panels(patch, braking):
        nodes = rule(quadrature.nodes * (2 if braking else 1), quadrature.power, vanishing)
        panel = _panel_sums(patch, start, stop, nodes, rear=rear, braking=braking)
        total = panel if total is None else [a + b for a, b in zip(total, panel, strict=True)]
    assert total is not None
    (normal_cos, normal_sin, _), (shear_cos, shear_sin, shear), (cohesive_cos, cohesive_sin, cohesive) = (
        _by_direction(patch.entry_angle, *total[i : i + 3]) for i in (0, 3, 6)
    )
    area = patch.radius * patch.width
    c, t, r = patch.cohesion, patch.tan_phi, patch.radius + patch.lug_height
    return Resultants(
        load_stress=area * (normal_cos + t * shear_sin),
        load_cohesion=area * c * cohesive_sin,
        pull_stress=area * (t * shear_cos - normal_sin),
        pull_cohesion=area * c * cohesive_cos,
        torque_stress=area * r * t * shear,
        torque_cohesion=area * r * c * cohesive,
    )


def _by_direction(entry: Number, plain: Number, drop: Number, advance: Number) -> tuple[Number, Number, Number]:
    """Turn integrals against 1, drop and advance into those against cos theta, sin theta and 1."""
    return np.cos(entry) * plain + drop, np.sin(entry) * plain - advance, plain


def _panels(patch: Patch, braking: bool) -> list[_Panel]:
    """Return the panels of samples that all drive or all brake."""
    to_peak = patch.entry_angle - patch.peak_angle
    to_exit = patch.entry_angle - patch.exit_angle
    has_rear = _present(patch.peak_angle - patch.exit_angle)
    if not braking:
        front: list[_Panel] = [(None, to_peak, "start", False)]
        return [*front, (to_peak, to_exit, "end", True)] if has_rear else front
    cut = _braking_cut(patch, value_of(to_exit))
    in_front = np.minimum(cut, value_of(to_peak))
    panels: list[_Panel] = [
        (None, in_front, "start", False),
        (in_front, to_peak, "start", False),
    ]
    if has_rear:
        behind = np.maximum(cut, value_of(to_peak))
        panels += [(to_peak, behind, "none", True), (behind, to_exit, "end", True)]
    return panels


def _braking_cut(patch: Patch, end: Any) -> Any:
    """Return where to split a braked patch, (n, 1): at j = 0, else behind the layer in which shear builds up.

    j/r = delta - kappa (sin theta_1 - sin theta) is concave in delta, so that Newton from the far end
    descends monotonically onto its one inner zero. The cut is a constant for derivatives: moving it
    does not change the integral.
    """
    theta, kappa = np.asarray(value_of(patch.entry_angle)), np.asarray(value_of(patch.speed_ratio))
    end = np.broadcast_to(end, np.broadcast_shapes(np.shape(end), theta.shape, kappa.shape)).astype(float)
    rise = 1.0 - kappa * np.cos(theta)
    delta = end.copy()
    for _ in range(12):
        value = delta - kappa * 2.0 * np.cos(theta - 0.5 * delta) * np.sin(0.5 * delta)
        slope = 1.0 - kappa * np.cos(theta - delta)
        step = np.where((slope < 0.0) & (value < 0.0), value / np.where(slope < 0.0, slope, -1.0), 0.0)
        delta = delta - step
    crosses = (rise > 0.0) & (delta > 1e-9 * end) & (delta < end)
    layer = 12.0 * value_of(patch.shear_modulus) / (value_of(patch.radius) * np.maximum(-rise, 1e-12))
    return np.where(crosses, delta, np.minimum(layer, 0.5 * end))


def _panel_sums(
    patch: Patch, start: Number | None, stop: Number, rule: Rule, *, rear: bool, braking: bool
) -> list[Number]:
    """Return nine integrals over one panel: sigma, E sigma and E, each against 1, drop and advance."""
    span = stop if start is None else stop - start
    delta = span * rule.at if start is None else start + span * rule.at
    drop, advance = stresses.geometry(patch.entry_angle, delta)
    mirrored = _mirrored(patch, stop, span, rule.left) if rear else None
    depth = patch.radius * (drop if mirrored is None else stresses.geometry(patch.entry_angle, mirrored)[0])
    sigma = pressure_sinkage.normal_stress(patch.stiffness, depth, patch.exponent)
    j = stresses.shear_displacement(delta, advance, patch.radius, patch.speed_ratio)
    if _present(patch.lug_height):
        j = j + patch.lug_height * delta
    e = stresses.mobilisation(j, patch.shear_modulus, signed=braking)
    if _present(patch.softening):
        e = e * stresses.softened(j, patch.softening, signed=braking)
    stress_like = (sigma, e * sigma, e)
    return [span * weighted_sum(x, rule.weights) for y in stress_like for x in (y, y * drop, y * advance)]


def _present(x: Number) -> bool:
    """Whether a refinement is there: not zero, or to be differentiated."""
    return isinstance(x, Dual) or bool(np.any(x != 0.0))


def _mirrored(patch: Patch, stop: Number, span: Number, left: FloatArray) -> Number:
    """Return the angle behind the entry that has the same stress in front of the peak (Wong & Reece).

    It is computed from the exit, where the stress vanishes, so that nothing cancels there however narrow the rear part
    is. One of no width keeps its shape, so that its width can be differentiated by.
    """
    width = patch.peak_angle - patch.exit_angle
    some = value_of(width) != 0.0
    from_exit = patch.entry_angle - patch.exit_angle - stop + span * left
    share = from_exit / where(some, width, 1.0)
    return where(some, share, left) * (patch.entry_angle - patch.peak_angle)


def entry_angle(sinkage: Number, radius: Number) -> Number:
    """Return theta_1 of Eq. 1 in rad, without cancellation for a small sinkage; NaN outside 0..r.

    Parameters
    ----------
    sinkage : m, any shape
    """
    ratio = sinkage / radius
    valid = (value_of(ratio) > 0.0) & (value_of(ratio) <= 1.0)
    half = where(valid, ratio * 0.5, np.nan)
    return 2.0 * np.arcsin(np.sqrt(half))
