"""Names that ROS 2 tools accept, and the fixed-size layout of decoded topics.

CDR, the encoding of ROS 2 messages, for the few messages that are not of a fixed size.

Every number is aligned to its own size, counted from behind the 4 bytes of encapsulation.
"""

from __future__ import annotations

import json
import keyword
import re
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.arrays import FloatArray, IntArray
from daq.recording.chunks import DamagedError
from daq.recording.format import ENCAPSULATION, HEADER_DEFINITIONS, PACKAGE, fill_prefix, fixed_message_dtype


class CdrEncoder:
    """Puts the fields of one message behind each other, in the order of its definition."""

    def __init__(self) -> None:
        self._body = bytearray()

    def uint8(self, value: int) -> None:
        """Add a uint8 or byte."""
        self._body.append(value)

    def uint32(self, value: int) -> None:
        """Add a uint32: a number, or how many elements of a sequence follow."""
        self._number("<I", value)

    def int64(self, value: int) -> None:
        """Add an int64."""
        self._number("<q", value)

    def text(self, value: str) -> None:
        """Add a string. ROS ends strings at a NUL, so that it holds none; what is no Unicode becomes "?"."""
        data = value.replace("\0", "").encode("utf-8", "replace")
        self.uint32(len(data) + 1)
        self._body += data + b"\0"

    def stamp(self, time_ns: int) -> None:
        """Add a builtin_interfaces/Time, limited to the range of its int32 seconds."""
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        self._number("<i", min(max(seconds, -(2**31)), 2**31 - 1))
        self.uint32(nanoseconds)

    def message(self) -> bytes:
        """Return the message with its encapsulation."""
        return ENCAPSULATION + bytes(self._body)

    def _number(self, form: str, value: int) -> None:
        self._body += bytes(-len(self._body) % struct.calcsize(form)) + struct.pack(form, value)


class CdrDecoder:
    """Takes the fields of one message one after the other.

    Parameters
    ----------
    data : bytes
        The message with its encapsulation.

    Raises
    ------
    DamagedError
        From any method, if the bytes are not such a field.
    """

    def __init__(self, data: bytes) -> None:
        if data[:4] != ENCAPSULATION:
            raise DamagedError("a message that is not little-endian CDR")
        self._body = data[4:]
        self._at = 0

    def uint8(self) -> int:
        """Take a uint8."""
        return self._number("<B")

    def uint32(self) -> int:
        """Take a uint32."""
        return self._number("<I")

    def int64(self) -> int:
        """Take an int64."""
        return self._number("<q")

    def text(self) -> str:
        """Take a string."""
        size = self.uint32()
        data = self._body[self._at : self._at + size]
        if not size or len(data) < size or data[-1]:
            raise DamagedError("a text is cut off")
        self._at += size
        return data[:-1].decode("utf-8", "replace")

    def stamp(self) -> int:
        """Take a builtin_interfaces/Time, in nanoseconds."""
        seconds = self._number("<i")
        return seconds * 1_000_000_000 + self.uint32()

    def _number(self, form: str) -> int:
        size = struct.calcsize(form)
        start = self._at + -self._at % size
        if start + size > len(self._body):
            raise DamagedError("a message is cut off")
        self._at = start + size
        value: int = struct.unpack_from(form, self._body, start)[0]
        return value


