"""What faulty sensors get to see: measurement effects on a virtual run's signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from model.effects.base import Effect
from model.effects.signals import Signals

Faults = Sequence[tuple[type[Effect], Mapping[str, float]]]
"""Measurement effects, each with its own parameters."""


def sensed(faults: Faults, signals: Signals) -> Signals:
    """Return the signals that the sensors sample.

    The exact inverse of what a model with the same effects in the same order does: `Effect.observation` follows one
    after the other and sees the true load, so drawbar pull and torque do here; `Effect.inputs` starts from what was
    measured, so load and speeds go the other way round.
    """
    hub = inputs = signals
    for effect, values in faults:
        seen = effect().sensed(hub, values)
        hub = replace(hub, drawbar_pull_n=seen.drawbar_pull_n, driving_torque_nm=seen.driving_torque_nm)
    for effect, values in reversed(faults):
        inputs = effect().sensed(inputs, values)
    return replace(inputs, drawbar_pull_n=hub.drawbar_pull_n, driving_torque_nm=hub.driving_torque_nm)
