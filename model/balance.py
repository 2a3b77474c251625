"""Where the wheel settles: its sinkage, and the forces that the stresses give there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model import sinkage as sinkages
from model.conditions import Conditions
from model.contact import Patch, Quadrature, Resultants, entry_angle, resultants
from model.dual import Dual, Number, rows, value_of, where
from model.effects.base import Effect, Values
from model.state import SoilState
from model.stresses import speed_ratio

FloatArray = NDArray[np.float64]
Active = tuple[tuple[Effect, Values], ...]
"""Effects that are not neutral, each with its own parameters."""
_BY_SINKAGE = "Z"
"""Name of the derivatives by the sinkage, until the balance replaces them."""


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
        return resultants(self._patch(sinkage), self.quadrature)

    def map(self, function: Any) -> Contact:
        """Return the contact with `function` applied to every number."""
        return Contact(
            SoilState(*(function(getattr(self.soil, name)) for name in SoilState.__dataclass_fields__)),
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

    def _patch(self, sinkage: Number) -> Patch:
        soil = self.soil
        patch = Patch(
            entry_angle=entry_angle(sinkage, self.radius),
            speed_ratio=speed_ratio(self.conditions.slip),
            radius=self.radius,
            width=self.width,
            cohesion=soil.cohesion,
            tan_phi=soil.tan_phi * soil.interface,
            shear_modulus=soil.shear_modulus,
            stiffness=soil.cohesive_modulus / self.width + soil.frictional_modulus,
            exponent=soil.exponent,
        )
        for effect, values in self.effects:
            patch = effect.patch(patch, self.conditions, values)
        return patch


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
    """Find the sinkage and the forces.

    Parameters
    ----------
    contact : Contact
    given : column (n, 1), optional
        The total sinkage, where it is not the model's to find.
    static : column (n, 1), optional
        The static sinkage, where it is known already.
    balanced : bool
        Eq. 7 holds: Z0 from it, and the normal stress scaled where an effect moves the sinkage. Otherwise Z0 is
        the closed form of Eq. 10.
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
    return sinkages.closed_form(
        contact.conditions.vertical_load_n,
        contact.radius,
        contact.width,
        soil.cohesive_modulus,
        soil.frictional_modulus,
        soil.exponent,
    )


def _balanced(contact: Contact) -> tuple[Number, Resultants | None]:
    """Solve Eq. 7 for the sinkage; with derivatives where there are any.

    These take Eq. 7-9 at the solution, which are returned, too; without derivatives nothing has computed them there.
    """
    load = contact.conditions.vertical_load_n
    plain = contact.map(value_of)
    n = len(value_of(load))

    def load_of(z: FloatArray, index: NDArray[np.intp]) -> FloatArray:
        part = plain if len(index) == n else plain.map(lambda x: rows(x, n, index))
        return np.asarray(part.resultants(z).load())

    def full(x: Number) -> FloatArray:
        return np.broadcast_to(np.asarray(value_of(x), float), (n, 1))

    start = _closed(plain)
    solved = sinkages.balanced(full(load), full(start), full(plain.radius), full(plain.soil.exponent), load_of)
    numbers = contact.numbers()
    if any(np.iscomplexobj(x) for x in numbers):
        slope = plain.resultants(Dual(solved, {_BY_SINKAGE: 1.0})).load().partials[_BY_SINKAGE]
        return sinkages.differentiate(solved, load, contact.resultants(solved).load(), slope), None
    if not any(isinstance(x, Dual) for x in numbers):
        return solved, None
    forces = contact.resultants(Dual(solved, {_BY_SINKAGE: 1.0}))
    carried = forces.load()
    slope = carried.partials.pop(_BY_SINKAGE)
    sinkage = sinkages.differentiate(solved, load, carried, slope)
    parts = (getattr(forces, name) for name in Resultants.__dataclass_fields__)
    return sinkage, Resultants(*(_at_balance(part, sinkage) for part in parts))


def _at_balance(x: Dual, sinkage: Dual) -> Dual:
    """Replace the derivative by the sinkage by those of the solved sinkage."""
    partials = dict(x.partials)
    slope = partials.pop(_BY_SINKAGE)
    for name, d in sinkage.partials.items():
        partials[name] = partials.get(name, 0.0) + slope * d
    return Dual(x.value, partials)
