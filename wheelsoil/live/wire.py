"""Messages between the logger and the page's process: one JSON object per datagram."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, get_args

from daq.logger import Command, CommandKind

LARGEST_BYTES = 1 << 20
GOODBYE = b'{"goodbye":true}'
"""The logger ends normally."""

LONGEST_TEXT = 200
_NO_COMMAND = 'no such command; expected {"kind": "start", "stop" or "mark", "text": a text}'


def packed(snapshot: Mapping[str, Any]) -> bytes:
    """Return a snapshot as a datagram.

    NaN and infinities, which JSON lacks, are written as Python does; `unpacked` turns them into None.
    """
    return json.dumps(snapshot, separators=(",", ":"), default=_item).encode()


def unpacked(datagram: bytes) -> dict[str, Any]:
    """Return the snapshot that `packed` wrote, NaN and infinities as None."""
    value = json.loads(datagram, parse_constant=lambda _: None)
    assert isinstance(value, dict)
    return value


def packed_command(command: Command) -> bytes:
    """Return a command as a datagram."""
    return json.dumps(asdict(command)).encode()


def command_from(body: bytes) -> Command | str:
    """Return the command in a JSON body, or the reason why there is none.

    Control characters become spaces, so that a note is one line of text.
    """
    try:
        value = json.loads(body)
    except (ValueError, RecursionError):
        return "the body is not JSON"
    if not isinstance(value, dict) or not set(value) <= {"kind", "text"}:
        return _NO_COMMAND
    kind, text = value.get("kind"), value.get("text", "")
    kinds: tuple[CommandKind, ...] = get_args(CommandKind)
    if kind not in kinds or not isinstance(text, str):
        return _NO_COMMAND
    if len(text) > LONGEST_TEXT:
        what = "the name of a run" if kind == "start" else "a text"
        return f"{what} has at most {LONGEST_TEXT} characters, this one has {len(text)}"
    return Command(kinds[kinds.index(kind)], " ".join("".join(c if c.isprintable() else " " for c in text).split()))


def _item(value: Any) -> Any:
    """Return a numpy value or enumeration member as Python has it, else a text: no snapshot may stop the logger."""
    for method in ("tolist", "value"):
        if hasattr(value, method):
            found = getattr(value, method)
            return found() if callable(found) else found
    return str(value)
