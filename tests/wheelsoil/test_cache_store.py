"""The folder of kept results: damage, limit, folders that cannot be written, several processes at once."""

from __future__ import annotations

import logging
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok
from closed_folders import as_nobody

from daq import ConfigError, Note
from wheelsoil.cache import clear, entries, folder, limit_bytes, nothing_kept
from wheelsoil.cache.store import get, kept, key_for, put

VALUE = (Note("late_stamps", values={"count": 3}), np.arange(1000.0), float("nan"))


@pytest.fixture
def entry(place: Path) -> Path:
    """Return the file of a kept value."""
    put("one-0", VALUE)
    return place / "one-0.kept"


def test_what_was_put_is_got(entry: Path) -> None:
    note, array, nan = get("one-0")
    assert (note, array.tolist()) == (VALUE[0], VALUE[1].tolist()) and nan != nan
    assert get("one-1") is None
    assert [one.path for one in entries(entry.parent)] == [entry], "and no draft is left"


@pytest.mark.parametrize("at", [0, 5, 16, 17, 30, 48, 49, 56, 57, 100, 500, 4000, -1])
@pytest.mark.parametrize("damage", ["bit", "cut"])
def test_a_damaged_entry_is_made_anew(at: int, damage: str, entry: Path, caplog: pytest.LogCaptureFixture) -> None:
    whole = entry.read_bytes()
    at %= len(whole)
    entry.write_bytes(whole[:at] if damage == "cut" else whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    with caplog.at_level(logging.DEBUG, "wheelsoil.cache.store"):
        assert get("one-0") is None
    assert "one-0.kept cannot be used" in caplog.text
    put("one-0", VALUE)
    assert entry.read_bytes() == whole


def test_a_folder_that_all_may_write_into_is_not_used(entry: Path, caplog: pytest.LogCaptureFixture) -> None:
    entry.parent.chmod(0o777)
    with caplog.at_level(logging.WARNING, "wheelsoil.cache.store"):
        assert get("one-0") is None and folder() is None and clear() == 0
        put("two-0", VALUE)
    assert caplog.text.count("anyone may write into it") == 1 and "chmod o-w" in caplog.text
    assert list(entry.parent.iterdir()) == [entry]
    entry.parent.chmod(0o755)
    assert get("one-0") is not None


def test_an_entry_under_another_name_is_not_taken(entry: Path) -> None:
    entry.rename(entry.with_name("two-0.kept"))
    assert get("two-0") is None, "it was made of other inputs"


def test_a_result_is_computed_once(place: Path) -> None:
    computed: list[int] = []

    def compute() -> tuple[int, ...]:
        computed.append(1)
        return (1, 2)

    assert [kept("sum", (1, 2), compute) for _ in range(3)] == [(1, 2)] * 3
    assert kept("sum", (1, 2.0), compute) == (1, 2)
    assert len(computed) == 2 and len(entries(place)) == 2
    with nothing_kept():
        assert folder() is None and kept("sum", (1, 2), compute) == (1, 2)
    assert len(computed) == 3 and folder() == place


def test_what_cannot_be_kept_is_computed(place: Path) -> None:
    assert kept("odd", object(), lambda: 1) == 1, "inputs that have no key"
    assert kept("odd", 1, lambda: {1}) == {1}, "a result that cannot be written"
    assert not entries(place)


def used_before(path: Path, seconds: float) -> None:
    """Let a file look as if it was used some time ago."""
    then = time.time() - seconds
    os.utime(path, (then, then))


def test_entries_not_used_for_longest_go_first(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i in range(4):
        put(f"one-{i}", np.random.default_rng(i).random(1000))
        used_before(place / f"one-{i}.kept", 100.0 - i)
    assert get("one-0") is not None, "it is the one used last, now"
    monkeypatch.setenv("WHEELSOIL_CACHE_LIMIT", "26 KB")
    put("one-4", np.random.default_rng(4).random(1000))
    assert {one.path.stem for one in entries(place)} == {"one-0", "one-3", "one-4"}
    assert sum(one.bytes for one in entries(place)) <= 26_000
    put("big", np.random.default_rng(4).random(4000))
    assert {one.path.stem for one in entries(place)} == {"one-0", "one-3", "one-4"}, "too large by itself"


def test_drafts_of_killed_commands_go(entry: Path) -> None:
    young, old, other = (entry.with_name(name) for name in ("a.kept1.draft", "b.kept2.draft", "notes.txt"))
    for path in (young, old, other):
        path.write_bytes(b"x")
    used_before(old, 4000.0)
    used_before(other, 1e6)
    put("two-0", VALUE)
    assert young.exists() and not old.exists() and other.exists()
    assert clear() == 3, "two entries and a draft"
    assert [path.name for path in entry.parent.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("text", "size"), [("", 2e9), ("500 MB", 5e8), ("1.5gb", 1.5e9), ("20KB", 20_000), ("77", 77), ("0", 0)]
)
def test_limits(text: str, size: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WHEELSOIL_CACHE_LIMIT", text)
    assert limit_bytes() == size


@pytest.mark.parametrize("text", ["much", "-1", "2 GiB", "1e9", "nan", "2 GB or so"])
@pytest.mark.usefixtures("place")
def test_a_limit_that_is_none_is_an_error_before_anything_is_computed(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WHEELSOIL_CACHE_LIMIT", text)
    with pytest.raises(ConfigError, match="WHEELSOIL_CACHE_LIMIT is no size"):
        kept("sum", 1, lambda: pytest.fail("computed"))
    assert invoke("cache").code == 2


@pytest.fixture(params=["a file", "under a file", "not to be written to", "not to be read"])
def unusable(request: pytest.FixtureRequest, place: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have a folder for kept results that cannot be used."""
    place.parent.chmod(0o755)
    if "file" in request.param:
        place.write_bytes(b"x")
    else:
        place.mkdir()
        place.chmod(0o555 if "written" in request.param else 0)
    if request.param.startswith("under"):
        monkeypatch.setenv("WHEELSOIL_CACHE", str(place / "inside"))
    with as_nobody():
        yield


@pytest.mark.usefixtures("unusable")
def test_a_folder_that_cannot_be_used_stops_nothing() -> None:
    for _ in range(2):
        assert kept("sum", 1, lambda: (1, 2)) == (1, 2)
    assert ok("cache", "--json").json["entries"] == 0


def test_a_full_disk_stops_nothing(place: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
        assert len(kept("array", 1, lambda: np.random.default_rng(0).random(1000))) == 1000
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(place.iterdir()) == [], "nor is a part of it left"


def test_without_a_folder_the_users_is_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WHEELSOIL_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    found = folder()
    assert found is not None and tmp_path in found.parents and "wheelsoil" in found.parts


BOTH = """
import numpy as np
from wheelsoil.cache.store import get, put
wanted = np.arange(20_000.0)
for i in range(150):
    put(f"one-{i % 3}", wanted)
    for j in range(3):
        found = get(f"one-{j}")
        assert found is None and i < 3 or found is not None and np.array_equal(found, wanted), (i, j)
"""


def test_two_processes_at_once(place: Path) -> None:
    both = [subprocess.Popen([sys.executable, "-c", BOTH], stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    assert len(entries(place)) == 3 == len(list(place.iterdir()))


@pytest.mark.slow
def test_two_processes_with_little_room(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WHEELSOIL_CACHE_LIMIT", "200 KB")
    code = BOTH.replace("found is None and i < 3", "found is None").replace("i % 3", "i")
    both = [subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    assert sum(one.bytes for one in entries(place)) <= 200_000


def test_the_name_of_an_entry_tells_its_kind(place: Path) -> None:
    assert key_for("fit", ("wheelsoil.cache",), 1).startswith("fit-")
    assert not place.exists(), "nothing is written to look for it"
