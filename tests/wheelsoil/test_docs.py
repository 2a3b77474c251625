"""The files that the docs show are right, and every key is shown."""

from __future__ import annotations

import ast
import importlib.util
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pydantic import BaseModel

from daq import RunsConfig, TerrainConfig, VehicleConfig, parse_toml
from model.effects import EFFECTS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
VEHICLE, WHEELS, TERRAIN, RUNS = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
BLOCKS: dict[type[BaseModel], str] = {VehicleConfig: VEHICLE, TerrainConfig: TERRAIN, RunsConfig: RUNS}


@pytest.mark.parametrize("kind", BLOCKS)
def test_the_reference_is_a_valid_file_that_shows_every_key(kind: type[BaseModel]) -> None:
    shown = parse_toml(BLOCKS[kind], kind, "docs/configuration.md")
    assert shown
    for section in kind.model_fields.values():
        for model in _models(section.annotation):
            for key in model.model_fields:
                assert key in PAGE, f"{model.__name__}.{key} is not in docs/configuration.md"


def test_the_example_of_several_wheels_is_a_valid_file() -> None:
    assert parse_toml(WHEELS, VehicleConfig, "docs/configuration.md").wheel_ids == ("FL",)


def _models(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in getattr(annotation, "__args__", ()) for m in _models(inner)]


MADE = {".git", ".hypothesis", ".mypy_cache", ".pytest_cache", ".ruff_cache", ".venv", ".venv-bench", "out"}
"""Folders that hold no page of ours, and many files."""


@pytest.mark.parametrize(
    "page",
    sorted(
        page.relative_to(ROOT).as_posix()
        for place in ROOT.iterdir()
        if place.name not in MADE
        for page in (place.rglob("*.md") if place.is_dir() else [place])
        if page.suffix == ".md"
    ),
)
def test_links_between_pages_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for target, heading in re.findall(r"\]\(([^)#]*)(?:#([^)]*))?\)", text):
        if "://" in target:
            continue
        file = (ROOT / page).parent / target if target else ROOT / page
        assert file.exists(), f"{page}: {target}"
        assert not heading or heading in _headings(file), f"{page}: {target}#{heading}"


def _headings(page: Path) -> list[str]:
    """Return the anchors of a page's headings, as the hosting site makes them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


PAGES = sorted(
    page.relative_to(ROOT).as_posix()
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md"))
)


@pytest.mark.parametrize("page", PAGES)
def test_files_that_a_page_names_are_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    folders = "daq|processing|model|wheelsoil|tests|docs|dbc|recordings|benchmarks|studies|deploy|examples"
    named = re.findall(rf"`((?:{folders})/[\w/.-]+)`", text)
    named = [name for name in named if not re.search("[A-Z]{3}", Path(name).stem) and not name[-1].isdigit()]
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("room", ["daq", "processing", "model", "wheelsoil"])
def test_names_in_docstrings_lead_somewhere(room: str) -> None:
    """Texts that stand alone count too: they describe constants."""
    said = {
        name
        for file in (ROOT / room).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for name in re.findall(r"`((?:daq|processing|model|wheelsoil)(?:\.\w+)+)", node.value.value)
    }
    assert said
    assert sorted(name for name in said if not _leads_somewhere(name)) == []


def _leads_somewhere(name: str) -> bool:
    if name.endswith(".toml") or name == "wheelsoil.effects":  # a file; the group of entry points for effects
        return True
    found, _, rest = name.partition(".")
    thing: Any = importlib.import_module(found)
    for part in rest.split("."):
        found = f"{found}.{part}"
        if not hasattr(thing, part) and isinstance(thing, ModuleType) and _is_module(found):
            importlib.import_module(found)
        if not hasattr(thing, part):
            return part in getattr(thing, "__dataclass_fields__", {})
        thing = getattr(thing, part)
    return True


def _is_module(name: str) -> bool:
    return importlib.util.find_spec(name) is not None


def test_the_readme_counts_the_families_of_the_library() -> None:
    kinds = {effect.name: (effect.kind, effect.reading) for effect in EFFECTS.values()}
    physical, measurement = ([kind for kind, _ in kinds.values()].count(kind) for kind in ("physical", "measurement"))
    assert [reading for _, reading in kinds.values() if reading != "any"] == ["literal"]
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert f"[{len(kinds)} families of causes](docs/effects/README.md) (one only under `--sinkage literal`)" in readme
    assert f"{physical} in soil and wheel and {measurement} in the measurement" in readme


def test_the_readme_quotes_the_worst_figures_of_the_blind_study() -> None:
    page = (ROOT / "docs" / "blind_results.md").read_text()
    wrong = re.findall(r"^\| (\w+) \| (left_out|outside) \| [\w, ]+ \| (\d+) \|$", page, re.MULTILINE)
    times = {kind: sum(int(count) for _, one, count in wrong if one == kind) for kind in ("left_out", "outside")}
    of = {kind: re.search(rf"(\d+) {kind}", page)[1] for kind in times}  # type: ignore[index]
    row = r"^\| {}.*?\((\d+)\) \| (\d+) \|"
    right, named = re.search(row.format("names right over all campaigns"), page, re.MULTILINE).groups()  # type: ignore[union-attr]
    listed = re.search(row.format("names right, listed causes"), page, re.MULTILINE)[2]  # type: ignore[index]
    readme = " ".join((ROOT / "README.md").read_text().split())
    assert f"{right} of {named} names were right" in readme
    assert f"{right} of {listed} names with a posterior probability" in readme
    assert f"{times['left_out']} of {of['left_out']} campaigns" in readme
    assert f"{times['outside']} of {of['outside']} with a cause from outside" in readme
