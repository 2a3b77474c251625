"""What can be measured without any soil: zeros with the wheel lifted, slip and its delay on hard ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.conditions import Conditions
from model.diagnosis.linearise import Simulation, at_rest
from model.diagnosis.manoeuvres import with_standstills
from model.diagnosis.noise import rest_variance
from model.diagnosis.rests import AT_REST
from model.diagnosis.samples import Samples
from model.diagnosis.view import View
from model.dual import Dual, Number, column

FloatArray = NDArray[np.float64]

COASTED_S = 120.0
"""On hard ground: it costs no track and no soil, and a radius asks for the mean of a slow error of the speed."""
_ROLLING_RADIUS_SHARE = 0.005
"""By how much a tyre's rolling radius on hard ground may differ from that on soil."""


def lifted_wheel(view: View, simulation: Simulation, run: Samples) -> FloatArray:
    """Return cross products of the causes, shape (k, k), when the unloaded channels are read for some seconds.

    Parameters
    ----------
    view : View
        For its noise.
    simulation : Simulation
    run : Samples
        A run that was driven.
    """
    standing = with_standstills(run)
    conditions = replace(standing.rests.conditions, vertical_load_n=np.full(len(standing.rests), 1e-9))
    lifted = replace(standing, rests=replace(standing.rests, conditions=conditions))
    _, by_cause = at_rest(simulation, lifted, _known(view, simulation))
    variance = rest_variance(view.linear, lifted, view.noise.values)
    present = np.array([c in view.linear.channels for c in AT_REST])
    rows = (by_cause / np.sqrt(variance)[..., None])[present].reshape(-1, by_cause.shape[-1])
    by_load = _by_inputs(simulation, conditions, "vertical_load_n") / view.noise.values["load_noise_n"]
    return _products(np.concatenate([rows, by_load]), simulation)


def hard_ground(view: View, simulation: Simulation, run: Samples) -> FloatArray:
    """Return cross products of the causes, shape (k, k), of coasting for `COASTED_S`: there is no slip.

    Parameters
    ----------
    view, simulation, run
        As for `lifted_wheel`; the run is repeated at the same ground speed.
    """
    values = view.noise.values
    apart = max(1, round(values["speed_noise_time_s"] / run.block_s))
    thinned = run[np.arange(len(run)) % apart == 0]
    speed = np.asarray(thinned.conditions.ground_speed_mps)
    rolling = replace(
        thinned.conditions,
        wheel_speed_radps=speed / run.wheel_radius_m,
        wheel_acceleration_radps2=np.asarray(thinned.conditions.ground_acceleration_mps2) / run.wheel_radius_m,
        slip=np.zeros(len(speed)),
    )
    sigma = float(np.hypot(values["speed_noise_mps"], values["speed_white_mps"] / np.sqrt(apart)))
    rows = _by_inputs(simulation, rolling, "slip") * (speed / sigma)[:, None]
    longer = np.sqrt(max(COASTED_S / (len(run) * run.block_s), 1.0))
    rows = longer * rows
    common = longer * _ROLLING_RADIUS_SHARE * speed / sigma
    across = common @ rows
    scale = _scales(simulation)
    return _products(rows, simulation) - np.outer(across * scale, across * scale) / (1.0 + float(common @ common))


def _by_inputs(simulation: Simulation, conditions: Conditions, name: str) -> FloatArray:
    """Return how a true input changes with every parameter at neutral, shape (n, k)."""
    at = conditions.map(column)
    count = len(np.asarray(conditions.slip))
    found = []
    for effect, i, key in simulation.parameters:
        values: dict[str, Number] = {p.name: p.neutral for p in effect.parameters}
        values[effect.parameters[i].name] = Dual(effect.parameters[i].neutral, {key: 1.0})
        with np.errstate(invalid="ignore", divide="ignore"):
            true = getattr(effect().inputs(at, values), name)
        slope = true.partials.get(key, 0.0) if isinstance(true, Dual) else 0.0
        found.append(np.broadcast_to(slope, (count, 1))[:, 0])
    return np.stack(found, axis=1) if found else np.zeros((count, 0))


def _scales(simulation: Simulation) -> FloatArray:
    return np.array([e.parameters[i].towards(simulation.wheel) for e, i, _ in simulation.parameters])


def _products(rows: FloatArray, simulation: Simulation) -> FloatArray:
    own = rows * _scales(simulation)
    return np.asarray(own.T @ own)


def _known(view: View, simulation: Simulation) -> dict[str, float]:
    names = {key for _, _, key in simulation.parameters}
    return {key: value for key, value in view.linear.point.causes.items() if key in names}
