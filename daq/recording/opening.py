"""Find out what an MCAP file holds: from its summary, or, when that is lost, by walking the records."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Header

from daq.errors import Fault, RecordingError
from daq.recording.chunks import ChunkEntry, DamagedError, content_records, message_head, read_at, read_chunk
from daq.recording.contents import MAGIC, Contents, Loss, parsed, read_record, unreadable
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
        raise unreadable(path, error) from None


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
    """Read chunks until every channel that one uses is defined, as far as any of them does.

    A chunk may use what an earlier one defines that has no message of it: the nearest is looked into first.
    """
    looked_into: set[int] = set()
    all_up_to = -1
    for i, entry in enumerate(contents.chunks):
        used = entry.channel_ids
        if used is None:
            looked_into.add(i)
            used = _define_from(file, contents, entry)
        for earlier in range(i, all_up_to, -1):
            if all(map(contents.is_defined, used)):
                break
            if earlier not in looked_into:
                looked_into.add(earlier)
                _define_from(file, contents, contents.chunks[earlier])
        else:
            all_up_to = i


def _define_from(file: BinaryIO, contents: Contents, entry: ChunkEntry) -> frozenset[int]:
    """Take what a chunk defines, and return the channels of its messages."""
    used: set[int] = set()
    with contextlib.suppress(DamagedError):  # told where its frames are read
        for opcode, start, length in content_records(content := read_chunk(file, entry)):
            if opcode == Opcode.MESSAGE:
                used.add(message_head(content, start, length)[0])
            else:
                contents.define(opcode, content[start : start + length])
    return frozenset(used)
