"""The recording format: MCAP profile ``ros2``, every topic ``cdr`` with a ``ros2msg`` schema.

Raw frames lie in one topic per bus and kind of frame, many fixed-size records a message. The CDR layout of that
array is exactly `CLASSIC_DTYPE` or `FD_DTYPE`, so that reading and writing are memory copies. CDR aligns each
number to its own size, counted from behind the 4 bytes of encapsulation. With the constant 7-letter frame id the
header takes 20 bytes and the count of the array 4 more: the records begin at byte 24, aligned to 8.
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from daq.arrays import IntArray
from daq.can.frames import CLASSIC_DTYPE, FD_DTYPE, FrameArray
from daq.formatting import numbered
from daq.recording.chunks import DamagedError

PROFILE = "ros2"
MESSAGE_ENCODING = "cdr"
SCHEMA_ENCODING = "ros2msg"
PACKAGE = "wheelsoil_msgs"
FRAME_ID = b"vehicle\0"
"""Constant frame id of every header, with CDR's closing NUL: 8 bytes, so that all records have a fixed size."""

CLASSIC_SCHEMA = f"{PACKAGE}/msg/CanFrames"
FD_SCHEMA = f"{PACKAGE}/msg/CanFdFrames"
RAW_DTYPES: dict[str, np.dtype[np.void]] = {CLASSIC_SCHEMA: CLASSIC_DTYPE, FD_SCHEMA: FD_DTYPE}
"""Record layout of each raw schema."""

RUN_START = "run_start"
RUN_END = "run_end"
"""Names of the metadata records that open and close a run, or a part of one."""

LOSSES = "losses"
"""Name of the metadata records that count what was lost; written while recording, the last one holds."""

DEFINITION_RULE = "=" * 80
"""Stands between a ros2msg definition and those that it needs."""

