"""Effects that another package brings: found, simulated, held to the contract; a broken one is told by its name."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daq import ConfigError
from model.effects import MEASUREMENT, PHYSICAL, Library

ROOT = Path(__file__).parents[2]
README = (ROOT / "docs" / "effects" / "README.md").read_text()
HEADWIND, ENTRY = (README.split(f"```{language}\n")[1].split("```")[0] for language in ("python", "toml"))
COMMAND = ("-c", "import sys; from wheelsoil.cli.app import main; sys.exit(main())")
Install = Callable[..., dict[str, str]]


@pytest.fixture
def install(tmp_path: Path) -> Iterator[Install]:
    """Return a function that puts a distribution where Python finds it, and returns the environment to run in."""

    def put(package: str, code: str, target: str) -> dict[str, str]:
        folder = tmp_path / "site"
        info = folder / f"{package}-1.0.dist-info"
        info.mkdir(parents=True)
        (folder / f"{package}.py").write_text(code)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[wheelsoil.effects]\nmine = {target}\n")
        return os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}

    yield put
    sys.modules.pop("my_wind", None)


def python(env: dict[str, str], *args: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *map(str, args)], cwd=ROOT, env=env, capture_output=True, text=True, check=False, timeout=300
    )


def test_a_package_adds_an_effect_as_the_page_says(install: Install, tmp_path: Path) -> None:
    env = install("my_wind", HEADWIND, "my_wind:Headwind")
    assert tomllib.loads(ENTRY)["project"]["entry-points"]["wheelsoil.effects"] == {"headwind": "my_wind:Headwind"}
    out = tmp_path / "campaign"
    done = python(env, *COMMAND, "simulate", "-o", out, "--runs", 1, "--duration", 15, "--effect", "headwind:drag=7")
    assert done.returncode == 0, done.stderr
    truth = tomllib.loads((out / "manifest.toml").read_text())["truth"]
    assert truth["effect"] == [{"name": "headwind", "parameters": {"drag": 7.0}}]
    seen = python(env, "-c", "import my_wind; from model.effects import EFFECTS; print(EFFECTS['headwind'].summary)")
    assert seen.stdout == "The wind takes part of the drawbar pull.\n", seen.stderr


@pytest.mark.slow
def test_name_parameters_and_one_hook_are_enough(install: Install, tmp_path: Path) -> None:
    """What an effect may leave unsaid a report omits."""
    least = re.sub(r'    (?:summary|source|shows|needs) = .*\n| +"""D.*\n|, source="a van"', "", HEADWIND)
    assert re.findall(r"^    (?:def )?(\w+)", least.split("class ")[1], re.M) == ["name", "parameters", "resultants"]
    env, out = install("my_wind", least, "my_wind:Headwind"), tmp_path / "campaign"
    runs, page = ("--runs", 3, "--duration", 40, "--effect", "headwind:drag=40"), tmp_path / "report.html"
    done = python(env, *COMMAND, "simulate", "-o", out, *runs)
    assert done.returncode == 0, done.stderr
    asked = python(env, *COMMAND, "diagnose", out, "--effects", "headwind,crosstalk", "--json")
    assert asked.returncode == 0, asked.stderr
    found = json.loads(asked.stdout)
    assert (found["verdict"], found["causes"][0]["name"]) == ("named", "headwind"), found["sentence"]
    low, high = found["causes"][0]["parameters"][0]["interval95"]
    assert 0.0 < low < 40.0 < high
    done = python(env, *COMMAND, "report", out, "-o", page)
    assert done.returncode == 0, done.stderr
    assert "Headwind, drag = " in page.read_text() and "Headwind:" not in page.read_text()


@pytest.mark.slow
def test_the_contract_suite_takes_it_up(install: Install) -> None:
    env = install("my_wind", HEADWIND, "my_wind:Headwind")
    assert "`pytest tests/contract` in a checkout" in README, "the whole of it, as the page says"
    chosen = [path for path in Path(__file__).parent.glob("test_*.py") if path.name != Path(__file__).name]
    done = python(env, "-m", "pytest", "-q", "-p", "no:cacheprovider", *chosen, "-k", "headwind")
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


