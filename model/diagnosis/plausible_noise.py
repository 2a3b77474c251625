"""The noise model as far as instruments can be that bad: what an explanation is judged by.

Slip is measured, and an error of the ground speed shows in all channels at once. So does much else: a slip that lags
behind, a soil that answers late. A noise model that may choose its speed error and its delays freely explains them
all; one that may choose the soil's scatter freely takes a soft patch for it. Whether an explanation is adequate is
therefore judged with a speed error no larger than the sensor is stated to have, with a margin, or than a usual receiver
has, with delays no longer than what is thought of toothed rings, and with a soil as even as is thought of one terrain.
"""

from __future__ import annotations

from dataclasses import replace
from math import exp

from model.diagnosis.grams import Grams
from model.diagnosis.joint import joined
from model.diagnosis.look import Look
from model.diagnosis.noise import Noise, beliefs
from model.diagnosis.view import View
from model.diagnosis.whitening import run_grams

MARGIN = 1.5
"""Times the stated one-sigma."""
USUAL_MPS = 0.05
"""One-sigma that any receiver may have: data sheets say .03 (0.1 km/h); slow drift comes on top."""
LOG_SIGMAS = 2.0
"""One-sigmas of its logarithm by which a delay, or the soil's scatter in a run, may be larger than thought."""
_SPEED = ("speed_noise_mps", "speed_white_mps")
_OTHERS = ("wheel_speed_delay_s", "wheel_edge_delay_rad", "stiffness_in_run", "friction_in_run")


def plausible_grams(look: Look) -> Grams:
    """Return the Gram matrices under a speed error that the sensor can have; those of the look where it has.

    Parameters
    ----------
    look : Look
    """
    noises = [_plausible(view) for view in look.views]
    if all(noise is view.noise for noise, view in zip(noises, look.views, strict=True)):
        return look.grams
    return joined(
        [
            (
                view.campaign.name,
                view.samples.run_names,
                view.columns,
                run_grams(view.samples, view.linear, view.columns, noise.values, view.speed_variance),
            )
            for noise, view in zip(noises, look.views, strict=True)
        ]
    )


def _plausible(view: View) -> Noise:
    believed = beliefs(view.samples)
    most = {name: max(MARGIN * believed[name].centre, USUAL_MPS) for name in _SPEED}
    for name in _OTHERS:
        most[name] = believed[name].centre * exp(LOG_SIGMAS * believed[name].log_sigma)
    if all(view.noise.values.get(name, 0.0) <= largest for name, largest in most.items()):
        return view.noise
    return replace(view.noise, values={k: min(x, most.get(k, x)) for k, x in view.noise.values.items()})
