"""One line of the doctor: what was found, how bad it is, what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from daq.errors import Fault


class Verdict(StrEnum):
    """Fail: the recording would not be made, or could not be used. Warn: something may go wrong."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Line:
    """What a check found at one place.

    Attributes
    ----------
    verdict : Verdict
    where : str
        The bus, the file, the role; may be empty.
    found : str
    next_step : str
        What to do; empty where it is well.
    check : str
        Name of the check; `daq.doctor.examine` fills it in.
    """

    verdict: Verdict
    where: str
    found: str
    next_step: str = ""
    check: str = ""


def passed(where: str, found: str) -> Line:
    """Return a line for what is well."""
    return Line(Verdict.PASS, where, found)


def warned(where: str, found: str, next_step: str) -> Line:
    """Return a line for what may go wrong."""
    return Line(Verdict.WARN, where, found, next_step)


def failed(where: str, found: str, next_step: str) -> Line:
    """Return a line for what is wrong."""
    return Line(Verdict.FAIL, where, found, next_step)


def from_fault(fault: Fault, where: str = "") -> Line:
    """Return a line for a fault that a part of ours told."""
    details = [text for text in (fault.found, fault.expected) if text]
    found = fault.what + (f" ({'; '.join(details)})" if details else "")
    return failed(where or fault.where, found, fault.next_step or "see the text before")
