"""Content of a report: sections of texts, tables and figures, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wheelsoil.report.inputs import ReportInputs

_DRAWN = ("x", "y", "z", "x0", "dx", "y0", "dy", "error_y")


@dataclass(frozen=True)
class Text:
    """A paragraph. `kind` is "text", "lead" (the sentence everyone reads), "next" (what to do), "good" or "warning"."""

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
class Light:
    """A traffic light: its subject, the level "good", "fair" or "poor", and the reason as text."""

    name: str
    level: str
    why: str


@dataclass(frozen=True)
class Lights:
    """Traffic lights side by side; text and shape show the level, too."""

    caption: str
    lights: Sequence[Light]


@dataclass(frozen=True)
class Figure:
    """A plotly figure as plain JSON values.

    Attributes
    ----------
    key : str
        Unique in the report.
    data, layout
        Input of plotly.js: lists, mappings, texts, numbers and None, no NaN.
    groups : sequence of str
        Name of the choice that each trace belongs to ("" = always shown); the reader chooses among the groups.
    """

    key: str
    title: str
    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]
    groups: Sequence[str] = ()
    wide: bool = False
    """Whether it takes a row of its own."""


@dataclass(frozen=True)
class Panels:
    """Figures side by side (below each other on a phone) with two lines on how to read them."""

    figures: Sequence[Figure]
    reading: str
    choices: Sequence[str] = ()
    """The groups that the reader may choose from; the first is shown."""


Block = Text | Table | Lights | Panels


@dataclass(frozen=True)
class Section:
    """One part of the report. `numbers` goes to report.json under `key`."""

    key: str
    title: str
    blocks: Sequence[Block]
    numbers: Mapping[str, Any] = field(default_factory=dict)


Contents = tuple[Sequence[Block], Mapping[str, Any]]
"""Blocks of a section, and its numbers."""


@dataclass(frozen=True)
class SectionBuilder:
    """A section before it is built; `contents` raises `DataError` with the reason where there is none."""

    key: str
    title: str
    contents: Callable[[ReportInputs], Contents]

    def build(self, material: ReportInputs) -> Section:
        """Build the section; see `contents` for what it raises."""
        return Section(self.key, self.title, *self.contents(material))


def section(key: str, title: str) -> Callable[[Callable[[ReportInputs], Contents]], SectionBuilder]:
    """Return the decorator that makes a section's builder of the function for its contents."""
    return lambda contents: SectionBuilder(key, title, contents)


def figures_of(section: Section) -> list[Figure]:
    """Return the figures of a section."""
    return [figure for block in section.blocks if isinstance(block, Panels) for figure in block.figures]


def texts_of(section: Section) -> list[str]:
    """Return the texts of a section outside its tables, so that report.json contains their numbers."""
    texts: list[str] = []
    for block in section.blocks:
        if isinstance(block, Text):
            texts.append(block.text)
        elif isinstance(block, Table):
            texts += [block.caption, block.note]
        elif isinstance(block, Lights):
            texts += [f"{light.name}: {light.level}, {light.why}" for light in block.lights]
    return [text for text in texts if text]


def drawn(figure: Figure) -> dict[str, Any]:
    """Return a figure as JSON values: for each trace its name, its group, and its data."""
    groups = figure.groups or [""] * len(figure.data)
    traces = [
        {"name": trace["name"], "shown_for": group} | {key: trace[key] for key in _DRAWN if key in trace}
        for trace, group in zip(figure.data, groups, strict=True)
    ]
    return {"title": figure.title, "traces": traces}
