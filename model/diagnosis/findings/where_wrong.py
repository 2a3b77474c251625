"""Residuals of the simulation by channel, slip, load, speed, place, time and direction.

The catch-all's shapes are asked one after the other: the one that stands out most is said, taken out, and the rest
asked again, so that one misfit is not said five times. A size is the regression height of the shape: its coefficient,
the soil re-calibrated and the shapes found before taken out, times the largest value of the shape. It is not the mean
of measured less simulated there. A statistic is that height over its one-sigma by the noise model.
"""

from __future__ import annotations

import numpy as np

from daq import INPUTS, OUTPUTS, FloatArray
from model.diagnosis.core.result import Finding
from model.diagnosis.core.shapes import Shape
from model.diagnosis.findings.adequacy import LeftOver, left_over
from model.diagnosis.time_series.grams import Grams
from model.diagnosis.time_series.start import CampaignData

LEAST = 3.5
"""Size of a statistic from which on a shape is said: one of 140 shapes exceeds it by chance in one of 15 campaigns."""
MOST = 8
_SEEN = 0.05
"""Share of a shape's information that soil and earlier findings must have left."""


def findings(
    grams: Grams,
    views: tuple[CampaignData, ...],
    keys: tuple[str, ...] = (),
    excess: float = 1.0,
    *,
    inputs: bool = False,
) -> list[Finding]:
    """Return where the simulation with a set of causes is off, worst first.

    Parameters
    ----------
    views : tuple of CampaignData
        For the shapes' heights.
    keys : tuple of str
        Causes that the simulation has.
    excess : float
        Factor on the noise's variance.
    inputs : bool
        Ask for errors of ground speed and load, too. What a missing cause leaves looks like many of them: where there
        is a name for it, they are not asked for.
    """
    heights = np.concatenate([view.columns.heights for view in views])
    asked = [i for i, shape in enumerate(grams.basis) if inputs or shape.channel not in INPUTS]
    left = left_over(grams, keys)
    left = LeftOver(left.misfit, left.score[asked], left.information[np.ix_(asked, asked)])
    return found_in(left, tuple(grams.basis[i] for i in asked), heights[asked], excess)


def found_in(left: LeftOver, shapes: tuple[Shape, ...], height: FloatArray, excess: float = 1.0) -> list[Finding]:
    """Return the shapes that stand out, one after the other.

    Parameters
    ----------
    height : array, shape (b,)
        Of each shape with a coefficient of 1, in the unit of its channel or input.
    excess : float
        Factor on the noise's variance.
    """
    score, information = left.score.copy(), left.information.copy()
    whole = np.maximum(np.diag(information), 1e-12)
    found: list[Finding] = []
    for _ in range(min(MOST, len(shapes))):
        own = np.diag(information)
        known = own > _SEEN * whole
        z = np.where(known, score / np.sqrt(np.where(known, own * excess, 1.0)), 0.0)
        worst = int(np.argmax(np.abs(z)))
        if abs(z[worst]) < LEAST:
            break
        shape = shapes[worst]
        size = float(score[worst] / own[worst] * height[worst])
        found.append(Finding({**INPUTS, **OUTPUTS}[shape.channel].role, shape, size, float(z[worst])))
        column = information[:, worst] / own[worst]
        score = score - column * score[worst]
        information = information - np.outer(column, information[worst])
    return sorted(found, key=lambda f: -abs(f.statistic))
