"""Building of the report: sections, one self-contained HTML page with its numbers as JSON, and a PDF."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import subprocess
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from daq import ConfigError, DataError, WheelsoilError
from daq.runs import SetAsideRun
from daq.series import write_whole
from wheelsoil import __version__
from wheelsoil.report.content import (
    Links,
    Section,
    SectionBuilder,
    Table,
    Text,
    drawings_of,
    drawn,
    figures_of,
    texts_of,
)
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections import GROUPS, OF_THE_DIAGNOSIS, SECTIONS, SECTIONS_OF_TABLES
from wheelsoil.report.sections.glance import header_facts
from wheelsoil.to_json import plain
from wheelsoil.web.bidi import in_texts, isolated
from wheelsoil.wording.change_text import of_the_same
from wheelsoil.wording.figures import figure_value
from wheelsoil.wording.names import OMITTED, upper
from wheelsoil.wording.numbers import typeset, unbroken
from wheelsoil.wording.verdict import groups_of_runs

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
"""Names of browsers on the PATH, in order of preference."""
_OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--no-pdf-header-footer",
    "--virtual-time-budget=20000",
)
_PATIENCE_S = 180

SCHEMA, SCHEMA_OF_A_VEHICLE = "wheelsoil/report/2", "wheelsoil/vehicle/1"
"""What `numbers` holds, and of which version: of a report, and of a vehicle's page."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Head:
    """The head of the page: title, vehicle, what is known of the day, and how many runs can be used."""

    title: str
    subtitle: str
    facts: Sequence[tuple[str, str]] = ()
    badge: tuple[str, str] | None = None
    configuration: str = ""


def render(head: Head, sections: Sequence[Section], *, made_at: str, json_name: str) -> str:
    """Return the page as HTML text, with its one script; it loads nothing from outside.

    `made_at` is the time of the report; `json_name` the name of the file with the numbers.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    pages, shared = files("wheelsoil.report"), files("wheelsoil.web") / "static"
    environment = Environment(
        loader=PackageLoader("wheelsoil.report", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    summary, *others = sections
    keys = {name: {builder.key for builder in group} for name, group in GROUPS.items()}
    groups = {name: [section for section in others if section.key in of_group] for name, of_group in keys.items()}
    appendix = {name: sections for name, sections in groups.items() if sections}
    style = "".join(file.read_text(encoding="utf-8") for file in (shared / "tokens.css", pages / "page.css"))
    scripts = (shared / "drawing.js", pages / "figure.js", pages / "page.js")
    script = "\n".join(file.read_text(encoding="utf-8") for file in scripts)
    page = environment.get_template("template.html.j2").render(
        **vars(head),
        summary=summary,
        evidence=[section for section in others if not any(section.key in of_group for of_group in keys.values())],
        appendix=appendix,
        made_at=made_at,
        json_name=json_name,
        version=__version__,
        script=script,
        script_hash=b64encode(sha256(script.encode()).digest()).decode(),  # the page's policy: no other script runs
        text_columns=_text_columns,
        figure_value=figure_value,
        unbroken=_unbroken,
        json=_json,
        figure_json=lambda figure: _json({"data": figure.data, "layout": figure.layout, "groups": figure.groups}),
        drawing_json=lambda drawing: _json({"title": drawing.title, "curves": plain(drawing.curves)}),
        style=style,
    )
    return isolated(in_texts(page, lambda text: unbroken(typeset(text))))


def _text_columns(table: Table) -> set[int]:
    """Return the columns that are read as words."""
    return {i for i, title in enumerate(table.head) if i < table.left or title in table.words}


def _unbroken(code: str) -> str:
    """Return what is to be pasted as HTML that breaks no option in two."""
    from markupsafe import Markup, escape

    whole = Markup('<span class="whole">{}</span>')
    parts = re.split(r"((?<!\S)-[\w-]+)", code)
    return Markup("").join(whole.format(part) if i % 2 else escape(part) for i, part in enumerate(parts))


def _json(values: Any) -> str:
    from jinja2.utils import htmlsafe_json_dumps

    return htmlsafe_json_dumps(values, dumps=json.dumps, allow_nan=False, separators=(",", ":"))


class PrintError(WheelsoilError, RuntimeError):
    """The browser created no PDF."""


def find_browser() -> str:
    """Return the path of a browser that can print; `ConfigError` if none is installed."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise ConfigError.of(
            "no browser that can create a PDF",
            "PATH",
            expected=f"one of {', '.join(BROWSERS)}",
            next_step="apt-get install chromium; or write the page (-o report.html), open it and print it",
        )
    return found


