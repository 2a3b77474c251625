"""The files that the docs show are right, and every key is shown."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from daq.config import RunsConfig, TerrainConfig, VehicleConfig, parse_toml

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
BLOCKS = dict(
    zip((VehicleConfig, TerrainConfig, RunsConfig), re.findall(r"```toml\n(.*?)```", PAGE, re.S), strict=True)
)


@pytest.mark.parametrize("kind", BLOCKS)
def test_the_reference_is_a_valid_file_that_shows_every_key(kind: type[BaseModel]) -> None:
    shown = parse_toml(BLOCKS[kind], kind, "docs/configuration.md")
    assert shown
    for section in kind.model_fields.values():
        for model in _models(section.annotation):
            for key in model.model_fields:
                assert key in PAGE, f"{model.__name__}.{key} is not in docs/configuration.md"


def _models(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in getattr(annotation, "__args__", ()) for m in _models(inner)]


@pytest.mark.parametrize(
    "page", sorted(p.relative_to(ROOT).as_posix() for p in ROOT.glob("**/*.md") if ".venv" not in p.as_posix())
)
def test_links_between_pages_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text):
        if "://" not in target:
            assert (ROOT / page).parent.joinpath(target).exists(), f"{page}: {target}"


@pytest.mark.parametrize(
    "page", ["CONTRIBUTING.md", "docs/architecture.md", "docs/effects/README.md", "docs/testing.md"]
)
def test_files_that_a_page_names_are_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    named = re.findall(r"`((?:daq|processing|model|wheelsoil|tests|docs)/[\w/.]+)`", text)
    assert named
    assert [name for name in named if not re.search("[A-Z]{3}", Path(name).stem) and not (ROOT / name).exists()] == []
