"""Parquet tables of decoded series -> blocks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from daq import RecordingError, SeriesSection
from daq.can.roles import unit_behind
from daq.series.blocks import BLOCK_ROWS, Blocks, Series, SeriesBlock, SeriesReport
from daq.series.time_stamps import TimeStamps, at_rate, time_columns

_UNIT_KEYS = (b"unit", b"units", b"Unit")


def read_parquet(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a Parquet table; a unit is the field's metadata ``unit``, or in brackets behind the name.

    `DataError` without a time column, `RecordingError` for a file that cannot be read.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        raise RecordingError.of("the Parquet file cannot be read", path, str(error)) from None
    fields = list(file.schema_arrow)
    file.close()
    dates = [field.name for field in fields if _is_time(field.type)]
    numeric = [field.name for field in fields if _is_number(field.type)]
    report.skipped |= {f.name: f"{f.type}" for f in fields if f.name not in dates and f.name not in numeric}
    names = [field.name for field in fields if field.name in dates or field.name in numeric]
    units = {field.name: _unit(field) for field in fields}
    times = time_columns({name: units[name] for name in names}, dates, layout, str(path))
    groups: dict[str, list[str]] = {}
    for name in names:
        if name in numeric and (name in times or not times):
            groups.setdefault(times.get(name, ""), []).append(name)
    topics = {"table" if len(groups) == 1 else time: (time, columns) for time, columns in groups.items()}
    report.unzoned |= any(pa.types.is_timestamp(field.type) and field.type.tz is None for field in fields)

    def read() -> Iterator[Blocks]:
        stamps = {time: TimeStamps(time, units[time], layout, report) for time in groups if time}
        wanted = [*stamps, *(name for columns in groups.values() for name in columns)]
        done = 0
        total = 0
        try:
            with parquet.ParquetFile(path) as opened:
                total = opened.metadata.num_rows
                report.balance.come("rows", len(topics) * total)
                for batch in opened.iter_batches(BLOCK_ROWS, columns=wanted, use_threads=False):
                    cells = {name: _as_numpy(batch.column(name)) for name in batch.schema.names}
                    blocks = []
                    for topic, (time, columns) in topics.items():
                        if time:
                            time_ns, usable = stamps[time].of(cells[time])
                        else:
                            time_ns = at_rate(batch.num_rows, done, layout.rate_hz or 1.0)
                            usable = np.ones(batch.num_rows, np.bool_)
                        values = {name: cells[name].astype(np.float64, copy=False) for name in columns}
                        blocks.append(report.taken(SeriesBlock(topic, time_ns, values), usable))
                    done += batch.num_rows
                    report.share = done / total
                    yield tuple(blocks)
        except (OSError, pa.ArrowException) as error:
            if not any(report.rows.values()):
                raise RecordingError.of("the Parquet file cannot be read", path, str(error)) from None
            report.damage = f"the file cannot be read after row {done}: {error}"
            report.balance.lose("behind the damage", len(topics) * (total - done))

    return Series({topic: {n: units[n] for n in columns} for topic, (_, columns) in topics.items()}, read, report)


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    types = pa.types
    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind) or types.is_boolean(kind))


def _is_time(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))


def _unit(field: Any) -> str:
    metadata = field.metadata or {}
    stated = next((metadata[key] for key in _UNIT_KEYS if key in metadata), b"").decode("utf-8", "replace")
    return stated or unit_behind(field.name)


def _as_numpy(column: Any) -> Any:
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        return column.cast(pa.timestamp("ns"), safe=False).to_numpy(zero_copy_only=False)
    if pa.types.is_duration(column.type):
        return column.cast(pa.duration("ns"), safe=False).to_numpy(zero_copy_only=False)
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    if pa.types.is_decimal(column.type) or column.null_count:
        column = column.cast(pa.float64())
    return column.to_numpy(zero_copy_only=False)
