"""What the causes cost, and what has changed since the last report."""

from __future__ import annotations

from typing import Any

from daq import DataError
from wheelsoil.report.content import Block, Contents, Table, Text, section
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.glance import glance
from wheelsoil.report.sections.overview import causes as causes_section
from wheelsoil.report.sections.overview import fit as fit_section
from wheelsoil.report.sections.overview import runs as runs_section
from wheelsoil.report.sections.quality import quality as quality_section
from wheelsoil.to_json import plain
from wheelsoil.wording.change_text import CHANGE_HEAD, change_row, change_summary, differing, of_another_thing
from wheelsoil.wording.cost_text import COST_HEAD, cost_meaning, cost_note, cost_rows, cost_title
from wheelsoil.workflows.cause_cost import cost_of_verdict, highest_slip_of, usual_driving
from wheelsoil.workflows.fit import wheel_of
from wheelsoil.workflows.last_report import changes_since


@section("cost", "What the cause costs")
def cost(inputs: ReportInputs) -> Contents:
    """Build the section; `DataError` where no cause is named."""
    found = cost_of_verdict(
        inputs.diagnosis,
        usual_driving(inputs.fitted),
        wheel_of(inputs.vehicle, "vehicle.toml"),
        inputs.fit.soil,
        inputs.fit.options.reading,
        highest_slip=highest_slip_of(inputs.fitted),
    )
    rows = cost_rows(found)
    table = [Table(cost_title(found), COST_HEAD, rows, cost_note(found), words=("unit",))] if rows else []
    return [Text(cost_meaning(found)), *table], {
        "costs": [vars(entry) | {"difference": entry.difference} for entry in found.costs],
        "load_n": found.driving.load_n,
        "ground_speed_mps": found.driving.speed_mps,
        "passage": found.driving.passage,
    }


@section("against", "Since last time")
def against(inputs: ReportInputs) -> Contents:
    """Build the section; `DataError` where no earlier report was given."""
    if inputs.last is None:
        raise DataError("no earlier report was given (--against)")
    changes = changes_since(inputs.last, _sections(inputs))
    differs = any(change.beyond for change in changes)
    note = "Beyond: by more than both 95 % intervals together; a cause that only one of the two has, too. Of a "
    note += "size at its bound ± is the whole interval."
    summary = change_summary(inputs.last, changes, dict(inputs.facts))
    blocks: list[Block] = [Text(summary, "warning" if differs else "good")]
    rows = [change_row(change) for change in changes]
    blocks.append(Table("Last time and now", CHANGE_HEAD, rows, note, words=CHANGE_HEAD[4:]))
    return blocks, {
        "changes": [
            vars(change) | {"name": ".".join(change.name), "difference": change.difference, "beyond": change.beyond}
            for change in changes
        ],
        "differing": differing(changes),
        "another_thing": of_another_thing(inputs.last, dict(inputs.facts)),
        "last": inputs.last.made_at,
        "last_name": inputs.last.name,
    }


def _sections(inputs: ReportInputs) -> dict[str, Any]:
    """Return the sections that are compared, as report.json has them; those that cannot be built are left out."""
    found: dict[str, Any] = {}
    for builder in (glance, fit_section, causes_section, runs_section, quality_section):
        try:
            found[builder.key] = plain(builder.build(inputs).numbers)
        except DataError:
            continue
    return found
