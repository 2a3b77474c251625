"""Rooms meet at their faces and stay light, no two modules import each other, every face keeps what it promises."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("daq", "processing", "model", "wheelsoil")
STUBS = [stub for room in ROOMS for stub in sorted((ROOT / room).rglob("__init__.pyi"))]


def dotted(file: Path) -> str:
    """Import name of a source file; of a package that of its folder."""
    name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    return name.removesuffix(".__init__")


FILES = {dotted(file): file for room in ROOMS for file in sorted((ROOT / room).rglob("*.py"))}
PACKAGES = {name for name, file in FILES.items() if file.stem == "__init__"}
MOST_FILES, MOST_STATEMENTS = 425, 52_243
"""What the rooms may hold. A commit that raises one says what the user gets for it."""


SECTIONS = re.compile(r"^(Parameters|Returns|Yields|Raises)\n--", re.MULTILINE)
MOST_WITHOUT_STEP = 124
"""Faults without a next step: most name what was expected, or are for who writes a program."""


@cache
def exports(package: str) -> dict[str, str]:
    """Name -> module behind the face, as the stub says."""
    stub = FILES[package].with_suffix(".pyi") if package in PACKAGES else None
    if not stub or not stub.exists():
        return {}
    return {
        alias.asname or alias.name: f"{package}.{node.module}"
        for node in ast.walk(ast.parse(stub.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


@cache
def parsed(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text(encoding="utf-8"))


@cache
def imported(module: str) -> frozenset[tuple[str, str]]:
    """(module or package, name) of every import in a file, wherever it stands; the name of a whole module is empty."""
    found = set()
    for node in ast.walk(parsed(module)):
        if isinstance(node, ast.Import):
            found |= {(alias.name, "") for alias in node.names if alias.name in FILES}
        elif isinstance(node, ast.ImportFrom) and node.module in FILES:
            inside = {alias.name: f"{node.module}.{alias.name}" for alias in node.names}
            found |= {(whole, "") if whole in FILES else (node.module, name) for name, whole in inside.items()}
    return frozenset(found)


def behind(target: str, name: str) -> str:
    """Module that an import reaches, through as many faces as it takes."""
    while name in exports(target):
        target = exports(target)[name]
    return target


def shortest_face(target: str, name: str) -> str | None:
    """Outermost package that exports what an import reaches."""
    parts = target.split(".")
    faces = [".".join(parts[:count]) for count in range(1, len(parts) + 1)]
    return next((face for face in faces if name in exports(face) and behind(face, name) == behind(target, name)), None)


def past_a_face(module: str) -> Iterator[str]:
    room = module.partition(".")[0]
    for target, name in sorted(imported(module)):
        if target.partition(".")[0] != room and shortest_face(target, name) != target:
            yield f"{module}: {target}{name and '.' + name}, not {shortest_face(target, name) or 'exported by a face'}"


def test_the_rooms_stay_light() -> None:
    statements = sum(isinstance(node, ast.stmt) for module in FILES for node in ast.walk(parsed(module)))
    assert len(FILES) <= MOST_FILES and statements <= MOST_STATEMENTS


def test_rooms_import_each_other_by_their_faces() -> None:
    assert [line for module in FILES for line in past_a_face(module)] == []


def test_tests_import_by_the_outermost_face() -> None:
    past = [
        f"{file.name}: {node.module}.{alias.name}, not {face}"
        for file in sorted((ROOT / "tests").rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module in FILES
        for alias in node.names
        if (face := shortest_face(node.module, alias.name)) not in (None, node.module)
    ]
    assert past == []


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {module: {behind(*pair) for pair in imported(module)} - {module} for module in FILES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


@pytest.mark.parametrize("stub", STUBS, ids=dotted)
def test_every_name_of_a_face_is_there_and_no_module_is_called_the_same(stub: Path) -> None:
    package = importlib.import_module(dotted(stub))
    names = set(exports(package.__name__))
    assert names == set(package.__all__)
    assert [name for name in sorted(names) if not hasattr(package, name)] == []
    assert names & {module.name for module in pkgutil.iter_modules(package.__path__)} == set()


def entry(stub: Path) -> str:
    """What docs/api.md says of a package: its name, what it is, what it exports."""
    package = importlib.import_module(dotted(stub))
    names = ", ".join(f"`{name}`" for name in sorted(exports(package.__name__), key=str.casefold))
    return f"### {package.__name__}\n{(package.__doc__ or '').splitlines()[0]}\n\n{textwrap.fill(names, 120)}\n"


@pytest.mark.parametrize("stub", STUBS, ids=dotted)
def test_a_face_is_in_the_docs_as_it_is(stub: Path) -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert entry(stub) in page, f"docs/api.md should have\n\n{entry(stub)}"
    assert page.count("\n### ") == len(STUBS)


def test_only_what_a_face_exports_has_sections_in_its_docstring() -> None:
    """Of all else a line or two say what its names and types do not."""
    exported = {(behind(face, name), name) for face in PACKAGES for name in exports(face)}
    defined = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    with_sections = [
        f"{module}.{node.name}"
        for module in FILES
        for outer in parsed(module).body
        if (module, getattr(outer, "name", "")) not in exported
        for node in ast.walk(outer)
        if isinstance(node, defined) and SECTIONS.search(ast.get_docstring(node) or "")
    ]
    assert with_sections == []


def test_no_more_faults_without_a_next_step() -> None:
    """A fault says what to do, but where what was expected already says it; a new one has its step."""
    without = [
        f"{name}:{node.lineno}"
        for name in FILES
        for node in ast.walk(parsed(name))
        if isinstance(node, ast.Call) and _is_fault(node) and not _has_step(node)
    ]
    assert len(without) <= MOST_WITHOUT_STEP, "\n".join(without)


def _is_fault(call: ast.Call) -> bool:
    of = isinstance(call.func, ast.Attribute) and call.func.attr == "of" and isinstance(call.func.value, ast.Name)
    return ast.unparse(call.func) == "Fault" or (of and ast.unparse(call.func.value).endswith("Error"))


def _has_step(call: ast.Call) -> bool:
    starred = any(isinstance(arg, ast.Starred) for arg in call.args)
    return starred or len(call.args) >= 5 or any(keyword.arg in ("next_step", None) for keyword in call.keywords)
