"""CDR, the encoding of ROS 2 messages, for the few messages that are not of a fixed size.

Every number is aligned to its own size, counted from behind the 4 bytes of encapsulation.
"""

from __future__ import annotations

import struct

from daq.recording.chunks import DamagedError
from daq.recording.format import ENCAPSULATION


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
        """Add a builtin_interfaces/Time, held to what its int32 seconds can tell."""
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
