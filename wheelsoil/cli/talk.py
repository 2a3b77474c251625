"""How the commands talk: data on stdout, everything else on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from daq.errors import ConfigError, Fault
from wheelsoil.plain import to_json

Item = TypeVar("Item")


def say(text: str) -> None:
    """Tell the person something (stderr)."""
    print(text, file=sys.stderr)


def print_json(value: Any) -> None:
    """Print facts as JSON (stdout); NaN becomes null."""
    print(to_json(value))


def table_lines(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> list[str]:
    """Return aligned columns, the first `left` of them left-aligned, the others right-aligned."""
    lines = [list(head), *[list(row) for row in rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    return ["  ".join(_cells(line, widths, left)).rstrip() for line in lines]


def _cells(line: Sequence[str], widths: Sequence[int], left: int) -> Iterator[str]:
    for i, (text, width) in enumerate(zip(line, widths, strict=True)):
        yield text.ljust(width) if i < left else text.rjust(width)


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> None:
    """Print aligned columns (stdout); see `table_lines`."""
    for line in table_lines(head, rows, left=left):
        print(line)


def print_facts(facts: Iterable[tuple[str, str]]) -> None:
    """Print "name  value" lines (stdout)."""
    pairs = list(facts)
    width = max((len(name) for name, _ in pairs), default=0)
    for name, value in pairs:
        print(f"{name.ljust(width)}  {value}")


def progress(items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
    """Yield `items`, with a progress bar when stderr is a terminal.

    Parameters
    ----------
    items : iterable
    label : str
    total : int, optional
        Number of items, where it is known.
    """
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import track

    yield from track(items, label, total=total, console=Console(stderr=True), transient=True)


@contextmanager
def counter(label: str, what: str) -> Iterator[Callable[[int], None] | None]:
    """Give a function that shows a growing number of `what`, or None when stderr is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status(label) as status:
        yield lambda count: status.update(f"{label}: {count:,} {what}")


def number(value: float, digits: int = 4) -> str:
    """Return a number with `digits` significant digits, or "-" where there is none."""
    return f"{value:.{digits}g}" if value == value else "-"


def check_output(path: Path, *, force: bool = False) -> Path:
    """Return `path` when a new file may be written there.

    Raises
    ------
    ConfigError
        Its folder does not exist, it is a folder, or it exists already and `force` is not set.
    """
    if path.is_dir():
        raise ConfigError(Fault("the output is a folder", str(path), next_step="name a file in it"))
    if not path.parent.is_dir():
        raise ConfigError(Fault("no such folder", str(path.parent), next_step="create it or choose another output"))
    if path.exists() and not force:
        raise ConfigError(Fault("the output exists already", str(path), next_step="choose another name, or --force"))
    return path
