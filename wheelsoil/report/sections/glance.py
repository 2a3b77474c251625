"""What to know in ten seconds: the result, what to do next, and a traffic light for each run."""

from __future__ import annotations

import re

from daq import DataError
from wheelsoil.report.content import Block, Contents, Light, Lights, Text, section
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.verdict import fit_sentences, rank
from wheelsoil.report.words import count, listed
from wheelsoil.wording.notes import step_text
from wheelsoil.wording.verdict import sentences_of
from wheelsoil.workflows.grading import Grade

_WHY = 1
"""Reasons of a run that are listed here; data quality lists all."""
_MANY = 12
"""Runs beyond which good ones are not commented on."""


@section("glance", "In ten seconds")
def glance(material: ReportInputs) -> Contents:
    """Build the section; it is there whatever is missing."""
    grades = {run.run.id: grade for run, grade in zip(material.runs, material.grades, strict=True)}
    step = next_step(material, grades)
    many = len(grades) > _MANY
    lights = [
        Light(name, grade.level, "" if many and grade.level == "good" else _why(grade))
        for name, grade in grades.items()
    ]
    lead, *others = sentences = _sentences(material)
    blocks: list[Block] = [Text(lead, "lead"), Text(f"{step[0].upper()}{step[1:]}", "next")]
    blocks += [Lights("Runs", lights)] if lights else []
    below = [one for one in others if not (one.startswith("Next: ") and one[len("Next: ") : -1] in step)]
    blocks += [Text(" ".join(below))] if below else []
    return blocks, {"sentence": " ".join(sentences), "next_step": step, "grades": grades}


def _sentences(material: ReportInputs) -> list[str]:
    """Return the result: a diagnosis says its own, so that no fault in judging the fit can take it."""
    if material.diagnosed is not None:
        return sentences_of(material.diagnosed)
    if material.tables:
        return [f"No diagnosis: {material.no_diagnosis or 'none was asked for'}."]
    try:
        return fit_sentences(material, rank(material))
    except DataError as error:
        return [f"No result: {'; '.join(fault.what for fault in error.faults)}."]


def _why(grade: Grade) -> str:
    if grade.reasons:
        more = len(grade.reasons) - _WHY
        reasons = "; ".join(re.split("[:;] ", reason)[0] for reason in grade.reasons[:_WHY])
        return f"{reasons}; {count(more)} more" if more > 0 else reasons
    return f"{100 * grade.usable_share:.0f} % of motion usable, slip\u00a0to\u00a0{grade.highest_slip:.2f}"


def next_step(material: ReportInputs, grades: dict[str, Grade]) -> str:
    """Return the next step: repair what spoils runs, else the most informative run, else nothing."""
    poor = [name for name, grade in grades.items() if grade.level == "poor"]
    if poor:
        said = listed(poor) if len(poor) <= 5 else f"{len(poor)} of {len(grades)} runs"
        return f"look at data quality first; {said} {'is' if len(poor) == 1 else 'are'} poor."
    if material.campaign is None and not material.tables:
        return "see below why the runs could not be fitted."
    found = material.diagnosed
    if found is None and material.no_diagnosis:
        return "see below why there is no diagnosis."
    if found is None:
        return "`wheelsoil diagnose` says what the simulation gets wrong and why."
    if found.next_run:
        first = found.next_run[0]
        parted = listed([name.replace("_", " ") for name in first.separates])
        return f"{step_text(first)}{f' (separates {parted})' if parted else ''}."
    if found.verdict == "unexplained":
        return (
            "look at what is wrong, and where: nothing known explains it, so do not rely on the model there. "
            "Check zeros, signs and configuration first, and whether all runs are on one soil."
        )
    faulty = listed([cause.name.replace("_", " ") for cause in found.causes if cause.kind == "measurement"])
    if found.verdict == "named" and faulty:
        return (
            f"mend or correct what is measured ({faulty}) and look again; the extended model holds only for these runs."
        )
    if found.verdict == "named":
        return "take the extended model: `wheelsoil diagnose -o model.toml` keeps it for fit, simulate and report."
    return "no further run is asked for; see the minimum detectable effect."
