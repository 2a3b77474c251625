"""A gzipped file as a stream that gives what it can when the file is cut off."""

from __future__ import annotations

import io
import zlib
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

MAGIC = b"\x1f\x8b"
_PIECE = 256 << 10
_GZIP_WINDOW = 31


class Gunzip(io.RawIOBase):
    """Unpacks `file`; unlike the standard library's, it loses nothing that stands before a cut.

    Attributes
    ----------
    damage : str
        What is wrong with the file, once the reading has come to it.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._member = zlib.decompressobj(_GZIP_WINDOW)
        self._packed = b""
        self.damage = ""

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        """Fill `buffer` as far as the file reaches; 0 at its end."""
        view = memoryview(buffer).cast("B")
        filled = 0
        while filled < len(view) and not self.damage:
            if not self._packed:
                self._packed = self._file.read(_PIECE)
            if not self._packed:
                if not self._member.eof:
                    self.damage = "the gzipped file is cut off"
                break
            if self._member.eof:
                self._member = zlib.decompressobj(_GZIP_WINDOW)
            try:
                piece = self._member.decompress(self._packed, len(view) - filled)
            except zlib.error as error:
                self.damage = f"the gzipped file is damaged ({error})"
                break
            self._packed = self._member.unused_data if self._member.eof else self._member.unconsumed_tail
            view[filled : filled + len(piece)] = piece
            filled += len(piece)
        return filled

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()
