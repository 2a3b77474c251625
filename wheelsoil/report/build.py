"""Building of the report: sections, one self-contained HTML page with its numbers as JSON, and a PDF."""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from daq import ConfigError, WheelsoilError
from wheelsoil import __version__
from wheelsoil.report.content import Figure, Section, SectionBuilder, Text, drawn, figures_of, texts_of
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections import OF_THE_DIAGNOSIS, SECTIONS, SECTIONS_OF_TABLES
from wheelsoil.to_json import plain

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

SCHEMA = "wheelsoil/report/1"
_NAMED = 8
"""Runs that the subtitle names."""

_log = logging.getLogger(__name__)


def render(title: str, subtitle: str, sections: Sequence[Section], *, made_at: str, json_name: str) -> str:
    """Return the page as HTML text; it contains plotly.js once and loads nothing from outside.

    `made_at` is the time of the report, for the last line; `json_name` the name of the file with the numbers.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from jinja2.utils import htmlsafe_json_dumps
    from plotly.offline import get_plotlyjs

    folder = files("wheelsoil.report")

    def figure_json(figure: Figure) -> str:
        shown = {"data": figure.data, "layout": figure.layout, "groups": figure.groups}
        return htmlsafe_json_dumps(shown, dumps=json.dumps, allow_nan=False, separators=(",", ":"))

    environment = Environment(
        loader=PackageLoader("wheelsoil.report", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("template.html.j2").render(
        title=title,
        subtitle=subtitle,
        sections=sections,
        made_at=made_at,
        json_name=json_name,
        version=__version__,
        plotly_js=get_plotlyjs(),
        figure_json=figure_json,
        style=folder.joinpath("page.css").read_text(encoding="utf-8"),
        script=folder.joinpath("page.js").read_text(encoding="utf-8"),
    )


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
    with tempfile.TemporaryDirectory(prefix="wheelsoil-") as folder:
        made = Path(folder) / "page.pdf"
        places = [f"--user-data-dir={folder}/profile", f"--print-to-pdf={made}", page.resolve().as_uri()]
        output_text = _run([browser, *_OPTIONS, *_sandbox(), *places])
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
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return f"no answer within {_PATIENCE_S} s"
    except OSError as error:
        return str(error)
    return done.stderr


def _sandbox() -> list[str]:
    """Return the option that root needs: Chromium's sandbox does not work for root; the page is our own file."""
    return ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []


@dataclass(frozen=True)
class Report:
    """A report that is ready to be written.

    Attributes
    ----------
    left_out : mapping key -> why
        Sections that could not be built; the page shows the reason in their place.
    not_fitted : str
        Runs without a needed signal, if others were fitted; a text.
    """

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    left_out: dict[str, str]
    made_at: datetime
    not_fitted: str = ""

    def numbers(self) -> dict[str, Any]:
        """Return every number of the report as JSON values: those of tables, texts and figures."""
        return {
            "schema": SCHEMA,
            "title": self.title,
            "made_at": self.made_at.isoformat(timespec="seconds"),
            "left_out": self.left_out,
            "not_fitted": self.not_fitted,
            "sections": {section.key: plain(section.numbers) for section in self.sections},
            "texts": {section.key: texts_of(section) for section in self.sections},
            "figures": {figure.key: drawn(figure) for section in self.sections for figure in figures_of(section)},
        }

    @property
    def sentence(self) -> str:
        """The result in one sentence, or why there is none."""
        verdict = self.numbers()["sections"].get("verdict", {})
        return str(verdict.get("sentence") or f"no result: {self.left_out.get('verdict', 'there is no verdict')}")

    def write(self, path: Path) -> tuple[Path, Path]:
        """Write the page, and its numbers as JSON beside it; return both paths."""
        numbers = path.with_suffix(".json")
        path.write_text(self.html(numbers.name), encoding="utf-8")
        self._write_numbers(numbers)
        return path, numbers

    def print(self, path: Path, browser: str) -> tuple[Path, Path]:
        """Write the page as a PDF (see `wheelsoil.report.build`), and its numbers beside it; return both paths."""
        numbers = path.with_suffix(".json")
        with TemporaryDirectory(prefix="wheelsoil-") as folder:
            page = Path(folder) / "report.html"
            page.write_text(self.html(numbers.name), encoding="utf-8")
            print_page(page, path, browser)
        self._write_numbers(numbers)
        return path, numbers

    def _write_numbers(self, path: Path) -> None:
        """Write the numbers as strict JSON; `numbers` has converted them already."""
        path.write_text(json.dumps(self.numbers(), ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")

    def html(self, json_name: str) -> str:
        """Return the page."""
        made_at = f"{self.made_at:%Y-%m-%d %H:%M} UTC"
        return render(self.title, self.subtitle, self.sections, made_at=made_at, json_name=json_name)


def build_report(material: ReportInputs) -> Report:
    """Build every section; a section that fails is replaced by the reason, and the others are not affected."""
    left_out: dict[str, str] = {}
    sections = []
    for builder in _asked_for(material):
        key = builder.key
        try:
            section = builder.build(material)
        except WheelsoilError as error:
            left_out[key] = "; ".join(fault.what for fault in error.faults)
        except Exception as error:  # noqa: BLE001 - an error in one section must not stop the report
            _log.debug("section %s", key, exc_info=True)
            left_out[key] = f"a fault in this section ({type(error).__name__}: {error}); please report it"
        if key in left_out:
            section = Section(key, builder.title, [Text(f"Omitted: {left_out[key]}.", "missing")])
        sections.append(section)
    terrain = material.terrain or "unknown terrain"
    return Report(
        title=f"Wheel–soil model: {terrain}",
        subtitle=_subtitle(material),
        sections=tuple(sections),
        left_out=left_out,
        made_at=datetime.now(UTC),
        not_fitted=material.not_fitted,
    )


def _asked_for(material: ReportInputs) -> list[SectionBuilder]:
    """Return the sections of the page."""
    diagnosed = material.diagnosed is not None or bool(material.no_diagnosis)
    sections = SECTIONS_OF_TABLES if material.tables else SECTIONS
    return [builder for builder in sections if diagnosed or builder not in OF_THE_DIAGNOSIS]


def _subtitle(material: ReportInputs) -> str:
    if material.tables:
        wheels = [
            f"{one.name} (r = {one.wheel.radius_m:g} m, b = {one.wheel.width_m:g} m, {len(one.rows)} rows)"
            for one in material.tables
        ]
        return f"single-wheel tests: {', '.join(wheels)}"
    count = len(material.runs)
    runs = f"{count} run{'s' if count != 1 else ''}"
    wheel = material.vehicle.wheel
    size = f", wheel r = {wheel.radius_m:g} m, b = {wheel.width_m:g} m" if wheel else ""
    names = [run.run.id for run in material.runs]
    listed = ", ".join(names) if count <= _NAMED else f"{', '.join(names[: _NAMED - 2])} … {names[-1]}"
    return f"{material.vehicle.vehicle.name}{size} · {runs}: {listed}"
