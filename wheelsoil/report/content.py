"""What a report is made of: sections of texts, tables and figures, and the numbers they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Text:
    """A paragraph. `kind` is "text", "lead" (the sentence everyone reads), "good" or "warning"."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Table:
    """A table of texts; the first `left` columns are names, the others numbers."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    left: int = 1
    strong: int | None = None
    """The row that is printed bold, e.g. the best model's."""


@dataclass(frozen=True)
class Figure:
    """A plotly figure as plain JSON values.

    Attributes
    ----------
    key : str
        Unique in the report.
    title : str
    data, layout
        As plotly.js takes them.
    groups : sequence of str
        Name of the choice that each trace belongs to ("" = always shown); the reader chooses among the groups.
    """

    key: str
    title: str
    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]
    groups: Sequence[str] = ()


@dataclass(frozen=True)
class Panels:
    """Figures side by side (below each other on a phone) with the two lines on how to read them."""

    figures: Sequence[Figure]
    reading: str
    choices: Sequence[str] = ()
    """The groups that the reader may choose from; the first is shown."""


Block = Text | Table | Panels


@dataclass(frozen=True)
class Section:
    """One part of the report. `numbers` goes to report.json under `key`."""

    key: str
    title: str
    blocks: Sequence[Block]
    numbers: Mapping[str, Any] = field(default_factory=dict)
