"""ROS bags (ROS 1, ROS 2 as SQLite or MCAP) of decoded series, through rosbags, which is an extra."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from daq import DataError, RecordingError, SeriesSection, not_installed
from daq.series.blocks import BLOCK_ROWS, Blocks, Series, SeriesBlock, SeriesReport
from daq.series.time_stamps import refuse_rate

_LONGEST_ARRAY = 64
"""Elements of an array that become columns; a longer one is an image or a cloud."""
_ROWS_TOGETHER = BLOCK_ROWS


def read_bag(path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    """Open a bag: a topic is a table, its columns the numbers in its messages (``velocity[2]``, ``twist.linear.x``).

    The time of a message is its header's stamp where it has one, else when it was recorded. Topics whose messages may
    differ in length are read twice, first for their columns. `ConfigError` without rosbags, `RecordingError` for a bag
    that cannot be read, `DataError` for one without numbers.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise not_installed("ROS bags", "rosbags", path, "series") from None
    refuse_rate(layout, "the stamps of its messages", str(path))

    def opened() -> Any:
        return AnyReader([path], default_typestore=get_typestore(Stores.LATEST))

    topics: dict[str, dict[str, str]] = {}
    try:
        with opened() as reader:
            for connection in reader.connections:
                columns = topics.get(connection.topic, {})
                for _, _, data in reader.messages([connection]):
                    message = reader.deserialize(data, connection.msgtype)
                    columns |= dict.fromkeys((name for name, _ in _numbers("", message, connection.topic, report)), "")
                    if not _varies(message):
                        break
                if columns:
                    topics[connection.topic] = columns
                else:
                    none = "no numbers" if connection.msgcount else "no messages"
                    report.skipped[connection.topic] = f"{none} in {connection.msgtype}"
    except Exception as error:  # noqa: BLE001  # rosbags raises whatever it meets in a damaged bag
        raise RecordingError.of("the bag cannot be read", path, str(error) or type(error).__name__) from None
    if not topics:
        raise DataError.of("no topic of the bag holds numbers", path, ", ".join(report.skipped) or "no messages")

    def read() -> Iterator[Blocks]:
        gathered: dict[str, list[tuple[int, dict[str, float]]]] = {}
        count = total = 0
        try:
            with opened() as reader:
                wanted = [connection for connection in reader.connections if connection.topic in topics]
                total = sum(connection.msgcount for connection in wanted)
                report.balance.come("messages", total)
                for connection, time_ns, data in reader.messages(wanted):
                    message = reader.deserialize(data, connection.msgtype)
                    numbers = dict(_numbers("", message, connection.topic, report))
                    stamp = getattr(getattr(message, "header", None), "stamp", None)
                    stamp_ns = 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
                    row = (stamp_ns or time_ns, numbers)
                    gathered.setdefault(connection.topic, []).append(row)
                    count += 1
                    if count % _ROWS_TOGETHER == 0:
                        report.share = count / total
                        yield tuple(_block(topic, topics[topic], rows, report) for topic, rows in gathered.items())
                        gathered = {}
                report.balance.come("messages", max(count - total, 0))
                report.balance.lose("stated, and not in the bag", max(total - count, 0))
        except Exception as error:  # noqa: BLE001  # see above; what came before it stays
            report.damage = f"after {count} messages the bag cannot be read: {error}"
            report.balance.lose("behind the damage", total - count)
        yield tuple(_block(topic, topics[topic], rows, report) for topic, rows in gathered.items())

    return Series(topics, read, report)


def _block(
    topic: str, columns: dict[str, str], rows: list[tuple[int, dict[str, float]]], report: SeriesReport
) -> SeriesBlock:
    time_ns = np.array([time for time, _ in rows], np.int64)
    nothing = float("nan")
    values = {name: np.array([row.get(name, nothing) for _, row in rows], np.float64) for name in columns}
    return report.taken(SeriesBlock(topic, time_ns, values), np.ones(len(rows), np.bool_))


def _varies(value: Any) -> bool:
    """Return whether a message has a sequence, which may be of another length in the next one."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return True
    return any(_varies(getattr(value, name)) for name in getattr(value, "__dataclass_fields__", ()))


def _numbers(prefix: str, value: Any, topic: str, report: SeriesReport) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a message with their paths; the header is its time."""
    if isinstance(value, (bool, int, float, np.number)):
        yield prefix, float(value)
    elif isinstance(value, (list, tuple, np.ndarray)):
        if len(value) <= _LONGEST_ARRAY:
            for i, element in enumerate(value):
                yield from _numbers(f"{prefix}[{i}]", element, topic, report)
        else:
            report.skipped[f"{topic}.{prefix}"] = f"more than {_LONGEST_ARRAY} elements"
    else:
        for name in getattr(value, "__dataclass_fields__", ()):
            if not (name == "header" and not prefix) and not name.startswith("__"):
                yield from _numbers(f"{prefix}.{name}" if prefix else name, getattr(value, name), topic, report)
