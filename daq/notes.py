"""Notes on a result or a recording, as values; the sentences are made in `wheelsoil.wording`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any


class Severity(IntEnum):
    """How much a note reduces the worth of the result that it is about."""

    REMARK = 0
    """How something was done."""
    DOUBT = 1
    """The result is to be read with care."""
    FAULT = 2
    """What follows from it is worth nothing before it is mended."""


@dataclass(frozen=True)
class Note:
    """A fact to report.

    Attributes
    ----------
    code : str
        Which fact: a member of one of the rooms' lists of codes.
    values : mapping str -> Any
        Numbers and names of the sentence, each number's unit at the end of its name.
    runs : tuple of str
        Names of the runs that it is about, where it is about some of several.
    """

    code: str
    severity: Severity = Severity.REMARK
    values: Mapping[str, Any] = field(default_factory=dict, hash=False)
    runs: tuple[str, ...] = ()


class RecordingCode(StrEnum):
    """Facts of a recording, with their values."""

    ANOTHER_FILE = "another_file"
    """file, choice: the file that was made of another recording of that name"""
    CLOCK_SET = "clock_set"
    """count, within_s (NaN: not known)"""
    VALIDITY_UNUSED = "validity_unused"
    """signal: of the ground speed, without a role"""
    UNIT_REPLACED = "unit_replaced"
    """role, unit (of vehicle.toml), written (in the DBC or file)"""
    PARTS_APART = "parts_apart"
    """before, after, length_s"""
    PARTS_OVERLAP = "parts_overlap"
    """before, after, length_s"""
    READ = "read"
    """text: what of a log or a file of series was not read (a doubt), or could be read in another way"""
