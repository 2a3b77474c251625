"""Decoded channels of MF4 files (ASAM MDF 4), through asammdf, which is an extra."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from daq import DataError, RecordingError, SeriesSection, WheelsoilError, not_installed
from daq.formatting import numbered
from daq.logs.mf4 import start_ns_of
from daq.series.blocks import BLOCK_ROWS, Blocks, Series, SeriesBlock, SeriesReport, together
from daq.series.time_stamps import refuse_rate

_BUS_EVENT = 2
_MASTER_TYPES = (2, 3)


def read_mdf(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open the decoded channels of an MF4 file: a channel group is a topic.

    `ConfigError` without asammdf, `DataError` for frames of a bus, `RecordingError` for a file that cannot be read.
    """
    try:
        import asammdf
    except ImportError:
        raise not_installed("MF4 files", "asammdf", path, "mf4") from None
    refuse_rate(layout, "the masters of the channel groups", str(path))
    groups: dict[str, tuple[int, dict[str, str]]] = {}
    try:
        mdf = asammdf.MDF(path)
        if any(group.channel_group.flags & _BUS_EVENT for group in mdf.groups):
            raise DataError.of("the MF4 file holds frames of a bus", path, next_step="import it as a log")
        start_ns = start_ns_of(mdf)
        for index, group in enumerate(mdf.groups):
            name = numbered(group.channel_group.acq_name or f"group_{index}", groups)
            units = {
                channel.name: _unit(channel) for channel in group.channels if channel.channel_type not in _MASTER_TYPES
            }
            if group.channel_group.cycles_nr and units:
                groups[name] = (index, units)
            elif units:
                report.skipped |= dict.fromkeys(units, "no samples")
    except WheelsoilError:
        raise
    except Exception as error:  # noqa: BLE001  # asammdf raises whatever it meets in a damaged file
        raise RecordingError.of(
            "asammdf cannot read this MF4 file", path, str(error), "", "export it again, or as CSV"
        ) from None

    def stream(topic: str, index: int, names: dict[str, str]) -> Iterator[SeriesBlock]:
        total = mdf.groups[index].channel_group.cycles_nr
        report.balance.come("rows", total)
        for offset in range(0, total, BLOCK_ROWS):
            values: dict[str, Any] = {}
            seconds = np.zeros(0)
            for name in names:
                stored = mdf.get(name, index, record_offset=offset, record_count=BLOCK_ROWS, raw=True)
                signal = stored.physical(copy=False, ignore_value2text_conversions=True)
                seconds = signal.timestamps
                if signal.samples.dtype.kind in "fiub" and signal.samples.ndim == 1:
                    values[name] = signal.samples.astype(np.float64)
                else:
                    report.skipped[name] = "no numbers"
            missing = min(BLOCK_ROWS, total - offset) - len(seconds)
            report.balance.lose("stated, and not in the file", missing)
            time_ns = start_ns + np.rint(seconds * 1e9).astype(np.int64)
            yield report.taken(SeriesBlock(topic, time_ns, values), np.isfinite(seconds))

    def read() -> Iterator[Blocks]:
        return together([stream(topic, index, units) for topic, (index, units) in groups.items()])

    return Series({topic: units for topic, (_, units) in groups.items()}, read, report)


def _unit(channel: Any) -> str:
    conversion = channel.conversion
    return str(channel.unit or (conversion.unit if conversion is not None else "") or "")
