"""The statistical model of the measurement: which processes disturb the channels, and how each is seen.

=================  ========================================================  =============================
process            is                                                        is seen in
=================  ========================================================  =============================
channel noise      coloured, of a short and of a long memory                 its channel
speed error        coloured, and white: slip is measured                     all channels, by d/dV
load error         coloured: the load is measured                            all channels, by d/dW
soil in the run    coloured over the distance, in ln k and ln tan phi        all channels, by d/d ln k ...
soil of the run    one value a run, in ln k, ln tan phi and ln c             the same
wheel order        a zero that turns with the wheel: two amplitudes a run    its channel, by cos, sin
zero of the run    one value a run: taken anew, or drifted between runs      its channel, at rest too
force at rest      one value a run, of all its standstills: for the pull      its channel, at rest only
                   the ground's tilt and what the rut keeps
remainder          white                                                     its channel
=================  ========================================================  =============================

A coloured process has the autocorrelation sigma^2 exp(-|lag|/time).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from daq import OUTPUTS, FloatArray, Note
from model.diagnosis.time_series.linearise import Linear
from model.diagnosis.time_series.samples import Samples
from model.diagnosis.time_series.standstills import AT_REST, READ
from model.notes import DiagnosisCode
from processing import LEVEL_DEG, RUT_SHARE

_KNOWN = 0.05
"""One-sigma of the logarithm of a hyper-parameter that the data do not decide."""


class Loading(NamedTuple):
    """How a process is seen: in one channel, as it is or by `how`; else in every one by that field of `Linear`."""

    channel: str
    how: Literal["", "cos", "sin", "zero", "rest", "speed", "load", "stiffness", "friction", "cohesion"] = ""


@dataclass(frozen=True)
class Process:
    """A coloured process: names of its deviation and time (None: white), whether over distance, what it is seen by.

    An error of the ground speed is seen by its slope, too: by its values a block later and a block before.
    """

    deviation: str
    time: str | None
    over_distance: bool
    loading: Loading

    @property
    def has_slope(self) -> bool:
        """Whether its slope is seen."""
        return self.loading.how == "speed"


@dataclass(frozen=True)
class HyperPrior:
    """Prior of a positive hyper-parameter: log-normal.

    `of_few`: it is estimated from as few values as there are runs or standstills. Its estimate is the posterior root
    mean square, not the mode, which would underestimate what differs between runs.
    """

    centre: float
    log_sigma: float
    of_few: bool = False


@dataclass(frozen=True)
class Noise:
    """Hyper-parameters of one campaign.

    Attributes
    ----------
    values : mapping name -> float
        With their unit at the end of the name.
    log_sigmas : mapping name -> float
        One-sigma of the logarithm of each, data and prior together.
    """

    values: dict[str, float]
    log_sigmas: dict[str, float] = field(default_factory=dict)

    def with_value(self, name: str, value: float) -> Noise:
        """Return it with one more hyper-parameter, or another value of one."""
        return replace(self, values={**self.values, name: value})


@cache
def processes(channels: tuple[str, ...]) -> tuple[Process, ...]:
    """Return the processes that go on within a run."""
    own = [
        Process(named(c, what), f"{OUTPUTS[c].role}_{what}_time_s", over_distance=False, loading=Loading(c))
        for c in channels
        for what in ("noise", *(("slow_noise",) if c != "z" else ()))
    ]
    return (
        *own,
        Process("speed_noise_mps", "speed_noise_time_s", over_distance=False, loading=Loading("", "speed")),
        Process("speed_white_mps", None, over_distance=False, loading=Loading("", "speed")),
        Process("load_noise_n", "load_noise_time_s", over_distance=False, loading=Loading("", "load")),
        Process("stiffness_in_run", "soil_length_m", over_distance=True, loading=Loading("", "stiffness")),
        Process("friction_in_run", "soil_length_m", over_distance=True, loading=Loading("", "friction")),
    )


@cache
def constants(channels: tuple[str, ...]) -> tuple[tuple[str, Loading], ...]:
    """Return deviation and loading of what is one value a run."""
    turning = [
        (named(c, "wheel_order"), seen) for c in channels if c != "z" for seen in (Loading(c, "cos"), Loading(c, "sin"))
    ]
    zeros = [(named(c, "of_run"), Loading(c, "zero")) for c in channels]
    resting = [(named(c, "standing"), Loading(c, "rest")) for c in channels if c in AT_REST]
    return (
        ("stiffness_run_to_run", Loading("", "stiffness")),
        ("friction_run_to_run", Loading("", "friction")),
        ("cohesion_run_to_run", Loading("", "cohesion")),
        *turning,
        *zeros,
        *resting,
    )


def hyper_priors(samples: Samples) -> dict[str, HyperPrior]:
    """Return the prior of every hyper-parameter, from the sensors' declared or estimated sigmas."""
    load = float(np.median(samples.conditions.vertical_load_n)) if len(samples) else 1e4
    typical = {"dp": 4e-3 * load, "t": 4e-3 * load * samples.wheel_radius_m, "z": 2e-3}
    found: dict[str, HyperPrior] = {}
    for c in samples.measured:
        sigma = _positive(samples.sigma[c], typical[c])
        found |= {
            named(c, "noise"): HyperPrior(0.7 * sigma, 0.7),
            f"{OUTPUTS[c].role}_noise_time_s": HyperPrior(0.15, 0.7),
            named(c, "white"): HyperPrior(0.3 * sigma, 0.8),
            named(c, "of_run"): HyperPrior(0.01 * samples.wheel_radius_m, 1.0, of_few=True)
            if c == "z"
            else HyperPrior(0.15 * sigma, 0.8, of_few=True),
        }
        if c != "z":
            found[named(c, "slow_noise")] = HyperPrior(0.2 * sigma, 0.8)
            found[f"{OUTPUTS[c].role}_slow_noise_time_s"] = HyperPrior(1.0, 0.6)
            found[named(c, "wheel_order")] = HyperPrior(0.3 * sigma, 0.8)
            found[named(c, "at_rest")] = HyperPrior(0.2 * sigma, 0.8, of_few=True)
            held = (load * _held_share(samples.runs), _KNOWN) if c == "dp" else (0.2 * sigma, 0.4)
            found[named(c, "standing")] = HyperPrior(*held, of_few=True)
    speed, weight = _positive(samples.speed_sigma_mps, 0.04), _positive(samples.load_sigma_n, 6e-3 * load)
    return found | {
        "speed_noise_mps": HyperPrior(0.9 * speed, 0.5),
        "speed_noise_time_s": HyperPrior(1.0, 0.8),
        "speed_white_mps": HyperPrior(0.3 * speed, 0.7),
        "load_noise_n": HyperPrior(0.7 * weight, 0.5),
        "load_noise_time_s": HyperPrior(0.15, 0.7),
        "stiffness_in_run": HyperPrior(0.02, 0.5),
        "friction_in_run": HyperPrior(0.01, 0.5),
        "soil_length_m": HyperPrior(3.0, 0.7),
        "stiffness_run_to_run": HyperPrior(0.025, 0.6, of_few=True),
        "friction_run_to_run": HyperPrior(0.012, 0.6, of_few=True),
        "cohesion_run_to_run": HyperPrior(0.025, 0.6, of_few=True),
    }


