"""Channels as a diagnosis keys them, names them and measures them."""

from __future__ import annotations

NAMES = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
UNITS = {"dp": "N", "t": "N m", "z": "m"}
BRIEF = {**NAMES, "t": "torque"}
"""In a sentence."""
FIELDS = {"dp": "drawbar_pull", "t": "driving_torque", "z": "sinkage"}
"""In a finding and in JSON."""
INPUT_FIELDS = {"v": "ground_speed", "w": "vertical_load"}
"""What the simulation is given: a finding can be an error of theirs."""
FIELD_NAMES = {
    **{field: NAMES[key] for key, field in FIELDS.items()},
    "ground_speed": "ground speed",
    "vertical_load": "load",
}
FIELD_UNITS = {**{field: UNITS[key] for key, field in FIELDS.items()}, "ground_speed": "m/s", "vertical_load": "N"}
FIELD_KEYS = {field: key for key, field in FIELDS.items()}
