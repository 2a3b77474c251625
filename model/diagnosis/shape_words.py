"""What a shape of the catch-all is in words that a person can read on their own."""

from __future__ import annotations

import re

_FIXED = {
    "load, driving": "growing with load, driving",
    "load, braking": "growing with load, braking",
    "load squared": "at loads far from the mean",
    "zero, growing with load": "as a zero that grows with the load, at standstill too",
    "all alike, driving": "the same wherever it drives",
    "all alike, braking": "the same wherever it brakes",
    "direction, driving": "with the sign of the direction (out +, back -), driving",
    "direction, braking": "with the sign of the direction (out +, back -), braking",
    "speeding up, driving": "speeding up (slowing down: the other sign), driving",
    "speeding up, braking": "speeding up (slowing down: the other sign), braking",
    "rising slip, driving": "rising slip (falling: the other sign), driving",
    "rising slip, braking": "rising slip (falling: the other sign), braking",
    "large drawbar pull": "growing with the square of the simulated drawbar pull",
    "large torque": "growing with the square of the simulated torque",
    "drawbar pull over the campaign": "as a share of drawbar pull that grows over the campaign",
    "torque over the campaign": "as a share of torque that grows over the campaign",
}
_RANGES = (
    (re.compile(r"^braking, slip - (\S+) to (\S+)$"), r"braking, slip -\1 to -\2"),
    (re.compile(r"^ground speed (\S+) to (\S+)$"), r"ground speed \1 to \2 m/s"),
    (re.compile(r"^as if misread, ground speed (\S+) to (\S+)$"), r"as if misread, at \1 to \2 m/s"),
    (re.compile(r"^place on the line (\S+) to (\S+)$"), r"place on the line \1 to \2 (of -1 to 1)"),
    (re.compile(r"^(drawbar pull|torque) (\S+ to \S+ kN.*)$"), r"simulated \1 \2"),
)


def shape_words(where: str) -> str:
    """Return the place or the growth that a shape stands for.

    Parameters
    ----------
    where : str
        Label of `model.diagnosis.basis` behind its channel.
    """
    for pattern, said in _RANGES:
        where = pattern.sub(said, where)
    return _FIXED.get(where, where)
