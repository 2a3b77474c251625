"""The exception tree. The lowest layer, so that every room may use it.

A message says what, where, found, expected and the next step. Each class is also a standard
exception, so that ``except ValueError`` and ``except OSError`` keep working.
"""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

_LISTED_AT_MOST = 3
"""Up to this number of faults that differ only in their place are listed one by one; more become one fault."""

_LONGEST_FOUND = 200
_WHOLE_FILE = "check that the file is whole; report it with the file if it is, so that it can be read"


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong, in the words a user needs.

    Attributes
    ----------
    what : str
        The fault in one sentence.
    where, found, expected, next_step : str, optional
        File, key or row; the offending value; what would have been right; what to do now.
    """

    what: str
    where: str = ""
    found: str = ""
    expected: str = ""
    next_step: str = ""

    def __str__(self) -> str:
        labelled = (
            ("where", self.where),
            ("found", self.found),
            ("expected", self.expected),
            ("next", self.next_step),
        )
        return "\n".join([self.what, *(f"  {label}: {text}" for label, text in labelled if text)])


class WheelsoilError(Exception):
    """Base of every error that wheelsoil raises on purpose.

    Parameters
    ----------
    *faults : Fault or str
        Everything that is wrong, all at once.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, *faults: Fault | str) -> None:
        self.faults: tuple[Fault, ...] = tuple(f if isinstance(f, Fault) else Fault(f) for f in faults)
        super().__init__(_render(self.faults))

    @classmethod
    def of(cls, what: str, where: object = "", found: str = "", expected: str = "", next_step: str = "") -> Self:
        """Return the error of one fault; see `Fault`."""
        return cls(Fault(what, str(where), found, expected, next_step))

    @classmethod
    def stop_if_any(cls, faults: Iterable[Fault]) -> None:
        """Raise one error of all faults, if there are any."""
        if listed := tuple(faults):
            raise cls(*listed)

    @property
    def what(self) -> str:
        """What happened, without where it did and what to do."""
        return "; ".join(fault.what for fault in self.faults)

    def __str__(self) -> str:
        return _render(self.faults)


class ConfigError(WheelsoilError, ValueError):
    """A file, option or argument that people wrote is wrong."""

    exit_code: ClassVar[int] = 2


class TimeUnitError(ConfigError):
    """The unit of time of a file seems to be another one than it says."""


class DatabaseError(ConfigError):
    """A DBC file cannot be used, or contradicts another one."""


class DataError(WheelsoilError, ValueError):
    """The data are readable but cannot give what was asked for."""


class RecordingError(WheelsoilError, OSError):
    """A recording or log cannot be read or written."""

    exit_code: ClassVar[int] = 3


class HardwareError(WheelsoilError, OSError):
    """A bus, an interface or a disk fails."""

    exit_code: ClassVar[int] = 4


def _combined(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    """Combine faults of one kind into one fault where they are many."""
    kinds: dict[Fault, list[Fault]] = {}
    for fault in faults:
        kinds.setdefault(replace(fault, where="", next_step=""), []).append(fault)
    listed: list[Fault] = []
    for group in kinds.values():
        more = len(group) - 1
        if more < _LISTED_AT_MOST:
            listed += group
        else:
            listed.append(replace(group[0], where=f"{group[0].where}; and in {more} more places, to {group[-1].where}"))
    return tuple(listed)


def _render(faults: tuple[Fault, ...]) -> str:
    faults = _combined(faults)
    if len(faults) == 1:
        return str(faults[0])
    numbered = [f"{i}. {fault}".replace("\n", "\n   ") for i, fault in enumerate(faults, 1)]
    return "\n".join([f"{len(faults)} faults:", *numbered])


@contextlib.contextmanager
def every_error_as(
    kind: type[WheelsoilError], what: str, where: Callable[[], object], next_step: str = _WHOLE_FILE
) -> Iterator[None]:
    """Raise whatever goes wrong in here as an error of ours: the boundary around a reader of foreign files.

    A damaged file makes a reader, ours or a library's, fail in ways that nobody listed. Only the outermost reader of a
    file is called in here; errors of ours are not changed.

    Parameters
    ----------
    what : str
        Of the fault, such as "the log cannot be read".
    where : callable
        Returns file and place at the time of the failure.
    """
    try:
        yield
    except WheelsoilError:
        raise
    except Exception as error:
        found = shortened(f"{type(error).__name__}: {error}".rstrip(": ").split("\n")[0])
        raise kind.of(what, where(), found, next_step=next_step) from error


def not_installed(files: str, package: str, where: object, extra: str) -> ConfigError:
    """Return the error of files, or another thing, that need a package of one of our extras."""
    return ConfigError.of(
        f"{files} need {package}, which is not installed", where, next_step=f"pip install 'wheelsoil[{extra}]'"
    )


def shortened(found: str) -> str:
    """Return a found value for a message; of a long one the beginning and its length."""
    return found if len(found) <= _LONGEST_FOUND else f"{found[:_LONGEST_FOUND]}... ({len(found):,} characters)"


def near_names(name: str, known: Iterable[str]) -> list[str]:
    """Return up to three known names that are spelled nearly so, the nearest first."""
    return difflib.get_close_matches(name, sorted(set(known)), n=3, cutoff=0.5)


def nearest(name: str, known: Iterable[str], most: int = 12, label: str = "") -> str:
    """Return the nearest known names as text for a message ("nearest: a, b"), or the whole short list.

    Within a sentence a `label` says what that list is of.
    """
    names = sorted(set(known))
    if close := near_names(name, names):
        return f"nearest: {', '.join(close)}"
    if not names:
        return "there are none"
    listed = ", ".join(names[:most]) + (", ..." if len(names) > most else "")
    return f"{label}{listed}"
