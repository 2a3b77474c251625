"""Output of the commands: data on stdout, everything else on stderr."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Protocol, TypeVar

from daq import ConfigError, table_lines, without_powers
from wheelsoil.to_json import to_json

_LEAST_WIDTH = 60

Item = TypeVar("Item")


def say(text: str) -> None:
    """Print a message (stderr)."""
    print(text, file=sys.stderr)


def say_folded(text: str) -> None:
    """Print a long message, folded to the width of the terminal (stderr)."""
    for i, line in enumerate(folded(text, terminal_width() - 2)):
        say(f"  {line}" if i else line)


def terminal_width() -> int:
    """Return the width of the terminal in columns; 96 without a terminal."""
    return max(shutil.get_terminal_size((96, 24)).columns, _LEAST_WIDTH)


def folded(text: str, width: int) -> list[str]:
    """Return a text as lines, broken at spaces only, so that paths and hashes stay whole."""
    if len(text) <= width:
        return [text]
    return textwrap.wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False) or [text]


def hanging(margin: str, text: str) -> list[str]:
    """Return a text as lines behind a margin, folded to the width of the terminal and aligned."""
    first, *more = folded(text, terminal_width() - len(margin))
    return [margin + first, *(f"{'':{len(margin)}}{line}" for line in more)]


def printable_addresses(addresses: Iterable[str], token: str | None) -> tuple[str, ...]:
    """Return a page's addresses for stderr; a given token only on a terminal, because a journal would keep it."""
    secret = token is not None and not sys.stderr.isatty()
    return tuple(address.partition("#")[0] if secret else address for address in addresses)


def print_json(value: Any) -> None:
    """Print a value as JSON (stdout); NaN becomes null, and what a stdout without UTF-8 cannot print is escaped."""
    print(to_json(value, escaped=not (sys.stdout.encoding or "utf-8").lower().startswith("utf")))


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> None:
    """Print aligned columns (stdout), as wide as the terminal at most; see `daq.table_lines`."""
    written = [[without_powers(cell) for cell in row] for row in rows]
    for line in table_lines(head, written, left=left, width=terminal_width()):
        print(line)


def print_pairs(lines: Iterable[tuple[str, str]]) -> None:
    """Print "name  value" lines (stdout); a long value continues on the next line, aligned."""
    pairs = list(lines)
    width = max((len(name) for name, _ in pairs), default=0)
    for name, value in pairs:
        for line in hanging(f"{name.ljust(width)}  ", without_powers(value)):
            print(line)


def progress(items: Iterable[Item], label: str, total: int | None = None) -> Iterator[Item]:
    """Yield `items`, with a progress bar when stderr is a terminal."""
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import track

    yield from track(items, label, total=total, console=Console(stderr=True), transient=True)


@contextmanager
def computing(label: str) -> Iterator[None]:
    """Show how far the fit or the diagnosis inside is and about how long it will take, when stderr is a terminal."""
    from model import watched

    with _bar(label) as show, watched(show) if show else nullcontext():
        yield


@contextmanager
def counting(label: str, what: str) -> Iterator[Callable[[int, float], None] | None]:
    """Yield a function that shows a count of `what` and the share that is done; None if stderr is not a terminal."""
    with _bar(label) as show:
        yield None if show is None else lambda count, share: show(share, f"{count:,} {what}")


class _Show(Protocol):
    def __call__(self, share: float, text: str = "") -> None: ...


@contextmanager
def _bar(label: str) -> Iterator[_Show | None]:
    """Yield a function that moves a progress bar, forwards only; None if stderr is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    named, counted = (TextColumn(f"{{task.fields[{name}]}}", markup=False) for name in ("label", "text"))
    columns = (named, BarColumn(), TimeRemainingColumn(compact=True), counted)
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=1.0, label=label, text="")

        def show(share: float, text: str = "") -> None:
            progress.update(task, completed=max(progress.tasks[0].completed, share), text=text)

        yield show


def check_output(path: Path, *, force: bool = False) -> Path:
    """Check that a new file may be written to `path`, and return it.

    `ConfigError` where its folder does not exist, it is a folder, or it exists already and `force` is not set.
    """
    if path.is_dir():
        raise ConfigError.of("the output is a folder", path, next_step="name a file in it")
    if not path.parent.is_dir():
        raise ConfigError.of("no such folder", path.parent, next_step="create it or choose another output")
    if path.exists() and not force:
        raise ConfigError.of("the output exists already", path, next_step="choose another name, or --force")
    return path
