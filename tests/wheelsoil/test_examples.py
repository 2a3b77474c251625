"""The notebooks run from the first cell to the last, as a newcomer runs them."""

from __future__ import annotations

import base64
import re
from html import unescape
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = sorted(path.name for path in EXAMPLES.glob("*.ipynb"))
PLOTLY = "application/vnd.plotly.v1+json"


@pytest.fixture
def execute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Return a function that runs a notebook and returns what its cells show; nothing is left outside `tmp_path`."""
    for name in ("JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR", "TMPDIR"):
        monkeypatch.setenv(name, str(tmp_path))

    def run(name: str) -> list[dict[str, Any]]:
        notebook = nbformat.read(EXAMPLES / name, as_version=4)
        resources = {"metadata": {"path": str(EXAMPLES)}}
        NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
        outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
        return [output.get("data") or {"text/plain": output["text"]} for output in outputs]

    return run


def test_there_are_three():
    assert [name[:2] for name in NAMES] == ["01", "02", "03"]


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_kept_with_what_it_shows_and_no_paths(name):
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    nbformat.validate(notebook)
    assert notebook.cells[0].cell_type == "markdown"
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    assert not re.search(r"(?<![.\w<])/(home|work|tmp|root|usr)\b", text) and "Traceback" not in text
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    kinds = [set(output.get("data", {})) for output in outputs]
    assert any("image/png" in one for one in kinds) and any("text/html" in one for one in kinds)
    assert len(text) < 400_000


def test_the_first_notebook_tells_what_it_finds():
    text = (EXAMPLES / "01_first_run.ipynb").read_text(encoding="utf-8")
    assert "Here it names slip sinkage, most probably after Lyasko" in text
    assert "Slip sinkage explains the misfit" in text


@pytest.mark.slow
def test_first_run(execute):
    shown = execute("01_first_run.ipynb")
    tables, figures = pages(shown), drawn(shown)
    assert len(tables) == 6 and len(figures) == 3
    assert "virtual test vehicle" in tables[0]
    assert "driving torque kNm" in tables[1]
    assert "lyasko" in tables[2] and "chosen" not in tables[2]
    assert "M0_percent" in tables[3] and "lyasko" in tables[3]
    assert "slip sinkage" in tables[4]
    assert "chosen" in tables[5]
    assert len(figures[2]["data"]) == 6 + 4
    verdict = unescape(re.search(r"<p>(.*?)</p>", tables[4]).group(1))
    assert shown[-1]["text/plain"].strip("'\"").startswith(verdict.partition(" (")[0])


@pytest.mark.slow
def test_your_own_vehicle(execute):
    shown = execute("02_your_vehicle.ipynb")
    tables, (figure,) = pages(shown), drawn(shown)
    assert any("nearest: GPS_SPEED.OVER_GROUND" in one["text/plain"] for one in shown)
    assert "my vehicle" in tables[0] and "vasilev" in tables[2]
    load = values(figure["data"][0]["y"])
    assert 5_000 < np.median(load) < 20_000
    assert "monday.mcap" in tables[3]


@pytest.mark.slow
def test_your_own_effect(execute):
    shown = execute("03_your_effect.ipynb")
    tables = pages(shown)
    assert re.search("<p>Headwind (acts|explains the misfit)", tables[0]) and "verdict: named" in tables[0]
    assert "headwind.drag" in tables[1]
    low, high = map(float, re.search(r"\((\S+) to (\S+)\)", shown[-1]["text/plain"]).groups())
    assert low < 8.0 < high


def pages(shown: list[dict[str, Any]]) -> list[str]:
    """Return the HTML of results, without the figures'."""
    return [one["text/html"] for one in shown if "text/html" in one and PLOTLY not in one]


def drawn(shown: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the figures; each trace has data."""
    figures = [one[PLOTLY] for one in shown if PLOTLY in one]
    assert all(len(values(trace["y"])) > 10 for figure in figures for trace in figure["data"])
    return figures


def values(array: Any) -> np.ndarray:
    """Return the numbers of a plotly array, which may be packed."""
    if isinstance(array, dict):
        return np.frombuffer(base64.b64decode(array["bdata"]), array["dtype"])
    return np.array(array, dtype=float)
