"""What of an output is compared, and how closely: the one place where that is decided.

A place is such as ``clay-fit.stdout.models.wong.samples``; ``*`` in a pattern stands for anything, dots too.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import NamedTuple

RELATIVE = 1e-9
"""Processors differ by about 7e-11: in the kernels of BLAS, and in numpy's own code."""
FLOOR = 1e-11
"""Of the largest value in the same series: a value near zero carries the rounding error of the large ones."""

WORDS = (
    "*.cannot_tell.*",
    "*.criteria.*.reason",
    "*.figures.*",
    "*.formula",
    "*.growth.reason",
    "*.growth.unit",
    "*.left_out.*",
    "*.loss",
    "*.missing.*",
    "*.next_step",
    "*.not_fitted",
    "*.notes",
    "*.provenance.*",
    "*.quantity",
    "*.reasons",
    "*.remarks",
    "*.result",
    "*.fit_sentence",
    "*.sections.sinkage.unit",
    "*.sentence",
    "*.summary.*",
    "*.text",
    "*.texts.*",
    "*.title",
    "*.trust",
    "*.warnings",
    "*.why",
)
"""Sentences, notes and labels for people: texts and lists of texts are put aside, numbers at such a place are not."""

WITH_NUMBERS = ("*.change", "*.where")
"""Texts that hold a decision as numbers: which run to drive next, where a misfit is. Their numbers are compared."""

LABELLED = ("*.misfit.dp", "*.misfit.t", "*.misfit.z", "*.provenance.used", "*.summary")
"""Mappings whose keys are labels for people: their values are kept in order."""

OF_THE_RUN = (
    "*.attachments.*",
    "*.bytes",
    "*.command",
    "*.file",
    "*.files",
    "*.iterations",
    "*.made_at",
    "*.made_by",
    "*-report.stdout.numbers",
    "*-report.stdout.report",
    "*.sha256",
    "*.source",
    "*.stages_s",
    "*.versions",
    "*.written_by",
)
"""Times, steps, versions, sizes, paths and files: of this run of a command and not of its result; always put aside."""


class Tolerance(NamedTuple):
    """A relative tolerance of its own for the values of a place, and why it is more than `RELATIVE`."""

    place: str
    relative: float
    why: str


TOLERANCES = (
    Tolerance("*.adequacy.threshold", 1e-7, "a quantile of many draws of norms: processors differ by up to 6e-9"),
)


def are_words(place: str) -> bool:
    """Return whether texts at a place are for people."""
    return _matches(place, WORDS)


def has_numbers(place: str) -> bool:
    """Return whether the numbers of a text at a place count, and not its words."""
    return _matches(place, WITH_NUMBERS)


def is_labelled(place: str) -> bool:
    """Return whether the keys of the mapping at a place are for people."""
    return _matches(place, LABELLED)


def is_of_the_run(place: str) -> bool:
    """Return whether a value is put aside whatever it is."""
    return _matches(place, OF_THE_RUN)


def tolerance(place: str) -> float:
    """Return the relative tolerance of the value at a place."""
    return max((one.relative for one in TOLERANCES if fnmatchcase(place, one.place)), default=RELATIVE)


def _matches(place: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(place, pattern) for pattern in patterns)
