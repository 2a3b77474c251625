"""What the noise itself says of the sensors, in sentences for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from model.diagnosis.channel_words import NAMES
from model.diagnosis.channel_words import UNITS as SI
from model.diagnosis.noise import Belief, Noise, named

_TOLD = 0.4
"""One-sigma of a logarithm from which on the data told it, not belief."""
_NOTABLE_SWING = 0.5
"""Of what turns with the wheel, over the channel's noise."""
_NOTABLE_ZERO = 5.0
"""Of the zeros that differ from run to run, over what is believed."""


def remarks(noise: Noise, believed: Mapping[str, Belief], channels: tuple[str, ...]) -> tuple[str, ...]:
    """Return the sentences of one campaign.

    Parameters
    ----------
    noise : Noise
    believed : mapping name -> Belief
        See `model.diagnosis.noise.beliefs`.
    channels : tuple of str
    """
    return tuple(said for channel in channels for said in (*_swing(noise, channel), *_zeros(noise, believed, channel)))


def _swing(noise: Noise, channel: str) -> Iterator[str]:
    name = named(channel, "wheel_order")
    size, unsure = noise.values.get(name, 0.0) * np.sqrt(2.0), noise.log_sigmas.get(name, np.inf)
    if unsure < _TOLD and size > _NOTABLE_SWING * noise.values[named(channel, "noise")]:
        why = "a zero that turns with the wheel, or a wheel" if channel == "dp" else "a wheel"
        yield f"{NAMES[channel]} swings by {size:.0f} {SI[channel]} once a turn of the wheel: {why} that is not round"


def _zeros(noise: Noise, believed: Mapping[str, Belief], channel: str) -> Iterator[str]:
    name = named(channel, "of_run")
    size, usual = noise.values.get(name, 0.0), believed[name].centre
    if size > _NOTABLE_ZERO * usual:
        yield (
            f"{NAMES[channel]}: zeros that differ by {size:.2g} {SI[channel]} from run to run are taken for noise, "
            f"where {usual:.1g} are usual; if the standstills read one sign, or more with more load, it is a cause "
            "that was not considered"
        )