def _held_share(runs: int) -> float:
    """Return the pull that soil may hold at a released wheel at rest, as a share of the load, for a value a run.

    The tilt is that of all runs: as one value a run it is larger, so that their mean is as uncertain as it is.
    """
    return float(np.hypot(np.sqrt(runs) * np.sin(np.radians(LEVEL_DEG)), RUT_SHARE))


def named(channel: str, what: str) -> str:
    """Return the name of a hyper-parameter of one channel."""
    return f"{OUTPUTS[channel].role}_{what}_{OUTPUTS[channel].suffix}"


def _positive(sigma: float, otherwise: float) -> float:
    return sigma if np.isfinite(sigma) and sigma > 0 else otherwise


def loading(linear: Linear, samples: Samples, seen: Loading) -> FloatArray:
    """Return how a process of the given loading is seen, shape (c, n)."""
    if not seen.channel:
        return np.asarray(getattr(linear, seen.how))
    out, angle = np.zeros(linear.value.shape), samples.wheel_angle_rad
    shown = {"rest": np.zeros(len(angle)), "cos": np.cos(angle), "sin": np.sin(angle)}
    out[linear.channels.index(seen.channel)] = shown.get(seen.how, np.ones(len(angle)))
    return out


def slope_loading(linear: Linear, samples: Samples) -> FloatArray:
    """Return how the ground speed's error of a block later is seen, shape (c, n); that of a block before: minus it."""
    return np.asarray(linear.acceleration / (2.0 * samples.block_s))


def white_variance(linear: Linear, values: Mapping[str, float], speed_variance: FloatArray) -> FloatArray:
    """Return the variance of the white remainder of each sample, shape (c, n): the channel's own, and the known one."""
    own = np.array([values[named(c, "white")] ** 2 for c in linear.channels])
    return np.asarray(own[:, None] + known_variance(linear, speed_variance))


