"""What differs between the diagnoses of two campaigns on the page, or since the last report: soil, causes, errors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from daq import ConfigError
from wheelsoil.to_json import plain
from wheelsoil.wording.change_text import change_row, change_summary
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.grading import grade_of
from wheelsoil.workflows.last_report import LastReport, changes_since, load_last, stated_in, store_meant, subject_of
from wheelsoil.workflows.traction import Traction


def rows_of_difference(first: Mapping[str, Any], other: Mapping[str, Any]) -> list[list[str]]:
    """Return a row for each quantity of two diagnoses, as `diagnose_members` returns them, first less other.

    Quantities that differ beyond their intervals come first; the columns are those of the report's, the other one
    before the first.
    """
    before = LastReport("", "", "", tuple(stated_in(sections_of(other))))
    return [change_row(change) for change in changes_since(before, sections_of(first))]


def sections_of(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is compared of a diagnosis, by the sections of report.json."""
    barred = [cause["name"] for cause in found["causes"] if "barred" in cause]
    causes = {"causes": found["causes"], "barred": barred}
    return {"fit": {"soils": found["soils"]}, "causes": causes, "glance": {"key_figures": found["figures"]}}


def changes_since_last(
    place: str, found: Mapping[str, Any], processed: Processed, traction: Traction
) -> dict[str, Any]:
    """Return what has changed since the last report, or the last campaign in a store, at a place.

    `traction` is that of the runs, as the report shows it. The result has the sentence ``says`` and the ``rows`` of the
    report's section; no rows where there is no such campaign.
    """
    from wheelsoil.fleet import last_campaign, open_store  # its tables take a while to import

    url = store_meant(place)
    try:
        last = load_last(Path(place)) if url is None else last_campaign(open_store(url), processed)[0]
    except ConfigError as error:
        return {"says": "; ".join(f"{fault.what}: {fault.found}" for fault in error.faults), "rows": []}
    changes = changes_since(last, sections_of(found) | _ground(processed, found, traction))
    subject = subject_of(processed[0][0].vehicle) if processed else {}
    return {"says": change_summary(last, changes, subject), "rows": [change_row(change) for change in changes]}


def _ground(processed: Processed, found: Mapping[str, Any], traction: Traction) -> dict[str, Any]:
    """Return the sections of report.json that are of the runs themselves, as far as they are compared."""
    runs = tuple(run for _, run in processed)
    shares = {run.run.id: {"samples": len(run), "used_share": float(np.mean(run.used))} for run in runs if len(run)}
    return {
        "fit": {"soils": found["soils"], "traction": plain(traction)},
        "quality": shares,
        "runs": {run.run.id: {"usable_share": plain(grade_of(run).usable_share)} for run in runs},
    }
