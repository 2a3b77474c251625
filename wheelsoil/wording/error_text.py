"""What a cause that is an error of measurement does, in a sentence with its size: for headlines and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite

from model.diagnosis import Cause
from model.effects import parted
from wheelsoil.wording.numbers import measured, number


def _too(value: float) -> str:
    return "too much" if value > 0 else "too little"


def _percent(value: float) -> str:
    return f"{number(100 * abs(value), 2)} %"


ERRORS: Mapping[str, Callable[[str, str, float], str]] = {
    "drawbar_pull_zero": lambda c, size, x: f"The {c} reads {size} {_too(x)} at every slip",
    "torque_zero": lambda c, size, x: f"The {c} reads {size} {_too(x)} at every slip",
    "zero_drift": lambda c, size, x: (
        f"The zero of the {c} drifts by {size} over the campaign, {'up' if x > 0 else 'down'}wards"
    ),
    "drawbar_pull_gain": lambda c, _, x: f"The {c} reads {_percent(x)} {_too(x)}, in proportion to its size",
    "torque_gain": lambda c, _, x: f"The {c} reads {_percent(x)} {_too(x)}, in proportion to its size",
    "crosstalk": lambda c, _, x: (
        f"{_percent(x)} of the vertical load is {'added to' if x > 0 else 'taken off'} the {c}"
    ),
    "load_zero": lambda _, size, x: f"The vertical load reads {size} {_too(x)}",
    "load_gain": lambda _c, _s, x: f"The vertical load reads {_percent(x)} {_too(x)}",
    "speed_bias": lambda _, size, x: f"The ground speed reads {size} {_too(x)}",
    "speed_latency": lambda _, size, x: (
        f"The ground speed comes {size} {'later' if x > 0 else 'earlier'} than declared"
    ),
    "wheel_radius": lambda _c, _s, x: (
        f"Slip is shifted: the rolling radius is {_percent(x)} {'larger' if x > 0 else 'smaller'} than stated"
    ),
    "wheel_inertia": lambda c, _s, _x: (
        f"The {c} follows the wheel's acceleration: outboard mass and inertia are not declared"
    ),
}
"""What a cause that is an error does, as a sentence of channel, size with 95 % interval, and value."""
_IN_CHANNEL = {
    "drawbar_pull_zero": "drawbar pull",
    "drawbar_pull_gain": "drawbar pull",
    "torque_zero": "driving torque",
    "torque_gain": "driving torque",
    "zero_drift": "drawbar pull",
}


def error_text(cause: Cause, channel: str) -> str:
    """Return what a cause of `ERRORS` does, with its size; `channel` in words, where the cause has none of its own."""
    first = cause.parameters[0]
    low, high = first.interval95
    size = f"{measured(abs(first.value), first.sigma)} {first.unit}".removesuffix(" 1")
    if isfinite(low) and isfinite(high):
        ends = sorted((abs(low), abs(high))) if low * high > 0 else (low, high)
        size = f"{size} ({' to '.join(measured(end, first.sigma) for end in ends)})"
    family, _ = parted(cause.name)
    return ERRORS[family](_IN_CHANNEL.get(family, channel), size, first.value)
