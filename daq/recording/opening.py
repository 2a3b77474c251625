"""Find out what an MCAP file holds: from its summary, or, when that is lost, by walking the records."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Header

from daq.errors import Fault, RecordingError
from daq.recording.chunks import DamagedError, read_at, read_chunk
from daq.recording.contents import MAGIC, Contents, Loss, parsed, read_record
from daq.recording.summary import take_summary
from daq.recording.walk import walk


def read_contents(path: Path) -> Contents:
    """Find out what lies where in an MCAP file, whole or cut.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no MCAP file.
    """
    try:
        with path.open("rb") as file:
            contents = Contents(path, file.seek(0, 2))
            _check_magic(file, contents)
            _take_header(file, contents)
            if not take_summary(file, contents):
                walk(file, contents)
            _define_channels(file, contents)
            return contents
    except FileNotFoundError:
        raise RecordingError(Fault("no such file", str(path), next_step="check the path")) from None
    except IsADirectoryError:
        raise RecordingError(Fault("a folder, not a recording", str(path), expected="an .mcap file")) from None
    except OSError as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(Fault("the recording cannot be read", str(path), error.strerror or str(error))) from None


def _check_magic(file: BinaryIO, contents: Contents) -> None:
    head = read_at(file, 0, len(MAGIC))
    if not head:
        raise RecordingError(
            Fault("the file is empty", str(contents.path), next_step="nothing was recorded; look for another file")
        )
    if head != MAGIC:
        raise RecordingError(
            Fault(
                "not an MCAP file",
                str(contents.path),
                found=f"it begins with {head!r}",
                expected=repr(MAGIC),
                next_step="a log of another format goes through `wheelsoil import`",
            )
        )


def _take_header(file: BinaryIO, contents: Contents) -> None:
    try:
        header = parsed(Header.read, read_record(file, len(MAGIC), None, Opcode.HEADER))
        contents.profile, contents.library = header.profile, header.library
    except DamagedError as damage:
        contents.losses.append(Loss(f"the header: {damage}", len(MAGIC), 0))


def _define_channels(file: BinaryIO, contents: Contents) -> None:
    """Read those chunks that use channels which nothing read so far defines."""
    for entry in contents.chunks:
        if entry.bare or (entry.channel_ids is not None and entry.channel_ids <= contents.channels.keys()):
            continue
        try:
            contents.define_from(read_chunk(file, entry))
        except DamagedError:
            continue  # told where its frames are read