def snake_case(name: str) -> str:
    """Return `name` in the form ``[a-z][a-z0-9]*(_[a-z0-9]+)*`` that ROS 2 asks of fields and we use for topics."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    plain = re.sub(r"[^a-z0-9]+", "_", parted.lower()).strip("_")
    return plain if plain[:1].isalpha() else f"x_{plain}".rstrip("_")


def camel_case(name: str) -> str:
    """Return `name` in the form ``[A-Z][a-zA-Z0-9]*`` that ROS 2 asks of types."""
    return "".join(part.capitalize() for part in snake_case(name).split("_"))


def numbered(name: str, taken: Collection[str], joint: str = "_") -> str:
    """Return `name`, or the first of ``name_2``, ``name_3``, ... that is not taken."""
    candidate, number = name, 2
    while candidate in taken:
        candidate, number = f"{name}{joint}{number}", number + 1
    return candidate


def field_names(signals: Sequence[str]) -> list[str]:
    """Return a unique ROS 2 field name for each signal, in order."""
    names: list[str] = []
    taken = {"header", *keyword.kwlist, *keyword.softkwlist}
    for signal in signals:
        names.append(numbered(snake_case(signal), taken))
        taken.add(names[-1])
    return names


_RAW = ("raw", "raw_fd")


class TopicNames:
    """Hands out topic and type names of one recording, each once."""

    def __init__(self) -> None:
        self._buses: dict[str, str] = {}
        self._topics: set[str] = set()
        self._types = {"CanFrame", "CanFrames", "CanFdFrame", "CanFdFrames"}

    def raw_topic(self, bus: str, is_fd: bool) -> str:
        """Return ``/can/<bus>/raw``, or ``raw_fd``; nothing else is ever given these names."""
        return f"{self._folder(bus)}/{_RAW[is_fd]}"

    def topic(self, bus: str, name: str) -> str:
        """Return ``/can/<bus>/<name>`` in snake case, numbered when it is taken."""
        folder = self._folder(bus)
        raw = {f"{folder}/{taken}" for taken in _RAW}
        topic = numbered(f"{folder}/{snake_case(name)}", self._topics | raw)
        self._topics.add(topic)
        return topic

    def _folder(self, bus: str) -> str:
        if bus not in self._buses:
            self._buses[bus] = numbered(snake_case(bus), self._buses.values())
        return f"/can/{self._buses[bus]}"

    def type_name(self, bus: str, message: str) -> str:
        """Return the CamelCase type name of a DBC message on a bus, numbered when it is taken."""
        name = numbered(camel_case(bus) + camel_case(message), self._types, joint="N")
        self._types.add(name)
        return name


@dataclass(frozen=True)
class DecodedLayout:
    """How one DBC message on one bus is written as a topic.

    Attributes
    ----------
    metadata : dict str -> str
        Of the MCAP channel: ``bus``, ``message``, and ``signals``: a JSON object
        field -> {"name": the DBC's signal name, "unit": its unit}.
    signals, fields : tuple of str
        The DBC's names and the field of each.
    dtype : structured dtype
        Of a whole MCAP message record.
    """

    schema_name: str
    schema_text: str
    metadata: dict[str, str]
    signals: tuple[str, ...]
    fields: tuple[str, ...]
    dtype: np.dtype[np.void]

    def records(
        self,
        channel_id: int,
        sequence: int,
        time_ns: IntArray,
        publish_ns: IntArray,
        values: Mapping[str, FloatArray],
    ) -> NDArray[np.void]:
        """Return whole MCAP message records, one a sample; a signal that `values` lacks is NaN."""
        records = np.zeros(len(time_ns), self.dtype)
        fill_prefix(records, channel_id, sequence, time_ns, publish_ns)
        for signal, field in zip(self.signals, self.fields, strict=True):
            records[f"field_{field}"] = values.get(signal, np.nan)
        return records


def decoded_layout(type_name: str, bus: str, message: str, units: Mapping[str, str]) -> DecodedLayout:
    """Lay out a DBC message: a header and one float64 a signal.

    Parameters
    ----------
    type_name : str
        Unique CamelCase name of the ROS 2 type.
    bus, message : str
        As in vehicle.toml and the DBC.
    units : mapping str -> str
        Unit per signal, in the order of the fields.
    """
    signals = tuple(units)
    fields = tuple(field_names(signals))
    described = {field: {"name": name, "unit": units[name]} for field, name in zip(fields, signals, strict=True)}
    padding: list[tuple[str, str]] = [("padding", "<u4")] if fields else []
    return DecodedLayout(
        schema_name=f"{PACKAGE}/msg/{type_name}",
        schema_text="std_msgs/Header header\n" + "".join(f"float64 {f}\n" for f in fields) + HEADER_DEFINITIONS,
        metadata={"bus": bus, "message": message, "signals": json.dumps(described, ensure_ascii=False)},
        signals=signals,
        fields=fields,
        dtype=fixed_message_dtype([*padding, *((f"field_{f}", "<f8") for f in fields)]),
    )
