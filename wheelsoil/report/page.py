"""Sections -> one self-contained HTML page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files

from wheelsoil import __version__
from wheelsoil.report.content import Figure, Section


def render(title: str, subtitle: str, sections: Sequence[Section], *, made_at: str, json_name: str) -> str:
    """Return the page as HTML text; plotly.js is in it once, and it loads nothing from outside.

    Parameters
    ----------
    title, subtitle : str
    sections : sequence of Section
    made_at : str
        When the report was made, for the last line.
    json_name : str
        Name of the file that holds the numbers.
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