def print_page(page: Path, output: Path, browser: str) -> None:
    """Print an HTML file that needs no network to an A4 PDF with page numbers; `PrintError` if none was created."""
    with TemporaryDirectory(prefix="wheelsoil-", ignore_cleanup_errors=True) as folder:
        made = Path(folder) / "page.pdf"
        places = [f"--user-data-dir={folder}/profile", f"--print-to-pdf={made}", page.resolve().as_uri()]
        # Chromium's sandbox does not work for root; the page is our own file.
        sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
        output_text = _run([browser, *_OPTIONS, *sandbox, *places])
        if not made.is_file() or not made.read_bytes().startswith(b"%PDF"):
            raise PrintError.of(
                "the browser created no PDF",
                browser,
                found=output_text.strip().splitlines()[-1][:200] if output_text.strip() else "no message",
                next_step="write the page (-o report.html), open it and print it",
            )
        shutil.copyfile(made, output)


def _run(command: list[str]) -> str:
    """Run a browser to its end and return its messages."""
    try:
        done = subprocess.run(command, capture_output=True, timeout=_PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return f"no answer within {_PATIENCE_S} s"
    except OSError as error:
        return str(error)
    return done.stderr.decode(errors="replace")


@dataclass(frozen=True)
class Report:
    """A report that is ready to be written.

    Attributes
    ----------
    left_out : mapping key -> why
        Sections that could not be built; the page shows the reason in their place.
    not_fitted : str
        Runs without a needed signal, if others were fitted; a text.
    failed : tuple of str
        What a fault has cost, and not the measurement: keys of sections, "diagnosis".
    set_aside : tuple of SetAsideRun
        Runs that were given and are not used.
    wheels : tuple of mapping
        Of a vehicle's page: each wheel with its report.
    has_result : bool
        There is a fit, a diagnosis or a table.
    """

    head: Head
    sections: tuple[Section, ...]
    left_out: dict[str, str]
    made_at: datetime
    not_fitted: str = ""
    failed: tuple[str, ...] = ()
    set_aside: tuple[SetAsideRun, ...] = ()
    wheels: tuple[dict[str, Any], ...] = ()
    has_result: bool = True

    def numbers(self) -> dict[str, Any]:
        """Return every number of the report as JSON values: those of tables, texts and figures."""
        return {
            "schema": SCHEMA if not self.wheels else SCHEMA_OF_A_VEHICLE,
            **({"wheels": plain(self.wheels)} if self.wheels else {}),
            "title": self.head.title,
            "head": vars(self.head),
            "made_at": self.made_at.isoformat(timespec="seconds"),
            **dict.fromkeys(OMITTED, self.left_out),
            "not_fitted": self.not_fitted,
            "failed": self.failed,
            "runs_set_aside": [run.facts() for run in self.set_aside],
            "sections": {section.key: plain(section.numbers) for section in self.sections},
            "texts": {section.key: texts_of(section) for section in self.sections},
            "figures": {figure.key: drawn(figure) for section in self.sections for figure in figures_of(section)},
            "drawings": {
                drawing.key: {"title": drawing.title, "curves": plain(drawing.curves)}
                for section in self.sections
                for drawing in drawings_of(section)
            },
        }

    @property
    def sentence(self) -> str:
        """The result in one sentence, or why there is none."""
        sections = self.numbers()["sections"]
        verdict = sections["glance"] if self.wheels else sections.get("verdict", {})
        return str(verdict.get("sentence") or f"no result: {self.left_out.get('verdict', 'there is no verdict')}")

    def write(self, path: Path) -> tuple[Path, Path]:
        """Write the page, and its numbers as JSON beside it; return both paths."""
        numbers = path.with_suffix(".json")
        write_whole(path, self.html(numbers.name))
        self._write_numbers(numbers)
        return path, numbers

    def print(self, path: Path, browser: str) -> tuple[Path, Path]:
        """Write the page as a PDF (see `wheelsoil.report.build`), and its numbers beside it; return both paths."""
        numbers = path.with_suffix(".json")
        with TemporaryDirectory(prefix="wheelsoil-") as folder:
            page = Path(folder) / "report.html"
            write_whole(page, self.html(numbers.name))
            print_page(page, path, browser)
        self._write_numbers(numbers)
        return path, numbers

    def _write_numbers(self, path: Path) -> None:
        """Write the numbers as strict JSON; `numbers` has converted them already."""
        text = json.dumps(self.numbers(), ensure_ascii=False, allow_nan=False) + "\n"
        write_whole(path, text, "backslashreplace")

    def html(self, json_name: str) -> str:
        """Return the page."""
        made_at = f"{self.made_at:%Y-%m-%d %H:%M} UTC"
        return render(self.head, self.sections, made_at=made_at, json_name=json_name)


def build_report(inputs: ReportInputs) -> Report:
    """Build every section; a section that fails is replaced by the reason, and the others are not affected."""
    omitted: dict[str, str] = {}
    failed = ["diagnosis"] if inputs.diagnosis_failed else []
    sections = []
    for builder in _asked_for(inputs):
        key = builder.key
        try:
            section = builder.build(inputs)
        except WheelsoilError as error:
            omitted[key] = error.what
            failed += [] if isinstance(error, DataError) else [key]
        except Exception as error:  # noqa: BLE001 - an error in one section must not stop the report
            _log.debug("section %s", key, exc_info=True)
            omitted[key] = f"a fault in this section ({type(error).__name__}: {error}); please report it"
            failed.append(key)
        if key in omitted:
            section = Section(key, builder.title, [Text(f"Omitted: {omitted[key]}.", "missing")])
        sections.append(section)
    lead, line = _change_of(sections)
    with_change = [_told(section, lead, line) for section in sections]
    return Report(
        head=_head(inputs),
        sections=tuple(with_change),
        left_out=omitted,
        made_at=datetime.now(UTC),
        not_fitted=inputs.not_fitted,
        failed=tuple(failed),
        set_aside=inputs.set_aside,
        has_result=bool(inputs.tables or inputs.campaign or inputs.diagnosed),
    )


def _change_of(sections: Sequence[Section]) -> tuple[str, tuple[str, str, str]]:
    """Return what has changed beyond the intervals: a sentence of the summary, and a line of the answers."""
    question = "What has changed?"
    found = next((section.numbers for section in sections if section.key == "against" and section.numbers), None)
    if found is None:
        return "", (question, "Not known: no earlier report was given (report FOLDER --against LAST).", "")
    change, other = found["differing"], found["another_thing"]
    whole = of_the_same(f"{upper(change)}." if change else "Nothing beyond the intervals.", other)
    lead = f"{f'{upper(other)}. Since then' if other else 'Since last time'}: {change}." if change else ""
    return lead, (question, whole, "#against")


def _told(section: Section, sentence: str, line: tuple[str, str, str]) -> Section:
    """Return the summary with a sentence in its lead, the answers with one more; any other section as it is."""
    blocks = [
        replace(block, text=f"{block.text} {sentence}".strip())
        if isinstance(block, Text) and block.kind == "lead"
        else replace(block, lines=[*block.lines, line])
        if isinstance(block, Links)
        else block
        for block in section.blocks
    ]
    return replace(section, blocks=blocks)


def _asked_for(inputs: ReportInputs) -> list[SectionBuilder]:
    """Return the sections of the page."""
    diagnosed = inputs.diagnosed is not None or bool(inputs.no_diagnosis)
    sections = SECTIONS_OF_TABLES if inputs.tables else SECTIONS
    found = inputs.diagnosed
    without = [] if diagnosed else [builder.key for builder in OF_THE_DIAGNOSIS]
    without += [] if found is not None and found.verdict == "named" else ["cost"]
    without += [] if inputs.last is not None else ["against"]
    return [builder for builder in sections if builder.key not in without]


def _head(inputs: ReportInputs) -> Head:
    terrain = inputs.terrain or "unknown terrain"
    values = json.dumps([inputs.vehicle.model_dump(mode="json"), plain(inputs.options)], sort_keys=True)
    return Head(
        title=f"{terrain[0].upper()}{terrain[1:]}",
        subtitle=_subtitle(inputs),
        facts=header_facts(inputs),
        badge=_badge(inputs),
        configuration=sha256(values.encode()).hexdigest()[:8],
    )


def _badge(inputs: ReportInputs) -> tuple[str, str] | None:
    levels = [grade.level for grade in inputs.grades]
    if not levels:
        return None
    poor = levels.count("poor")
    level = "good" if not poor and not inputs.set_aside else "fair" if poor < len(levels) else "poor"
    apart = inputs.several_terrains is not None or groups_of_runs(inputs.diagnosed) is not None
    level = "fair" if (apart or inputs.to_check) and level == "good" else level
    sign = {"good": "✓", "fair": "▲", "poor": "✕"}[level]
    doubt = ", probably not of one soil" if apart else f", {len(inputs.to_check)} to check" if inputs.to_check else ""
    return level, f"{sign} {inputs.usable_runs}{doubt}"


def _subtitle(inputs: ReportInputs) -> str:
    if inputs.tables:
        wheels = [
            f"{table.name} (r = {table.wheel.radius_m:g} m, b = {table.wheel.width_m:g} m, {len(table.rows)} rows)"
            for table in inputs.tables
        ]
        return f"single-wheel tests: {', '.join(wheels)}"
    wheel = inputs.vehicle.wheel
    place = f", {wheel.position} wheel" if wheel and wheel.position else ""
    return f"{inputs.vehicle.vehicle.name}{place}"
