"""What differs between the diagnoses of two campaigns on the page: soil, causes, errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wheelsoil.wording.change_text import change_row
from wheelsoil.workflows.last_report import LastReport, changes_since, stated_in


def rows_of_difference(first: Mapping[str, Any], other: Mapping[str, Any]) -> list[list[str]]:
    """Return a row for each quantity of two diagnoses, as `diagnose_members` returns them, first less other.

    Quantities that differ beyond their intervals come first; the columns are those of the report's, the other one
    before the first.
    """
    before = LastReport("", "", "", tuple(stated_in(sections_of(other))))
    return [change_row(change) for change in changes_since(before, sections_of(first))]


def sections_of(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is compared of a diagnosis, by the sections of report.json; a barred cause is not."""
    causes = [cause for cause in found["causes"] if "barred" not in cause]
    return {"fit": {"soils": found["soils"]}, "causes": {"causes": causes}, "glance": {"key_figures": found["figures"]}}
