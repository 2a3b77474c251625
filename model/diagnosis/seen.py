"""What was looked at, for figures: measured, simulated without and with the causes, what each candidate changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.final import SetFit
from model.diagnosis.grams import Grams
from model.diagnosis.linearise import simulated
from model.diagnosis.look import Look
from model.diagnosis.noise import constants, loading, processes, white_variance
from model.diagnosis.result import Seen
from model.diagnosis.view import View

FloatArray = NDArray[np.float64]
Sizes = Mapping[str, FloatArray]
"""Coefficients of each effect, in units of the prior scale, by its key."""


def seen_of(look: Look, base: SetFit, extended: SetFit, shown: Sizes, alone: Mapping[str, SetFit]) -> tuple[Seen, ...]:
    """Return what was looked at in each campaign.

    Parameters
    ----------
    look : Look
    base : SetFit
        The soil alone.
    extended : SetFit
        With the causes.
    shown : mapping effect key -> coefficients
        Candidates whose signatures are drawn.
    alone : mapping effect key -> SetFit
        Those of them that were fitted each by itself: what they change is then what the whole model says, with the
        soil fitted anew, and not what the linearised one does.
    """
    return tuple(_seen(look, index, base, extended, shown, alone) for index in range(len(look.views)))


def _seen(look: Look, index: int, base: SetFit, extended: SetFit, shown: Sizes, alone: Mapping[str, SetFit]) -> Seen:
    view = look.views[index]
    samples, at = view.samples, view.samples.conditions
    channels = view.linear.channels
    without = _said(base, index)
    fitted = {key: _said(fit, index) for key, fit in alone.items() if key in shown}
    changes = {key: {c: x - without[c] for c, x in said.items()} for key, said in fitted.items()}
    return Seen(
        campaign=view.campaign.name,
        runs=samples.run_names,
        run=samples.run,
        time_s=samples.time_s,
        slip=np.asarray(at.slip),
        ground_speed_mps=np.asarray(at.ground_speed_mps),
        vertical_load_n=np.asarray(at.vertical_load_n),
        line_position=np.asarray(at.line_position),
        measured={c: samples.measured[c] for c in channels},
        base=without,
        extended=_said(extended, index),
        base_sigma=dict(zip(channels, spread(view), strict=True)),
        signatures={
            key: changes.get(key) or dict(zip(channels, _signature(look, index, key, size), strict=True))
            for key, size in shown.items()
        },
    )


def _said(fit: SetFit, index: int) -> dict[str, FloatArray]:
    """Return what a fitted model says at the measured slip."""
    part, point = fit.problem.parts[index], fit.problem.points(fit.estimate)[index]
    samples = part.view.samples
    said = simulated(part.simulation, samples, replace(point, speed_mps=np.zeros(len(samples))))
    return dict(zip(part.frozen.channels, said, strict=True))


def spread(view: View) -> FloatArray:
    """Return the one-sigma of measured less simulated by the noise model, shape (c, n)."""
    values, linear, samples = view.noise.values, view.linear, view.samples
    variance = white_variance(linear, values, view.speed_variance)
    for process in processes(linear.channels):
        variance = variance + (values[process.deviation] * loading(linear, samples, process.loading)) ** 2
    for deviation, how in constants(linear.channels):
        variance = variance + (values[deviation] * loading(linear, samples, how)) ** 2
    return np.asarray(np.sqrt(variance))


def _signature(look: Look, index: int, key: str, size: FloatArray) -> FloatArray:
    """Return what a cause changes in a campaign, less what the re-calibrated soil can imitate, shape (c, n)."""
    grams: Grams = look.grams
    view = look.views[index]
    own = list(grams.columns_of(key))
    total = grams.total()
    soil = grams.soil_columns
    imitated = np.linalg.solve(np.eye(len(grams.soil)) + total[soil, soil], total[soil, own] @ size)
    first = sum(len(v.columns.soil) for v in look.views[:index])
    mine = imitated[first : first + len(view.columns.soil)]
    changed = np.zeros(view.linear.value.shape)
    units = {(grams.causes[c - grams.cause_columns.start].parameter): (c, s) for c, s in zip(own, size, strict=True)}
    for i, cause in enumerate(view.columns.causes):
        if cause.key == key:
            column, coefficient = units[cause.parameter]
            scale = grams.causes[column - grams.cause_columns.start].scale
            changed += view.linear.causes[..., i] * scale * coefficient
    return np.asarray(changed - view.linear.soil @ mine)
