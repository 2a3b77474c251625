"""A fleet of six campaigns, a table and a broken campaign, and the store of all of it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pytest
from cli_support import invoke
from fleet_support import in_one_process, rows_of, small_fleet
from shared_results import made_once


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the root of the fleet. Not to be written to."""
    return made_once(tmp_path_factory, "fleet", lambda folder: small_fleet(folder / "field")) / "field"


@pytest.fixture(scope="session")
def store(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store of the fleet, made by processes of this machine. Not to be written to."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("WHEELSOIL_CACHE", str(folder / "kept"))
            made = invoke("fleet", "run", fleet, "--store", folder / "store", "--jobs", 2)
        assert made.code == 1, made.err  # one is broken
        assert made.err.count("done, ") == 7 and "1 failed" in made.err
        assert "done, named: " in made.err or "done, one of several: " in made.err, made.err

    return made_once(tmp_path_factory, "fleet-store", make) / "store"


@pytest.fixture(scope="session")
def whole(store: Path) -> dict[str, pa.Table]:
    """Return every table of the store."""
    return rows_of(store)


@pytest.fixture
def warm(store: Path, place: Path) -> Path:
    """Keep the diagnoses of the fleet for a test: its calls do all the rest. Return the folder."""
    return Path(shutil.copytree(store.parent / "kept", place))


@pytest.fixture
def one_process() -> Iterator[None]:
    """Have `fleet run` work in this process for a test."""
    with in_one_process():
        yield