@pytest.mark.slow
def test_one_that_shows_elsewhere_than_it_says_is_caught(install: Install) -> None:
    said = 'shows = ("drawbar_pull",)'
    env = install("my_wind", HEADWIND.replace(said, 'shows = ("driving_torque",)'), "my_wind:Headwind")
    suite = "tests/contract/test_virtual_effects_contract.py"
    done = python(env, "-m", "pytest", "-q", "-p", "no:cacheprovider", suite, "-k", "headwind")
    assert done.returncode == 1
    assert "test_it_shows_where_it_should" in done.stdout


def stating(key: str, text: str) -> str:
    """Return the effect of the page with one more statement."""
    return HEADWIND.replace("    source =", f'    {key} = "{text}"\n    source =')


@pytest.mark.parametrize(
    ("code", "target", "message"),
    [
        ("1 / 0", "my_wind:Headwind", "cannot be loaded"),
        ("def (", "my_wind:Headwind", "cannot be loaded"),
        (HEADWIND, "my_wind:Tailwind", "cannot be loaded"),
        ("Headwind = 3", "my_wind:Headwind", "is no effect"),
        (HEADWIND.replace('name = "headwind"', 'name = "slope"'), "my_wind:Headwind", "takes the name 'slope'"),
        (HEADWIND.replace("parameters =", "parameter ="), "my_wind:Headwind", "no tuple of parameters"),
        (HEADWIND.replace("name =", "title ="), "my_wind:Headwind", "cannot be typed ''"),
        (HEADWIND.replace("lower=-50.0", "lower=1.0"), "my_wind:Headwind", "out of order"),
        (HEADWIND.replace('"a van"),\n', '"a van")\n'), "my_wind:Headwind", "no tuple"),
        (HEADWIND.replace('name = "headwind"', 'name = "head wind"'), "my_wind:Headwind", "cannot be typed"),
        (HEADWIND.replace('("drawbar_pull",)', '("pull",)'), "my_wind:Headwind", "shows where no channel is"),
        (stating("error_text", "Wet {pull}"), "my_wind:Headwind", "error_text that cannot be written out 'Wet {pull}'"),
        (
            stating("error_text", "Reads {too much/too-little}"),
            "my_wind:Headwind",
            "error_text that cannot be written out",
        ),
        (stating("error_text", "Reads {size"), "my_wind:Headwind", "cannot be written out"),
        (stating("abscissa", "Slip"), "my_wind:Headwind", "unknown abscissa 'Slip'"),
    ],
)
def test_a_broken_one_is_told_by_name(
    install: Install, monkeypatch: pytest.MonkeyPatch, code: str, target: str, message: str
) -> None:
    monkeypatch.syspath_prepend(install("my_wind", code, target)["PYTHONPATH"].split(os.pathsep)[0])
    with pytest.raises(ConfigError) as error:
        list(Library((*PHYSICAL, *MEASUREMENT)))
    [fault] = error.value.faults
    assert message in f"{fault.what} {fault.found}" and "my_wind" in fault.what


def test_a_broken_one_ends_a_command_with_a_message(install: Install, tmp_path: Path) -> None:
    env = install("my_wind", "Headwind = 3", "my_wind:Headwind")
    done = python(env, *COMMAND, "simulate", "-o", tmp_path / "campaign", "--effect", "slope")
    assert done.returncode == 2
    assert "is no effect" in done.stderr and "my_wind" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "campaign").exists()


def test_a_broken_one_leaves_help_alone(install: Install) -> None:
    done = python(install("my_wind", "1 / 0", "my_wind:Headwind"), *COMMAND, "--help")
    assert done.returncode == 0 and "simulate" in done.stdout
