"""Forward-mode derivatives: a formula written once in numpy gives its analytic sensitivities.

A `Dual` carries a value and its partial derivatives; the chain rule of each ufunc is in `_RULES`. The same
formula takes plain floats (fast), complex numbers (the complex-step check) and duals, so that no derivative is
written by hand twice and an effect's author writes none at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

Number = Any
"""A float or array, real or complex, or a `Dual`."""

Factor = Callable[[], Any]
_ONE = 1.0
"""By which nothing is multiplied: partial derivatives are shared, and never changed in place."""
_COMPARISONS = {np.less, np.greater, np.less_equal, np.greater_equal, np.equal, np.not_equal, np.isfinite, np.isnan}
_RULES: dict[np.ufunc, Callable[..., tuple[Factor, ...]]] = {
    np.add: lambda y, a, b: (lambda: _ONE, lambda: _ONE),
    np.subtract: lambda y, a, b: (lambda: _ONE, lambda: -1.0),
    np.multiply: lambda y, a, b: (lambda: b, lambda: a),
    np.true_divide: lambda y, a, b: (lambda: 1.0 / b, lambda: -y / b),
    np.power: lambda y, a, b: (lambda: b * np.power(a, b - 1.0), lambda: y * np.log(a)),
    np.negative: lambda y, a: (lambda: -1.0,),
    np.sin: lambda y, a: (lambda: np.cos(a),),
    np.cos: lambda y, a: (lambda: -np.sin(a),),
    np.tan: lambda y, a: (lambda: 1.0 + y * y,),
    np.arctan: lambda y, a: (lambda: 1.0 / (1.0 + a * a),),
    np.arccos: lambda y, a: (lambda: -1.0 / np.sqrt(1.0 - a * a),),
    np.arcsin: lambda y, a: (lambda: 1.0 / np.sqrt(1.0 - a * a),),
    np.sqrt: lambda y, a: (lambda: 0.5 / y,),
    np.exp: lambda y, a: (lambda: y,),
    np.expm1: lambda y, a: (lambda: y + 1.0,),
    np.log: lambda y, a: (lambda: 1.0 / a,),
    np.log1p: lambda y, a: (lambda: 1.0 / (1.0 + a),),
    np.square: lambda y, a: (lambda: 2.0 * a,),
}


class Dual(NDArrayOperatorsMixin):
    """A value with its partial derivatives.

    Attributes
    ----------
    value : float array, any shape
    partials : mapping str -> array that broadcasts against `value`
        Derivative by each named parameter; a missing name is zero.
    """

    __slots__ = ("partials", "value")
    __array_priority__ = 1000

    def __init__(self, value: Any, partials: Mapping[str, Any]) -> None:
        self.value = np.asarray(value, float)
        self.partials = dict(partials)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value."""
        return self.value.shape

    def __getitem__(self, key: Any) -> Dual:
        return Dual(self.value[key], {k: np.broadcast_to(d, self.shape)[key] for k, d in self.partials.items()})

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        if method != "__call__" or kwargs:
            return NotImplemented
        values = [x.value if isinstance(x, Dual) else x for x in inputs]
        if ufunc in _COMPARISONS:
            return ufunc(*values)
        rule = _RULES.get(ufunc)
        if rule is None:
            raise TypeError(f"no derivative is known for numpy.{ufunc.__name__}; use one of {_known()}")
        result = ufunc(*values)
        partials: dict[str, Any] = {}
        for x, factor in zip(inputs, rule(result, *values), strict=True):
            if isinstance(x, Dual):
                by = factor()
                for name, d in x.partials.items():
                    term = d if by is _ONE else by * d
                    partials[name] = partials[name] + term if name in partials else term
        return Dual(result, partials)


def _known() -> str:
    return ", ".join(sorted(ufunc.__name__ for ufunc in _RULES))


def value_of(x: Number) -> Any:
    """Return the value without derivatives; of a complex number the real part."""
    if isinstance(x, Dual):
        return x.value
    return np.real(x) if np.iscomplexobj(x) else x


def where(condition: Any, a: Number, b: Number) -> Number:
    """Return ``numpy.where`` for any `Number`."""
    if not (isinstance(a, Dual) or isinstance(b, Dual)):
        return np.where(condition, a, b)
    da, db = (x.partials if isinstance(x, Dual) else {} for x in (a, b))
    partials = {k: np.where(condition, da.get(k, 0.0), db.get(k, 0.0)) for k in {**da, **db}}
    return Dual(np.where(condition, value_of(a), value_of(b)), partials)


def weighted_sum(x: Number, weights: Any) -> Number:
    """Return the sum over the last axis with constant weights, keeping that axis with length 1."""
    column = weights[:, None]
    if not isinstance(x, Dual):
        return x @ column
    return Dual(x.value @ column, {k: np.broadcast_to(d, x.shape) @ column for k, d in x.partials.items()})


def rows(x: Number, n: int, index: Any) -> Number:
    """Return rows `index` of a per-sample quantity of shape (n, 1), or `x` itself where it is one for all."""
    if isinstance(x, Dual):
        value = x.value[index] if x.value.shape[:1] == (n,) else x.value
        partials = {k: d[index] if np.shape(d)[:1] == (n,) else d for k, d in x.partials.items()}
        return Dual(value, partials)
    return x[index] if np.shape(x)[:1] == (n,) else x


def column(x: Number) -> Number:
    """Return a per-sample array (n,) as (n, 1); scalars stay."""
    if isinstance(x, Dual):
        return Dual(column(x.value), {k: column(d) for k, d in x.partials.items()})
    array = np.asarray(x)
    return array[:, None] if array.ndim == 1 else array


def concatenate_rows(parts: list[Number]) -> Number:
    """Join per-sample columns (n_i, 1) of any `Number` kind."""
    if not any(isinstance(p, Dual) for p in parts):
        return np.concatenate([np.asarray(p) for p in parts])
    names = {k: None for p in parts if isinstance(p, Dual) for k in p.partials}
    partials = {
        k: np.concatenate(
            [
                np.broadcast_to(p.partials.get(k, 0.0) if isinstance(p, Dual) else 0.0, np.shape(value_of(p)))
                for p in parts
            ]
        )
        for k in names
    }
    return Dual(np.concatenate([value_of(p) for p in parts]), partials)
