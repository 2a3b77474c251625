"""Content of a report: sections of texts, tables and figures, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.mending import Step
from wheelsoil.workflows.key_figures import KeyFigure

_DRAWN = ("x", "y", "z", "x0", "dx", "y0", "dy", "error_y")


@dataclass(frozen=True)
class Text:
    """A paragraph. `kind` is "text", "lead" (the sentence everyone reads), "next" (what to do), "good" or "warning"."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Table:
    """A table of texts; the first `left` columns and those titled as in `words` are words, the others numbers."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str | KeyFigure]]
    note: str = ""
    left: int = 1
    words: Collection[str] = ()
    strong: int | None = None
    """The row that is printed bold, e.g. the best model's."""


@dataclass(frozen=True)
class Figure:
    """A figure of the appendix as plain JSON values without NaN; figure.js draws it.

    `wheelsoil.report.figures` makes `data` and `layout`; `groups` names the choice that each trace belongs to ("" =
    always shown); the reader chooses among them.
    """

    key: str
    title: str
    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]
    groups: Sequence[str] = ()
    wide: bool = False
    """Whether it takes a row of its own."""


def grouped(
    key: str,
    title: str,
    groups: Iterable[tuple[str, Sequence[Mapping[str, Any]]]],
    layout: Mapping[str, Any],
    *,
    wide: bool = False,
) -> Figure:
    """Return a figure of the traces of each choice of the reader, given as (choice, traces)."""
    named = [(trace, group) for group, traces in groups for trace in traces]
    return Figure(key, title, [trace for trace, _ in named], layout, [group for _, group in named], wide)


@dataclass(frozen=True)
class Panels:
    """Figures side by side (below each other on a phone) with two lines on how to read them."""

    figures: Sequence[Figure]
    reading: str
    choices: Sequence[str] = ()
    """The groups that the reader may choose from; the first is shown."""
    linked: bool = False
    """Whether the figures share their x axis: they zoom together, and one cursor runs through them."""
    places: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Of a linked choice: ``x``, ``east`` and ``north`` of where it was, for a small map with the cursor's place."""


@dataclass(frozen=True)
class Drawing:
    """A figure as SVG, which needs no script; `narrow` is the one for a phone and paper.

    Attributes
    ----------
    curves : sequence of mapping
        ``name``, ``x``, ``y`` and perhaps ``lower`` and ``upper`` of each line: what is saved as CSV.
    reading : str
        How to read it.
    """

    key: str
    title: str
    caption: str
    wide: str
    narrow: str
    curves: Sequence[Mapping[str, Any]]
    reading: str = ""


@dataclass(frozen=True)
class Pair:
    """Blocks side by side, below each other on a phone."""

    blocks: Sequence[Block]


@dataclass(frozen=True)
class Tile:
    """A number to see first: before (may be empty), value, unit, change, and a line below."""

    title: str
    value: str
    unit: str = ""
    note: str = ""
    before: str = ""
    change: str = ""
    keys: tuple[KeyFigure | None, KeyFigure | None] = (None, None)
    """What before and value are, where they are key figures."""
    better: bool = True
    """Whether the change is an improvement beyond its interval."""


@dataclass(frozen=True)
class Tiles:
    """Tiles side by side; `small` ones are further numbers."""

    tiles: Sequence[Tile]
    small: bool = False


MOST_STEPS = 3


@dataclass(frozen=True)
class Steps:
    """What to do next, the best first, at most `MOST_STEPS`; which runs to drive again; what to check.

    `again_elsewhere` says which runs for another page.
    """

    steps: Sequence[Step]
    again: str = ""
    again_elsewhere: str = ""
    cautions: Sequence[str] = ()


@dataclass(frozen=True)
class Bar:
    """A share between 0 and 1 with its name."""

    name: str
    share: float
    text: str
    strong: bool = False


@dataclass(frozen=True)
class Bars:
    """Shares below each other."""

    title: str
    caption: str
    bars: Sequence[Bar]


@dataclass(frozen=True)
class Check:
    """A check: whether all is well, and what was found."""

    good: bool
    text: str


@dataclass(frozen=True)
class Checks:
    """Checks with a sign and a word each."""

    title: str
    caption: str
    checks: Sequence[Check]


@dataclass(frozen=True)
class Links:
    """Lines below each other: name, text, and the page beside this one to which the name leads; empty: none."""

    title: str
    lines: Sequence[tuple[str, str, str]]


Block = Text | Table | Panels | Drawing | Pair | Tiles | Steps | Bars | Checks | Links


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

    def build(self, inputs: ReportInputs) -> Section:
        """Build the section; see `contents` for what it raises."""
        return Section(self.key, self.title, *self.contents(inputs))


def section(key: str, title: str) -> Callable[[Callable[[ReportInputs], Contents]], SectionBuilder]:
    """Return the decorator that makes a section's builder of the function for its contents."""
    return lambda contents: SectionBuilder(key, title, contents)


def figures_of(section: Section) -> list[Figure]:
    """Return the figures of a section that a script draws."""
    return [figure for block in blocks_of(section) if isinstance(block, Panels) for figure in block.figures]


def drawings_of(section: Section) -> list[Drawing]:
    """Return the figures of a section that are SVG."""
    return [block for block in blocks_of(section) if isinstance(block, Drawing)]


def blocks_of(section: Section) -> list[Block]:
    """Return the blocks of a section, those side by side one after the other."""
    return [part for block in section.blocks for part in (block.blocks if isinstance(block, Pair) else (block,))]


def texts_of(section: Section) -> list[str]:
    """Return the texts of a section outside its tables, so that report.json contains their numbers."""
    texts: list[str] = []
    for block in blocks_of(section):
        if isinstance(block, Text):
            texts.append(block.text)
        elif isinstance(block, Table):
            texts += [block.caption, block.note]
        elif isinstance(block, Drawing):
            texts += [block.title, block.caption]
        elif isinstance(block, Tiles):
            texts += [f"{tile.title}: {tile.before} {tile.value} {tile.unit} {tile.note}" for tile in block.tiles]
        elif isinstance(block, Steps):
            texts += [*(f"{step.what} {step.why}" for step in block.steps), block.again, *block.cautions]
        elif isinstance(block, Bars):
            texts += [block.title, *(f"{bar.name}: {bar.text}" for bar in block.bars)]
        elif isinstance(block, Checks):
            texts += [check.text for check in block.checks]
        elif isinstance(block, Links):
            texts += [f"{name}: {text}" for name, text, _ in block.lines]
    return [text for text in texts if text]


def drawn(figure: Figure) -> dict[str, Any]:
    """Return a figure as JSON values: for each trace its name, its group, and its data."""
    groups = figure.groups or [""] * len(figure.data)
    traces = [
        {"name": trace["name"], "shown_for": group} | {key: trace[key] for key in _DRAWN if key in trace}
        for trace, group in zip(figure.data, groups, strict=True)
    ]
    return {"title": figure.title, "traces": traces}
