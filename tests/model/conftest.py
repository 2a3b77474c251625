"""Where simulated runs are kept for all workers."""

from __future__ import annotations

from collections.abc import Iterator

import kept_runs
import pytest


@pytest.fixture(scope="session", autouse=True)
def _kept_runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    kept_runs.FACTORIES.append(tmp_path_factory)
    yield
    kept_runs.FACTORIES.clear()
