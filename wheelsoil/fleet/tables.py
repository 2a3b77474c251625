"""The store's tables and their columns.

SI units; what is not known is null. Every row has ``content``, which leads to its rows of ``campaigns``, and ``wheel``:
the id of one of several wheels, `daq.ALL_WHEELS` of all of them together, an empty text of the only one or of the
vehicle. A row of ``evidence`` is a `model.diagnosis.Information`, its matrix row by row.
"""

from __future__ import annotations

import pyarrow as pa

SAMPLES_HZ = 5.0

_ESTIMATE = {"parameter": "text", "unit": "text", "value": "number", "lower95": "number", "upper95": "number"}
COLUMNS: dict[str, dict[str, str]] = {
    "campaigns": {
        "kind": "text", "state": "text", "fault": "text", "path": "text", "vehicle": "text", "transducer": "text",
        "terrain": "text", "wheel_radius_m": "number", "wheel_width_m": "number", "tread": "text", "start": "time",
        "runs": "count", "samples": "count", "used_share": "number", "duration_s": "number",
        "latitude_deg": "number", "longitude_deg": "number", "pull_at_slip_0_2_n": "number",
        "pull_at_slip_0_2_lower95_n": "number", "pull_at_slip_0_2_upper95_n": "number",
        "drawbar_coefficient": "number", "tractive_efficiency": "number", "version": "text",
    },
    "runs": {
        "run": "text", "file": "text", "start": "time", "duration_s": "number", "rate_hz": "number",
        "cutoff_hz": "number", "samples": "count", "used": "count", "pass_number": "count", "direction": "text",
        "added_load_kg": "number", "inflation_kpa": "number", "load_n": "number", "highest_slip": "number",
        "grade": "text", "grade_reasons": "text", "speed_scale": "number", "residual_latency_s": "number",
        "drawbar_coefficient": "number", "tractive_efficiency": "number", "pull_at_slip_0_2_n": "number",
    },
    "samples": {
        "run": "text", "time_s": "number", "time": "time", "slip": "number", "ground_speed_mps": "number",
        "wheel_speed_radps": "number", "vertical_load_n": "number", "drawbar_pull_n": "number",
        "driving_torque_nm": "number", "sinkage_m": "number", "latitude_deg": "number", "longitude_deg": "number",
        "segment": "text", "used": "truth",
    },
    "notes": {"run": "text", "of": "text", "code": "text", "severity": "text", "text": "text"},
    "fits": {
        "model": "text", "channel": "text", "R0": "number", "R0_per_load": "number", "M0_percent": "number",
        "R2": "number", "samples": "count", "slip_threshold": "number", "stop_reason": "text",
    },
    "coefficients": {"model": "text", **_ESTIMATE},
    "diagnoses": {
        "verdict": "text", "sentence": "text", "none_probability": "number", "adequate": "truth", "R0_base": "number",
        "R0_extended": "number", "reduction_percent": "number", "reduction_lower95": "number",
        "reduction_upper95": "number", "proposal": "text",
    },
    "causes": {
        "family": "text", "kind": "text", "role": "text", "probability": "number", "effect": "text",
        "form_probability": "number", **_ESTIMATE, "at_wheel": "text",
    },
    "gains": {
        "channel": "text", "model": "text", "R0": "number", "M0_percent": "number", "R2": "number",
        "reduction_percent": "number", "lower95": "number", "upper95": "number",
    },
    "sensors": {
        "run": "text", "role": "text", "serial": "text", "rate_hz": "number", "samples": "count", "gaps": "count",
        "longest_gap_s": "number", "latency_s": "number", "sigma": "number", "sigma_source": "text",
        "zero_offset": "number", "zero_method": "text",
    },
    "evidence": {
        "transducer": "text", "terrain": "text", "start": "time", "samples": "count", "about": "texts",
        "soil": "texts", "effects": "texts", "parameters": "texts", "units": "texts", "scales": "numbers",
        "neutrals": "numbers", "one_sided": "truths", "matrix": "numbers",
    },
}  # fmt: skip
"""Every table: its columns, in SI, and what each holds."""
_LATER = ("wheel", "at_wheel")
"""Columns that stores of before several wheels do not have."""


def schema_of(name: str, *, wheels: bool = True) -> pa.Schema:
    """Return the schema of a table; without `wheels` as it was before several wheels."""
    types = {
        "text": pa.string(), "number": pa.float64(), "count": pa.int64(), "truth": pa.bool_(),
        "time": pa.timestamp("us", tz="UTC"), "texts": pa.list_(pa.string()), "numbers": pa.list_(pa.float64()),
        "truths": pa.list_(pa.bool_()),
    }  # fmt: skip
    columns = {"content": "text", "wheel": "text", **COLUMNS[name]}
    return pa.schema([(key, types[kind]) for key, kind in columns.items() if wheels or key not in _LATER])


def packed_schema_of(name: str, *, wheels: bool = True) -> pa.Schema:
    """Return the schema of a table with its campaign as the first column."""
    return schema_of(name, wheels=wheels).insert(0, pa.field("campaign", pa.string()))


def with_later_columns(rows: pa.Table) -> pa.Table:
    """Return rows with the columns of several wheels, which are those of the only one where a file has none."""
    for column, value in zip(_LATER, ("", None), strict=True):
        if column not in rows.column_names:
            rows = rows.append_column(column, pa.array([value] * len(rows), pa.string()))
    return rows
