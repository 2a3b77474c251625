"""Files that may be gzipped, unpacked as they are read; what stands before a cut or damage is kept."""

from __future__ import annotations

import io
import os
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

_GZIP_MAGIC = b"\x1f\x8b"
_GZIP_WINDOW = 31
_PIECE = 256 << 10


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
        self._given = 0
        self.damage = ""

    def readable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return that of the packed file."""
        return self._file.fileno()

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
        self._given += filled
        return filled

    def tell(self) -> int:
        """Return how many unpacked bytes were given."""
        return self._given

    def unread_bytes(self) -> int:
        """Return how many packed bytes are behind the damage."""
        place = self._file.fileno()
        return os.fstat(place).st_size - os.lseek(place, 0, os.SEEK_CUR) + len(self._packed)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


def unpacked(path: Path, ahead_bytes: int) -> io.BufferedReader:
    """Open a file that may be gzipped; `ahead_bytes` can be peeked at; OSError where it cannot be read."""
    raw: Any = path.open("rb", buffering=0)
    file = io.BufferedReader(raw, ahead_bytes)
    if file.peek().startswith(_GZIP_MAGIC):
        raw = Gunzip(file)
        file = io.BufferedReader(raw, ahead_bytes)
    return file
