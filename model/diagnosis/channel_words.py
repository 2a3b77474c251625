"""Channels as a diagnosis keys them, names them and measures them."""

from __future__ import annotations

NAMES = {"dp": "drawbar pull", "t": "driving torque", "z": "sinkage"}
UNITS = {"dp": "N", "t": "N m", "z": "m"}
BRIEF = {**NAMES, "t": "torque"}
"""In a sentence."""
FIELDS = {"dp": "drawbar_pull", "t": "driving_torque", "z": "sinkage"}
"""In a finding and in JSON."""
FIELD_NAMES = {field: NAMES[key] for key, field in FIELDS.items()}
FIELD_UNITS = {field: UNITS[key] for key, field in FIELDS.items()}
FIELD_KEYS = {field: key for key, field in FIELDS.items()}
