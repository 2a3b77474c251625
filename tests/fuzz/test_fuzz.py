"""Damaged files are our errors or remarks: some in the fast set, 5,000 in the slow one, 20,000 by `make fuzz`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("count", "first"), [(200, 10**6), pytest.param(2_500, 0, marks=pytest.mark.slow)])
def test_no_reader_has_a_defect(count: int, first: int) -> None:
    command = [sys.executable, "-m", "fuzz.run", "--count", str(count), "--first-seed", str(first)]
    paths = os.pathsep.join([str(ROOT / "tests"), str(ROOT)])
    done = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
