"""Nothing that a result depends on can change without its key: options, inputs, code, effects of other packages."""

from __future__ import annotations

import copy
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import small_campaign
from pydantic import BaseModel
from short_campaign import driven

from daq import zeros_toml
from daq.runs import Run, open_runs
from model import ExtendedEffect, ExtendedModel
from model.diagnosis import DiagnosisOptions
from model.fit import FitOptions
from model.wheel_soil import SOILS, Wheel, prior_of
from processing import ProcessOptions
from wheelsoil.cache.codec import NotKeptError
from wheelsoil.cache.keys import OF_MODELS, OF_PROCESSING, key_of
from wheelsoil.workflows.kept_runs import KeptRun, place_of

ROOT = Path(__file__).parents[2]
HEADWIND = (ROOT / "docs" / "effects" / "README.md").read_text().split("```python\n")[1].split("```")[0]


def changes(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield copies of a value, in each of which one leaf is another; the name of the leaf first."""
    if isinstance(value, Enum):
        yield at, next(member for member in type(value) if member is not value)
    elif isinstance(value, bool):
        yield at, not value
    elif isinstance(value, int | float):
        yield at, value + 1 if value == value else 0.0
    elif isinstance(value, str):
        yield at, f"{value}x"
    elif value is None:
        yield at, 1.0
    elif isinstance(value, np.ndarray):
        changed = value.copy()
        changed.reshape(-1)[-1] = 7 if changed.reshape(-1)[-1] != 7 else 8
        yield at, changed
    elif isinstance(value, tuple):
        yield f"{at}+", (*value, 1)
        for i, one in enumerate(value):
            yield from ((name, (*value[:i], new, *value[i + 1 :])) for name, new in changes(one, f"{at}[{i}]"))
    elif isinstance(value, dict):
        yield f"{at}+", value | {"another": 1}
        for key, one in value.items():
            yield from ((name, value | {key: new}) for name, new in changes(one, f"{at}[{key}]"))
    else:
        assert is_dataclass(value) or isinstance(value, BaseModel), f"{at}: say here how {type(value)} changes"
        names = type(value).model_fields if isinstance(value, BaseModel) else [field.name for field in fields(value)]
        for name in names:
            for where, new in changes(getattr(value, name), f"{at}.{name}"):
                changed = copy.copy(value)
                object.__setattr__(changed, "__dict__", vars(value) | {name: new})
                yield where, changed


EXTENDED = ExtendedModel(Wheel(0.47, 0.318), SOILS["clay"], (ExtendedEffect("lyasko", {"m1": 0.1, "m2": 0.2}),))
INPUTS = {
    "diagnosis options": lambda: DiagnosisOptions(effects=("lyasko", "slope")),
    "fit options": lambda: FitOptions(soil_prior=prior_of(SOILS["clay"]), extended=EXTENDED, chosen=("ding",)),
    "campaign": lambda: driven(runs=2),
}


@pytest.mark.parametrize("name", INPUTS)
def test_every_leaf_of_the_inputs_is_in_the_key(name: str) -> None:
    inputs = INPUTS[name]()
    keys = {"": key_of("x", OF_PROCESSING, inputs)}
    for at, changed in changes(inputs):
        keys[at] = key_of("x", OF_PROCESSING, changed)
    assert len(keys) > len(fields(inputs))
    assert len(set(keys.values())) == len(keys), "no two are the same"
    assert {at.split(".")[1].split("[")[0].rstrip("+") for at in keys if at} == {f.name for f in fields(inputs)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign of one run, which tests copy."""
    return small_campaign(tmp_path_factory.mktemp("keys") / "clay", runs=1, duration_s=15.0)


def name_of(folder: Path, options: ProcessOptions | None = None, zero: Path | None = None) -> KeptRun:
    """Return where the only run of a folder is kept."""
    [run] = open_runs([folder])
    found = place_of(run, options or ProcessOptions(), zero)
    assert found is not None
    return found


@pytest.mark.usefixtures("place")
def test_every_option_of_the_processing_is_in_the_key(folder: Path) -> None:
    """A field that is added to `ProcessOptions` is in `changes`, and so has to be in the key."""
    [run] = open_runs([folder])
    base = ProcessOptions(cutoff_hz=2.0, max_gap_s=1.0)
    places = {"": place_of(run, base, None)} | {at: place_of(run, new, None) for at, new in changes(base)}
    assert set(places) - {""} == {f".{field.name}" for field in fields(ProcessOptions)}
    own = {at: found and found.own for at, found in places.items()}
    shared = {at: found and found.shared for at, found in places.items()}
    assert len(set(own.values())) == len(places)
    assert shared.pop(".purpose") == shared[""], "what serves every purpose is kept once"
    assert len(set(shared.values())) == len(shared)


FILES = {
    "vehicle.toml": lambda text: text.replace("radius_m = 0.47", "radius_m = 0.48"),
    "wft.dbc": lambda text: text + "\n",
    "runs.toml": lambda text: text.replace('direction = "out"', 'direction = "back"'),
}


@pytest.mark.parametrize("file", FILES)
def test_every_file_beside_a_recording_is_in_the_key(file: str, folder: Path, place: Path, tmp_path: Path) -> None:
    del place
    there = shutil.copytree(folder, tmp_path / "other")
    before = name_of(there)
    text = (there / file).read_text()
    changed = FILES[file](text)
    assert changed != text
    (there / file).write_text(changed)
    assert name_of(there).shared != before.shared


@pytest.mark.usefixtures("place")
def test_content_counts_and_neither_time_nor_place(folder: Path, tmp_path: Path) -> None:
    there = shutil.copytree(folder, tmp_path / "other")
    for file in there.iterdir():
        os.utime(file, (1e9, 1e9))
    (there / "terrain.toml").write_text((there / "terrain.toml").read_text() + "\n# no matter for the processing\n")
    assert name_of(there).shared == name_of(folder).shared
    recording = there / "run-1.mcap"
    facts, data = recording.stat(), bytearray(recording.read_bytes())
    data[len(data) // 2] ^= 1
    recording.write_bytes(data)
    os.utime(recording, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert name_of(there).shared != name_of(folder).shared, "the same size and time, another content"


@pytest.mark.usefixtures("place")
def test_the_zero_file_is_in_the_key(folder: Path, tmp_path: Path) -> None:
    from daq import ZeroConfig

    zero = tmp_path / "zero.toml"
    zero.write_text(zeros_toml(ZeroConfig()), encoding="utf-8")
    assert name_of(folder, zero=zero).shared != name_of(folder).shared


@pytest.mark.usefixtures("place")
def test_a_run_whose_file_cannot_be_read_has_no_key(folder: Path, tmp_path: Path) -> None:
    there = shutil.copytree(folder, tmp_path / "other")
    [run] = open_runs([there])
    (there / "run-1.mcap").unlink()
    assert place_of(run, ProcessOptions(), None) is None
    assert isinstance(run, Run)


PRINTED = "from wheelsoil.cache.keys import OF_MODELS, key_of; print(key_of('x', {packages}, (1, 2)))"


def printed_key(site: Path, packages: str) -> str:
    """Return the key that a process of its own has, with a folder of packages where Python finds them."""
    env = os.environ | {"PYTHONPATH": f"{site}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-c", PRINTED.format(packages=packages)]
    return subprocess.run(command, env=env, capture_output=True, text=True, check=True, timeout=120).stdout


def test_the_code_is_in_the_key(tmp_path: Path) -> None:
    inside = tmp_path / "mine" / "inside"
    inside.mkdir(parents=True)
    (tmp_path / "mine" / "__init__.py").touch()
    file = inside / "formula.py"
    file.write_text("x = 1\n")
    first, again = (printed_key(tmp_path, "('mine',)") for _ in range(2))
    file.write_text("x = 2\n")
    changed = printed_key(tmp_path, "('mine',)")
    file.rename(inside / "other.py")
    moved = printed_key(tmp_path, "('mine',)")
    assert first == again and len({first, changed, moved}) == 3


def test_effects_of_other_packages_are_in_the_key(tmp_path: Path) -> None:
    site = tmp_path / "site"
    info = site / "my_wind-1.0.dist-info"
    info.mkdir(parents=True)
    without = printed_key(site, "OF_MODELS")
    (site / "my_wind.py").write_text(HEADWIND)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my_wind\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[wheelsoil.effects]\nmine = my_wind:Headwind\n")
    with_it, again = (printed_key(site, "OF_MODELS") for _ in range(2))
    (site / "my_wind.py").write_text(HEADWIND + "\n# another formula\n")
    assert with_it == again and len({without, with_it, printed_key(site, "OF_MODELS")}) == 3


def test_code_that_was_changed_while_it_is_in_use_has_no_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "of_a_notebook.py"
    file.write_text("x = 1\n")
    os.utime(file, (time.time() + 5, time.time() + 5))
    with pytest.raises(NotKeptError, match="changed while it was in use"):
        key_of("x", ("of_a_notebook",), 1)
    os.utime(file, (1e9, 1e9))
    assert key_of("x", ("of_a_notebook",), 1)
    os.utime(file, (time.time() + 5, time.time() + 5))  # of a key that was there before, too
    with pytest.raises(NotKeptError, match="changed while it was in use"):
        key_of("y", ("daq", "of_a_notebook"), 1)


@pytest.mark.parametrize("package", ["__main__", "itertools", "no_such_package"])
def test_code_without_a_source_has_no_key(package: str) -> None:
    with pytest.raises(NotKeptError, match="no source"):
        key_of("x", (package,), 1)


def test_kinds_and_packages_are_in_the_key() -> None:
    asked = [("fit", OF_MODELS), ("diagnosis", OF_MODELS), ("fit", OF_PROCESSING)]
    assert len({key_of(kind, packages, 1) for kind, packages in asked}) == 3
