"""Static sinkage of a wheel: the closed form (Eq. 10) and the vertical balance (Eq. 7), with the forces there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from daq import FloatArray, IndexArray
from model import compiled
from model.core_library import library
from model.effects.base import Effect, Values
from model.wheel_soil import Conditions, SoilState, speed_ratio
from model.wheel_soil.contact import Patch, Quadrature, Resultants, entry_angle, resultants, rules_of
from model.wheel_soil.dual import Dual, Number, rows, value_of, where
from model.wheel_soil.pressure_sinkage import closed_form

Active = tuple[tuple[Effect, Values], ...]
"""Effects that are not neutral, each with its own parameters."""
_BY_SINKAGE = "Z"
"""Name of the derivatives by the sinkage, until the balance replaces them."""

LoadOf = Callable[[Any, Any], Any]
"""Eq. 7 of a sinkage (m, 1) for the samples `index`: W in N, (m, 1)."""

_TOLERANCE = 1e-7
_FIRST = 0.1
"""Of the radius: where the search starts if Eq. 10 has no answer, as for n of 3 and above."""
_DEEPEST = 0.999
"""Of the radius: a wheel sunk to its axle is beyond the model."""


@dataclass(frozen=True)
class Contact:
    """A wheel on soil whose sinkage is not known yet; per-sample entries are columns (n, 1)."""

    soil: SoilState
    radius: Number
    width: Number
    conditions: Conditions
    effects: Active
    quadrature: Quadrature

    def resultants(self, sinkage: Number) -> Resultants:
        """Return Eq. 7-9 at a sinkage."""
        patch = self._own_patch(sinkage)
        for effect, values in self.effects:
            patch = effect.patch(patch, self.conditions, values)
        return resultants(patch, self.quadrature)

    def closed_patch(self, sinkage: FloatArray) -> list[Any] | None:
        """Return the entries of the patch if nothing in it but the entry angle depends on the sinkage, else None."""
        if any(type(effect).patch is not Effect.patch and effect.is_active(values) for effect, values in self.effects):
            return None
        patch = self._own_patch(sinkage)
        entries = [getattr(patch, name) for name in Patch.__dataclass_fields__]
        return None if any(np.iscomplexobj(x) for x in entries) else entries

    def map(self, function: Any) -> Contact:
        """Return the contact with `function` applied to every number."""
        return Contact(
            self.soil.map(function),
            function(self.radius),
            function(self.width),
            self.conditions.map(function),
            tuple((e, {name: function(x) for name, x in values.items()}) for e, values in self.effects),
            self.quadrature,
        )

    def numbers(self) -> list[Number]:
        """Return every number that decides the contact."""
        found: list[Number] = []
        self.map(found.append)
        return found

    def _own_patch(self, sinkage: Number) -> Patch:
        """Return the patch that no effect has changed."""
        soil = self.soil
        return Patch(
            entry_angle=entry_angle(sinkage, self.radius),
            speed_ratio=speed_ratio(self.conditions.slip),
            radius=self.radius,
            width=self.width,
            cohesion=soil.cohesion,
            tan_phi=soil.tan_phi * soil.interface,
            shear_modulus=soil.shear_modulus,
            stiffness=soil.stiffness(self.width),
            exponent=soil.exponent,
        )


class Solution(NamedTuple):
    """Where the wheel settles; columns (n, 1), SI."""

    static_sinkage: Number
    sinkage: Number
    entry_angle: Number
    vertical_load: Number
    drawbar_pull: Number
    driving_torque: Number
    stress_scale: Number


def solve(contact: Contact, given: Number | None, static: Number | None, *, balanced: bool) -> Solution:
    """Find the sinkage and the forces; numbers are columns (n, 1).

    `given` is the total sinkage, where it is not the model's to find, and `static` the static one, where it is known
    already. Where `balanced`, Eq. 7 holds: Z0 from it, and the normal stress scaled where an effect moves the sinkage.
    Otherwise Z0 is the closed form of Eq. 10.
    """
    forces: Resultants | None = None
    if given is not None:
        static = total = given
    else:
        if static is None:
            static, forces = _balanced(contact) if balanced else (_closed(contact), None)
        total = static
        for effect, values in contact.effects:
            total = effect.sinkage(total, contact.conditions, values)
    if forces is None or total is not static:
        forces = contact.resultants(total)
    scale: Number = 1.0
    if balanced and (given is not None or any(e.moves_sinkage() for e, _ in contact.effects)):
        scale = (contact.conditions.vertical_load_n - forces.load_cohesion) / forces.load_stress
        scale = where(value_of(scale) > 0.0, scale, np.nan)
    return Solution(
        static,
        total,
        entry_angle(total, contact.radius),
        forces.load(scale),
        forces.pull(scale),
        forces.torque(scale),
        scale,
    )


def _closed(contact: Contact) -> Number:
    soil = contact.soil
    return closed_form(
        contact.conditions.vertical_load_n,
        contact.radius,
        contact.width,
        soil.stiffness(contact.width),
        soil.exponent,
    )


def _balanced(contact: Contact) -> tuple[Number, Resultants | None]:
    """Solve Eq. 7 for the sinkage; with derivatives where there are any.

    These take Eq. 7-9 at the solution, which are returned, too; without derivatives nothing has computed them there.
    """
    load = contact.conditions.vertical_load_n
    plain = contact.map(value_of)
    n = len(value_of(load))

    def load_of(z: FloatArray, index: IndexArray) -> FloatArray:
        part = plain if len(index) == n else plain.map(lambda x: rows(x, n, index))
        return np.asarray(part.resultants(z).load())

    def full(x: Number) -> FloatArray:
        return np.broadcast_to(np.asarray(value_of(x), float), (n, 1))

    start = full(_closed(plain))
    if (core := library()) and (entries := plain.closed_patch(start)):
        limits = (_TOLERANCE, _FIRST, _DEEPEST)
        solved = compiled.balance(core, entries, rules_of(contact.quadrature), full(load), start, limits)
    else:
        solved = balanced(full(load), start, full(plain.radius), full(plain.soil.exponent), load_of)
    numbers = contact.numbers()
    if any(np.iscomplexobj(x) for x in numbers):
        slope = plain.resultants(Dual(solved, {_BY_SINKAGE: 1.0})).load().partials[_BY_SINKAGE]
        return differentiate(solved, load, contact.resultants(solved).load(), slope), None
    if not any(isinstance(x, Dual) for x in numbers):
        return solved, None
    forces = contact.resultants(Dual(solved, {_BY_SINKAGE: 1.0}))
    carried = forces.load()
    slope = carried.partials.pop(_BY_SINKAGE)
    sinkage = differentiate(solved, load, carried, slope)
    parts = (getattr(forces, name) for name in Resultants.__dataclass_fields__)
    return sinkage, Resultants(*(_at_balance(part, sinkage) for part in parts))


def _at_balance(x: Dual, sinkage: Dual) -> Dual:
    """Replace the derivative by the sinkage by those of the solved sinkage."""
    partials = dict(x.partials)
    slope = partials.pop(_BY_SINKAGE)
    for name, d in sinkage.partials.items():
        partials[name] = partials.get(name, 0.0) + slope * d
    return Dual(x.value, partials)


def balanced(
    load: FloatArray, start: FloatArray, radius: FloatArray, exponent: FloatArray, load_of: LoadOf
) -> FloatArray:
    """Solve Eq. 7 for the sinkage in m that carries the load in N, shape (n, 1); NaN where none up to the axle does.

    A secant method on ln W against ln Z, which is nearly a straight line of slope n + 1/2, kept inside a bracket. The
    start is a first guess of Z0 in m (any number where there is none); ``load_of(sinkage, index)`` is Eq. 7 for the
    samples `index`. The last step is taken when ln W is within 1e-7 and is superlinear, so that the result is good to
    about 1e-12.
    """
    n = len(load)
    target = np.log(load)
    low, high = np.full((n, 1), -np.inf), np.log(_DEEPEST * radius)
    y = np.minimum(np.log(np.where(np.isfinite(start) & (start > 0.0), start, _FIRST * radius)), high - 1e-3)
    slope = exponent + 0.5
    old_y, old_miss = np.full((n, 1), np.nan), np.full((n, 1), np.nan)
    result = np.full((n, 1), np.nan)
    todo = np.arange(n)
    for _ in range(60):
        miss = np.log(np.maximum(load_of(np.exp(y), todo), 1e-300)) - target[todo]
        low[todo] = np.where(miss < 0, y, low[todo])
        high[todo] = np.where(miss > 0, y, high[todo])
        new = (miss - old_miss[todo]) / (y - old_y[todo])
        slope = np.where(np.isfinite(new) & (new > 1e-3), new, slope)
        step = y - np.clip(miss / slope, -2.0, 2.0)
        outside = (step <= low[todo]) | (step >= high[todo])
        middle = 0.5 * (np.where(np.isfinite(low[todo]), low[todo], high[todo] - 2.0) + high[todo])
        step = np.where(outside & (np.abs(miss) > _TOLERANCE), middle, step)
        done = ((np.abs(miss) < _TOLERANCE) | (high[todo] - low[todo] < 1e-13))[:, 0]
        reached = done & (np.abs(miss) < 1e-3)[:, 0]
        result[todo[reached]] = np.exp(step[reached])
        old_y[todo], old_miss[todo] = y, miss
        keep = ~done
        todo, y, slope = todo[keep], step[keep], slope[keep]
        if not len(todo):
            break
    return result


def differentiate(sinkage: FloatArray, load: Number, carried: Number, slope: FloatArray) -> Number:
    """Give a solved sinkage its derivatives: one Newton step of Eq. 7 in the arithmetic of `carried`.

    The sinkage is the solution without derivatives. `carried` is Eq. 7 at it, with derivatives by whatever is wanted,
    as `load` (W); `slope` is dW/dZ of Eq. 7, N/m.
    """
    miss = carried - load
    # the value is solved already: only the derivative part of the step is wanted
    return sinkage - (miss - value_of(miss)) / slope
