"""What can be measured without soil: zeros of a lifted wheel, known forces on it, coasting on hard ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from daq import FloatArray, Note
from model.diagnosis.planning.manoeuvres import with_standstills
from model.diagnosis.time_series.linearise import Simulation, at_rest
from model.diagnosis.time_series.noise import named, rest_variance
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.standstills import AT_REST, NO_LOAD_N, READ, ROLLING_RADIUS_SHARE, Standstills
from model.diagnosis.time_series.start import CampaignData
from model.notes import StepCode
from model.wheel_soil.conditions import Conditions, Reaction
from model.wheel_soil.dual import Dual, Number, column

COASTED_S = 120.0
"""On hard ground: it costs no track and no soil, and a radius asks for the mean of a slow error of the speed."""
_STANDARD_SHARE = 0.005
"""One-sigma of a known pull or torque over its size: a load cell of class 0.5 (ISO 376), a lever of as much."""
_KNOWN = {"dp": (StepCode.KNOWN_PULL, "pull_n"), "t": (StepCode.KNOWN_TORQUE, "torque_nm")}


class Products(Protocol):
    """Returns cross products of the causes, shape (k, k), from the noise of a campaign and a run of it."""

    def __call__(self, data: CampaignData, simulation: Simulation, run: Samples) -> FloatArray:
        """Return them."""


def static_tests(run: Samples, rests: Standstills) -> Iterator[tuple[Note, Products]]:
    """Yield what could be measured, and its cross products.

    No second coasting: it errs as the first does. No zeros of pull and torque that a lifted wheel has shown.

    Known forces are as large as what the run measured. `rests` are those of the campaign, with what was read without
    soil.
    """
    if any(np.isnan(rests.measured[c][rests.lifted & ~rests.tested]).all() for c in AT_REST if c in run.measured):
        yield Note(StepCode.LIFTED_ZERO), lifted_wheel
    for channel, (code, name) in _KNOWN.items():
        size = float(np.nanquantile(np.abs(run.measured.get(channel, [0.0])), 0.95))
        if size > 0.0:
            yield Note(code, values={name: size}), partial(calibrated, channel, size)
    if not np.isfinite(rests.measured.get("slip", np.nan)).any():
        yield Note(StepCode.HARD_GROUND, values={"duration_s": COASTED_S}), hard_ground


def lifted_wheel(data: CampaignData, simulation: Simulation, run: Samples) -> FloatArray:
    """Return cross products of the causes, shape (k, k), when the unloaded channels are read for some seconds.

    `data` is for its noise, `run` one that was driven.
    """
    lifted = _lifted(run)
    rows, variance = _read(data, simulation, lifted)
    by_load = _by_inputs(simulation, lifted.rests.conditions, "vertical_load_n") / data.noise.values["load_noise_n"]
    rows = (rows / np.sqrt(variance)[..., None]).reshape(-1, rows.shape[-1])
    return _products(np.concatenate([rows, by_load]), simulation)


def calibrated(channel: str, size: float, data: CampaignData, simulation: Simulation, run: Samples) -> FloatArray:
    """Return cross products of the causes, shape (k, k), of the lifted wheel, half the time under a known force.

    `size` is that of the pull ("dp") in N, or of the torque ("t") in N m; the rest is as for `lifted_wheel`.
    """
    lifted = _lifted(run)
    nothing = np.zeros(len(lifted.rests))
    applied = {c: nothing + (size if c == channel else 0.0) for c in AT_REST}
    rows, variance = _read(data, simulation, lifted, Reaction(applied["dp"], applied["t"]))
    mean, of_mean = rows.mean(axis=1), variance.mean(axis=1) / (0.5 * len(lifted.rests))
    present = [c for c in AT_REST if c in data.linear.channels]
    of_mean[present.index(channel)] += (_STANDARD_SHARE * size) ** 2  # it errs alike each time
    return 0.5 * lifted_wheel(data, simulation, run) + _products(mean / np.sqrt(of_mean)[:, None], simulation)


def hard_ground(data: CampaignData, simulation: Simulation, run: Samples) -> FloatArray:
    """Return cross products of the causes, shape (k, k), of coasting for `COASTED_S`: there is no slip.

    The run is repeated at the same ground speed; the rest is as for `lifted_wheel`.
    """
    values = data.noise.values
    apart = max(1, round(values["speed_noise_time_s"] / run.block_s))
    thinned = run[np.arange(len(run)) % apart == 0]
    speed = np.asarray(thinned.conditions.ground_speed_mps)
    rolling = replace(
        thinned.conditions,
        wheel_speed_radps=speed / run.wheel_radius_m,
        wheel_acceleration_radps2=np.asarray(thinned.conditions.ground_acceleration_mps2) / run.wheel_radius_m,
        wheel_jerk_radps3=np.asarray(thinned.conditions.ground_jerk_mps3) / run.wheel_radius_m,
        slip=np.zeros(len(speed)),
    )
    sigma = float(np.hypot(values["speed_noise_mps"], values["speed_white_mps"] / np.sqrt(apart)))
    rows = _by_inputs(simulation, rolling, "slip") * (speed / sigma)[:, None]
    longer = np.sqrt(max(COASTED_S / (len(run) * run.block_s), 1.0))
    rows = longer * rows
    common = longer * ROLLING_RADIUS_SHARE * speed / sigma
    across = common @ rows
    scale = _scales(simulation)
    return _products(rows, simulation) - np.outer(across * scale, across * scale) / (1.0 + float(common @ common))


def _lifted(run: Samples) -> Samples:
    standing = with_standstills(run)
    conditions = replace(standing.rests.conditions, vertical_load_n=np.full(len(standing.rests), NO_LOAD_N))
    return replace(standing, rests=replace(standing.rests, conditions=conditions))


def _read(
    data: CampaignData, simulation: Simulation, lifted: Samples, applied: Reaction | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives of what the present channels read by the causes, (c, m, k), and its variance, (c, m)."""
    names = {key for _, _, key in simulation.parameters}
    known = {key: value for key, value in data.linear.point.causes.items() if key in names}
    _, by_cause = at_rest(simulation, lifted, known, applied)
    present = np.array([c in data.linear.channels for c in READ])
    drifted = np.array([[data.noise.values[named(c, "of_run")] ** 2] for c in AT_REST if c in data.linear.channels])
    return by_cause[present], rest_variance(data.linear, lifted, data.noise.values)[present] + len(
        lifted.rests
    ) * drifted


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
