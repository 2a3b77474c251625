"""Runs the notebooks and keeps what they show, plotly's figures as pictures (`make notebooks`)."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import nbformat
from live_browser import chromium
from nbclient import NotebookClient
from playwright.sync_api import Page
from plotly.offline import get_plotlyjs

EXAMPLES = Path(__file__).parents[1] / "examples"
PLOTLY = "application/vnd.plotly.v1+json"
_IMAGE = """async (text) => {
  const { data, layout } = JSON.parse(text);
  return (await Plotly.toImage({ data, layout }, { format: "png", width: 760, height: 420 })).split(",")[1];
}"""


def executed(name: str) -> nbformat.NotebookNode:
    """Return a notebook with what its cells show."""
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    resources = {"metadata": {"path": str(EXAMPLES)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    return notebook


def with_picture(data: dict[str, Any], page: Page) -> dict[str, Any]:
    """Return the data of an output with a picture in place of plotly's figure, and no long text beside a table."""
    if PLOTLY not in data:
        return {kind: value for kind, value in data.items() if kind != "text/plain" or "text/html" not in data}
    picture = page.evaluate(_IMAGE, json.dumps(data[PLOTLY]))
    assert base64.b64decode(picture).startswith(b"\x89PNG")
    return {"image/png": picture, "text/plain": "a figure of plotly; run the cell to move in it"}


def main() -> None:
    """Run every notebook and write it anew."""
    with chromium() as browser:
        page = browser.new_page()
        page.add_script_tag(content=get_plotlyjs())
        for path in sorted(EXAMPLES.glob("*.ipynb")):
            notebook = executed(path.name)
            for output in (output for cell in notebook.cells for output in cell.get("outputs", [])):
                if "data" in output:
                    output["data"] = with_picture(output["data"], page)
            nbformat.write(notebook, path)
            print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
