"""Interface of a panel that shows the logger's state and passes commands of its users.

The logger hands a snapshot to a `Panel` a few times a second and asks it for commands. A panel may be slow,
broken or absent: neither call may wait, and neither may raise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

CommandKind = Literal["start", "stop", "mark"]


@dataclass(frozen=True)
class Command:
    """What a person asked for.

    Attributes
    ----------
    kind : {"start", "stop", "mark"}
        Begin a new run (a running one ends), end the run (recording goes on, between runs), put a mark into the file.
    text : str
        The run's id, or the note that goes with the mark; may be empty.
    """

    kind: CommandKind
    text: str = ""


class Panel(Protocol):
    """Where the logger's state is shown; see the module's text for what is asked of an implementation."""

    def show(self, snapshot: Mapping[str, Any]) -> None:
        """Take a snapshot, as `daq.logger.snapshot` makes it; drop it rather than wait."""

    def commands(self) -> list[Command]:
        """Return what was asked for since the last call."""

    def close(self) -> None:
        """Take it down; a second call does nothing."""


class NoPanel:
    """Shows nothing and asks for nothing."""

    def show(self, snapshot: Mapping[str, Any]) -> None:
        """See `Panel`."""

    def commands(self) -> list[Command]:
        """See `Panel`."""
        return []

    def close(self) -> None:
        """See `Panel`."""
