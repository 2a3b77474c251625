"""One contract for every section of the report: what it is, what it shows, that it survives poor material."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules

import numpy as np
import pytest
from diagnosis_samples import diagnosis

import wheelsoil.report.sections
from daq import WheelsoilError
from daq.runs import open_runs
from processing import ProcessOptions
from wheelsoil.report.content import Panels, Section, SectionBuilder, Table
from wheelsoil.report.inputs import ReportInputs, source_of, versions
from wheelsoil.report.sections import EVIDENCE, GROUPS, OF_THE_DIAGNOSIS, SECTIONS, SECTIONS_OF_TABLES, glance
from wheelsoil.to_json import to_json
from wheelsoil.workflows import fit_runs, process_runs
from wheelsoil.workflows.fit import FitChoices
from wheelsoil.workflows.last_report import LastReport

NUMBER = re.compile(r"[<>±+−-]?\s?[\d.,\u202f]+.*|[–-]$|∞$|not counted|unknown|not detectable in these data|above \d")
every_section = pytest.mark.parametrize("builder", SECTIONS, ids=lambda builder: builder.key)


@pytest.fixture(scope="module")
def whole(campaign) -> ReportInputs:
    processed = process_runs(open_runs([campaign]), ProcessOptions())
    return ReportInputs(
        runs=tuple(run for _, run in processed),
        campaign=fit_runs(processed, FitChoices(), None),
        no_fit="",
        vehicle=processed[0][0].vehicle,
        terrain="clay",
        sources=tuple(source_of(run) for run, _ in processed),
        versions=versions(),
        diagnosed=diagnosis("named"),
        last=LastReport("last.json", "2026-05-04T10:00:00", "Clay", ()),
    )


def test_every_section_of_every_file_is_listed():
    package = wheelsoil.report.sections
    modules = [import_module(f"{package.__name__}.{one.name}") for one in iter_modules(package.__path__)]
    written = [[one for one in vars(module).values() if isinstance(one, SectionBuilder)] for module in modules]
    assert all(written), "a file without a section"
    assert {one for ones in written for one in ones} == {*SECTIONS, *SECTIONS_OF_TABLES}
    assert len({one.key for one in SECTIONS}) == len({one.title for one in SECTIONS}) == len(SECTIONS)
    assert len({one.key for one in SECTIONS_OF_TABLES}) == len(SECTIONS_OF_TABLES)
    assert set(OF_THE_DIAGNOSIS) <= set(SECTIONS)
    grouped = [one for group in GROUPS.values() for one in group]
    assert {*grouped, *EVIDENCE, glance.glance} == {*SECTIONS, *SECTIONS_OF_TABLES}, "all of the appendix is in a group"
    assert len(grouped) == len(set(grouped))


@every_section
def test_it_says_what_it_is_and_how_to_read_it(builder, whole):
    assert builder.contents.__doc__
    section = builder.build(whole)
    assert isinstance(section, Section) and section.key == builder.key and section.title == builder.title
    assert section.blocks
    for block in section.blocks:
        if isinstance(block, Table):
            assert all(len(row) == len(block.head) for row in block.rows)
            check_columns(block)
        if isinstance(block, Panels):
            assert not block.reading[0].isupper() or block.reading.startswith("R₀"), "it follows 'How to read:'"
            assert block.reading.endswith(".")
            for figure in block.figures:
                check_figure(figure)
    json.loads(to_json(section.numbers))


def check_columns(table: Table) -> None:
    """A column is declared as words where it holds any: no page guesses it from the cells."""
    assert set(table.words) <= set(table.head)
    for title, cells in list(zip(table.head, zip(*table.rows, strict=True), strict=False))[table.left :]:
        texts = [cell for cell in cells if isinstance(cell, str) and cell]
        if title not in table.words:
            assert all(NUMBER.match(cell) for cell in texts), (table.caption, title, texts)


def check_figure(figure) -> None:
    assert figure.title and figure.data
    assert not figure.groups or len(figure.groups) == len(figure.data)
    for axis in ("xaxis", "yaxis"):
        drawn = figure.layout[axis]
        assert drawn["title"] or drawn.get("order"), figure.key
    assert all(trace["name"] for trace in figure.data), "every trace says what it is"


@every_section
def test_it_is_built_or_left_out_with_a_reason(builder, whole):
    def nothing(run):
        return np.full(len(run), np.nan)

    bare = [
        replace(run, drawbar_pull_n=nothing(run), driving_torque_nm=nothing(run), sinkage_m=nothing(run))
        for run in whole.runs
    ]
    poor = (
        replace(whole, runs=tuple(bare), campaign=None, no_fit="nothing to fit", diagnosed=None, no_diagnosis="no"),
        replace(whole, diagnosed=replace(diagnosis("nothing_detectable"), plot_data=(), gain=None, candidates=())),
        replace(whole, diagnosed=diagnosis("unexplained")),
    )
    for material in poor:
        try:
            section = builder.build(material)
        except WheelsoilError as error:
            assert str(error).strip()
        else:
            assert section.blocks