def variance(linear: Linear, samples: Samples, values: Mapping[str, float], speed_variance: FloatArray) -> FloatArray:
    """Return the variance of measured - predicted by the noise model, shape (c, n)."""
    found = white_variance(linear, values, speed_variance)
    listed = [(p.deviation, p.loading) for p in processes(linear.channels)]
    for deviation, how in (*listed, *constants(linear.channels)):
        found = found + (values[deviation] * loading(linear, samples, how)) ** 2
    for p in (p for p in processes(linear.channels) if p.has_slope):
        kept = np.exp(-2.0 * samples.block_s / values[p.time]) if p.time else 0.0
        found = found + 2.0 * (1.0 - kept) * (values[p.deviation] * slope_loading(linear, samples)) ** 2
    return found


def known_variance(linear: Linear, speed_variance: FloatArray) -> FloatArray:
    """Return what errors of the speed add to the white remainder where a channel bends in it, (f'' P)^2 / 2; (c, n)."""
    return np.asarray(0.5 * (linear.curvature * speed_variance) ** 2)


def rest_variance(linear: Linear, samples: Samples, values: Mapping[str, float]) -> FloatArray:
    """Return the variance of each standstill's level, shape (3, m), of `READ`.

    The channel's coloured noise averaged over the standstill (a wheel at rest may have less than one that rolls), and
    what differs from one standstill to the next. Of a lifted wheel what its reading leaves uncertain, and by how much
    the zero may be another one when the runs are driven.
    """
    found = np.ones((len(READ), len(samples.rests)))
    found[-1] = np.nan_to_num(samples.rests.lifted_sigma.get("slip", found[-1]) ** 2, nan=1.0)
    for row, c in enumerate(AT_REST):
        if c not in linear.channels:
            continue
        found[row] = values[named(c, "at_rest")] ** 2
        for what in ("noise", "slow_noise"):
            length = np.maximum(samples.rests.duration_s, 0.1) / values[f"{OUTPUTS[c].role}_{what}_time_s"]
            scatter = np.fmin(samples.rests.spread[c], values[named(c, what)]) ** 2
            found[row] += scatter * 2.0 * (length - 1.0 + np.exp(-length)) / length**2
        if c in samples.rests.lifted_sigma:
            known = samples.rests.lifted_sigma[c] ** 2 + ~samples.rests.bracketed * values[named(c, "of_run")] ** 2
            found[row] = np.where(np.isfinite(known), known, found[row])
    return found


_DETERMINED = 0.4
"""One-sigma of a logarithm below which the data determine it, not the prior."""
_NOTABLE_SWING = 0.5
"""Of what turns with the wheel, over the channel's noise."""
_NOTABLE_ZERO = 5.0
"""Of the zeros that differ from run to run, over their prior."""


def noise_notes(
    noise: Noise, priors: Mapping[str, HyperPrior], channels: tuple[str, ...], seen: float
) -> tuple[Note, ...]:
    """Return what the noise of one campaign tells of its sensors.

    See `model.diagnosis.time_series.noise.hyper_priors` for the priors. `seen` is the share of a swing once a turn that
    the blocks of the samples show; see `swing_seen`.
    """
    return tuple(
        note for channel in channels for note in (*_swing(noise, channel, seen), *_zeros(noise, priors, channel))
    )


def swing_seen(samples: Samples, order: float = 1.0) -> FloatArray:
    """Return the share of a swing, so many times a turn of the wheel, that the mean of a block shows, shape (n,).

    1 is all of it; negative where the block is longer than a cycle.
    """
    speed = np.asarray(samples.conditions.wheel_speed_radps)
    return np.asarray(np.sinc(order * speed * samples.block_s / (2.0 * np.pi)))


def _swing(noise: Noise, channel: str, seen: float) -> Iterator[Note]:
    name = named(channel, "wheel_order")
    size, unsure = noise.values.get(name, 0.0) * np.sqrt(2.0), noise.log_sigmas.get(name, np.inf)
    if unsure < _DETERMINED and size > _NOTABLE_SWING * noise.values[named(channel, "noise")]:
        yield Note(DiagnosisCode.WHEEL_ORDER, values={"channel": channel, "size": float(size / seen)})


def _zeros(noise: Noise, priors: Mapping[str, HyperPrior], channel: str) -> Iterator[Note]:
    name = named(channel, "of_run")
    size, usual = noise.values.get(name, 0.0), priors[name].centre
    if size > _NOTABLE_ZERO * usual:
        yield Note(DiagnosisCode.ZEROS_DIFFER, values={"channel": channel, "size": size, "usual": usual})
