"""Channels as a diagnosis keys them, names them and measures them."""

from __future__ import annotations

NAMES = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
UNITS = {"dp": "N", "t": "N m", "z": "m"}
BRIEF = {**NAMES, "t": "torque"}
"""In a sentence."""
FIELDS = {"dp": "drawbar_pull", "t": "driving_torque", "z": "sinkage"}
"""In a finding and in JSON."""
INPUTS = {"v": ("ground_speed", "measured ground speed", "m/s"), "w": ("vertical_load", "measured load", "N")}
"""What the simulation is given, and a finding can be an error of: key, field, name and unit."""
INPUT_FIELDS = frozenset(field for field, _, _ in INPUTS.values())
FINDING_FIELDS = {**FIELDS, **{key: field for key, (field, _, _) in INPUTS.items()}}
FIELD_NAMES = {
    **{field: NAMES[key] for key, field in FIELDS.items()},
    **{field: name for field, name, _ in INPUTS.values()},
}
FIELD_UNITS = {
    **{field: UNITS[key] for key, field in FIELDS.items()},
    **{field: unit for field, _, unit in INPUTS.values()},
}
FIELD_KEYS = {field: key for key, field in FIELDS.items()}
