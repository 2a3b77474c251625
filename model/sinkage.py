"""Static sinkage: the closed form (Eq. 10) and the vertical balance (Eq. 7)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.dual import Number, value_of

FloatArray = NDArray[np.float64]
LoadOf = Callable[[Any, Any], Any]
"""Eq. 7 of a sinkage (m, 1) for the samples `index`: W in N, (m, 1)."""

_TOLERANCE = 1e-7
_DEEPEST = 0.999
"""Of the radius: a wheel sunk to its axle is beyond the model."""


def closed_form(load: Number, radius: Number, width: Number, cohesive: Number, frictional: Number, n: Number) -> Number:
    """Return Z0 of Eq. 10 in metres.

    Parameters
    ----------
    load : N, > 0
    radius, width : m
    cohesive, frictional : k_c in N/m^(n+1), k_phi in N/m^(n+2)
    n : sinkage exponent

    Notes
    -----
    Source: Bekker (1969); Yang et al. (2016), Eq. 10. Neglects shear and assumes Z0 much smaller than 2 r.
    """
    ratio = 3.0 * load / (np.sqrt(2.0 * radius) * (cohesive + width * frictional) * (3.0 - n))
    return np.exp(np.log(ratio) * (2.0 / (2.0 * n + 1.0)))


def balanced(
    load: FloatArray, start: FloatArray, radius: FloatArray, exponent: FloatArray, load_of: LoadOf
) -> FloatArray:
    """Solve Eq. 7 for the sinkage that carries the load.

    A secant method on ln W against ln Z, which is nearly a straight line of slope n + 1/2, kept inside a bracket.

    Parameters
    ----------
    load, start, radius, exponent : arrays, shape (n, 1)
        W > 0 in N, a first guess of Z0 in m, r in m, n.
    load_of : callable
        ``load_of(sinkage, index)``: Eq. 7 for the samples `index`.

    Returns
    -------
    array, shape (n, 1)
        Z0 in m; NaN where even a wheel sunk to its axle does not carry the load.

    Notes
    -----
    The last step is taken when ln W is within 1e-7 and is superlinear, so that the result is good to about 1e-12.
    """
    n = len(load)
    target = np.log(load)
    low, high = np.full((n, 1), -np.inf), np.log(_DEEPEST * radius)
    y = np.minimum(np.log(start), high - 1e-3)
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

    Parameters
    ----------
    sinkage : array, shape (n, 1)
        The solution without derivatives.
    load, carried : Number
        W, and Eq. 7 at that sinkage; with derivatives by whatever is wanted.
    slope : array, shape (n, 1)
        dW/dZ of Eq. 7, N/m.
    """
    miss = carried - load
    # the value is solved already: only the derivative part of the step is wanted
    return sinkage - (miss - value_of(miss)) / slope
