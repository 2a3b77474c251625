"""Inputs for reports of the small campaign, a diagnosis for them, and the text of a section."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from diagnosis_samples import diagnosis

from daq.runs import open_runs
from model.diagnosis import Diagnosis
from processing import ProcessOptions
from wheelsoil.report import Report
from wheelsoil.report.content import Panels, Section, Table, Text
from wheelsoil.report.inputs import ReportInputs, source_of, versions
from wheelsoil.wording.figures import figure_value
from wheelsoil.workflows import fit_runs, process_runs
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.fit import FitChoices


def processed_of(campaign: Path) -> Processed:
    """Return the runs of a folder, processed."""
    return process_runs(open_runs([campaign]), ProcessOptions())


def material_of(processed: Processed, choices: FitChoices | None = None) -> ReportInputs:
    """Fit processed runs and return what their report is made from; there is no diagnosis."""
    fit = fit_runs(processed, choices or FitChoices(), None)
    sources = tuple(source_of(run) for run, _ in processed)
    runs = tuple(run for _, run in processed)
    return ReportInputs(runs, fit, "", processed[0][0].vehicle, fit.soil.name, sources, versions=versions())


@contextmanager
def diagnosed_by_hand(found: Diagnosis | None = None) -> Iterator[None]:
    """Have a report of driven runs take a diagnosis that is made by hand."""
    taken = found or diagnosis("named")
    with patch("wheelsoil.workflows.report.diagnose_campaigns", lambda *_: taken):
        yield


def text_of(report: Report, key: str) -> str:
    """Return all that a section says."""
    parts = []
    for block in section_of(report, key).blocks:
        if isinstance(block, Text):
            parts.append(block.text)
        elif isinstance(block, Table):
            parts += [block.caption, block.note]
        elif isinstance(block, Panels):
            parts.append(block.reading)
    return " ".join(parts)


def cells_of(section: Section) -> list[str]:
    """Return the cells of a section's tables as they are written."""
    tables = [block for block in section.blocks if isinstance(block, Table)]
    return [
        cell if isinstance(cell, str) else figure_value(cell) for table in tables for row in table.rows for cell in row
    ]


def section_of(report: Report, key: str) -> Section:
    """Return a section by its key."""
    return next(section for section in report.sections if section.key == key)