TIME_DEFINITION = f"""\
{DEFINITION_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
HEADER_DEFINITIONS = f"""\
{DEFINITION_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{TIME_DEFINITION}"""
_RECORD_FIELDS = """\
int64 time_ns
uint32 can_id
uint8 bus
uint8 flags
uint8 length
uint8 reserved
"""

NAVSATFIX_SCHEMA = "sensor_msgs/msg/NavSatFix"
NAVSATFIX_TEXT = f"""\
std_msgs/Header header
sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
{HEADER_DEFINITIONS}{DEFINITION_RULE}
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service
"""

ENCAPSULATION = b"\x00\x01\x00\x00"
"""CDR, little endian."""
MESSAGE_OPCODE = 5
_RAW_MESSAGE = struct.Struct("<BQHIQQ4siII8sI")
_RAW_BODY = struct.Struct("<4siII8sI")
RAW_PREFIX_SIZE = _RAW_BODY.size
"""Bytes of a raw message before its first frame."""

# What an MCAP message record and a CDR header put before the fields of a fixed-size message.
_MESSAGE_PREFIX = [
    ("opcode", "u1"),
    ("record_length", "<u8"),
    ("channel_id", "<u2"),
    ("sequence", "<u4"),
    ("log_time", "<u8"),
    ("publish_time", "<u8"),
    ("encapsulation", "S4"),
    ("sec", "<i4"),
    ("nanosec", "<u4"),
    ("frame_id_length", "<u4"),
    ("frame_id", "S8"),
]
RECORD_HEAD_SIZE = 9

_RAW = ("raw", "raw_fd")

SERIES_BUS = ""
"""Stands for the bus in the topics of decoded series, which have none."""

_CHECKSUM_KEY = "crc32"


def raw_schema_text(name: str) -> str:
    """Return the ros2msg definition of `CLASSIC_SCHEMA` or `FD_SCHEMA`."""
    element = name.rsplit("/", 1)[1].removesuffix("s")
    size = RAW_DTYPES[name]["data"].shape[0]
    return (
        f"std_msgs/Header header\n{PACKAGE}/{element}[] frames\n{HEADER_DEFINITIONS}"
        f"{DEFINITION_RULE}\nMSG: {PACKAGE}/{element}\n{_RECORD_FIELDS}uint8[{size}] data\n"
    )


def fixed_message_dtype(fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]]) -> np.dtype[np.void]:
    """Return the layout of a whole MCAP message record with these CDR fields behind its header."""
    return np.dtype([*_MESSAGE_PREFIX, *fields])


def fill_prefix(records: NDArray[np.void], channel_id: int, sequence: int, time_ns: IntArray) -> None:
    """Fill everything before the fields of fixed-size message records, in place."""
    records["opcode"] = MESSAGE_OPCODE
    records["record_length"] = records.dtype.itemsize - RECORD_HEAD_SIZE
    records["channel_id"] = channel_id
    records["sequence"] = (sequence + np.arange(len(records))) & 0xFFFFFFFF
    records["log_time"] = records["publish_time"] = np.maximum(time_ns, 0)
    records["encapsulation"] = ENCAPSULATION
    seconds, nanoseconds = np.divmod(time_ns, 1_000_000_000)
    records["sec"] = np.clip(seconds, -(2**31), 2**31 - 1)
    records["nanosec"] = nanoseconds
    records["frame_id_length"] = len(FRAME_ID)
    records["frame_id"] = FRAME_ID


def _stamp(time_ns: int) -> tuple[int, int]:
    """Return the fields of a builtin_interfaces/Time: seconds, limited to the range of an int32, and nanoseconds."""
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return min(max(seconds, -(2**31)), 2**31 - 1), nanoseconds


def raw_message_head(channel_id: int, sequence: int, time_ns: int, frame_count: int, record_size: int) -> bytes:
    """Return what goes before the frames in the MCAP message record of a raw batch.

    Parameters
    ----------
    time_ns : int
        Host receive time of the last frame.
    frame_count, record_size : int
        Number of frames that follow, and the bytes of each.
    """
    seconds, nanoseconds = _stamp(time_ns)
    unsigned_ns = max(time_ns, 0)
    length = _RAW_MESSAGE.size - RECORD_HEAD_SIZE + frame_count * record_size
    return _RAW_MESSAGE.pack(
        MESSAGE_OPCODE,
        length,
        channel_id,
        sequence & 0xFFFFFFFF,
        unsigned_ns,
        unsigned_ns,
        ENCAPSULATION,
        seconds,
        nanoseconds,
        len(FRAME_ID),
        FRAME_ID,
        frame_count,
    )


def raw_frames(content: bytes, start: int, length: int, dtype: np.dtype[np.void]) -> FrameArray:
    """Return the frames of one raw message, whose CDR bytes lie at `start` in `content`, as a view.

    Raises ValueError if the bytes are not laid out as `raw_message_head` writes them.
    """
    if length < RAW_PREFIX_SIZE:
        raise ValueError(f"a raw message of {length} bytes is too short")
    encapsulation, _, _, id_length, _, count = _RAW_BODY.unpack_from(content, start)
    if encapsulation != ENCAPSULATION or id_length != len(FRAME_ID):
        raise ValueError("a raw message has another header than wheelsoil writes")
    if length != RAW_PREFIX_SIZE + count * dtype.itemsize:
        raise ValueError(f"a raw message of {length} bytes cannot hold {count} frames of {dtype.itemsize} bytes")
    return np.frombuffer(content, dtype, count, start + RAW_PREFIX_SIZE)


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
        seconds, nanoseconds = _stamp(time_ns)
        self._number("<i", seconds)
        self.uint32(nanoseconds)

    def message(self) -> bytes:
        """Return the message with its encapsulation."""
        return ENCAPSULATION + bytes(self._body)

    def _number(self, form: str, value: int) -> None:
        self._body += bytes(-len(self._body) % struct.calcsize(form)) + struct.pack(form, value)


class CdrDecoder:
    """Takes the fields of one message, given with its encapsulation, one after the other.

    Raises DamagedError from any method, if the bytes are not such a field.
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
        """Return ``/can/<bus>/<name>`` in snake case, or ``/series/<name>``, numbered when it is taken."""
        folder = self._folder(bus)
        raw = {f"{folder}/{taken}" for taken in _RAW}
        topic = numbered(f"{folder}/{snake_case(name)}", self._topics | raw)
        self._topics.add(topic)
        return topic

    def _folder(self, bus: str) -> str:
        if bus == SERIES_BUS:
            return "/series"
        if bus not in self._buses:
            self._buses[bus] = numbered(snake_case(bus), self._buses.values())
        return f"/can/{self._buses[bus]}"

    def type_name(self, bus: str, message: str) -> str:
        """Return the CamelCase type name of a DBC message on a bus, numbered when it is taken."""
        first = "Series" if bus == SERIES_BUS else camel_case(bus)
        name = numbered(first + camel_case(message), self._types, joint="N")
        self._types.add(name)
        return name


def with_checksum(name: str, values: Mapping[str, str]) -> dict[str, str]:
    """Return metadata values behind a checksum: MCAP itself has none for them."""
    plain = {key: text for key, text in values.items() if key != _CHECKSUM_KEY}
    return {_CHECKSUM_KEY: _checksum(name, plain), **plain}


def checked_metadata(name: str, values: Mapping[str, str]) -> dict[str, str] | None:
    """Return metadata values without their checksum, or None where it does not fit."""
    plain = {key: text for key, text in values.items() if key != _CHECKSUM_KEY}
    if _CHECKSUM_KEY in values and values[_CHECKSUM_KEY] != _checksum(name, plain):
        return None
    return plain


def _checksum(name: str, values: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps([name, sorted(values.items())]).encode()):08x}"
