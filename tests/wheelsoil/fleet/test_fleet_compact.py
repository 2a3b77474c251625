"""Packs of many campaigns: the same rows before, while and after they are made, whatever is killed or damaged."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from cli_support import invoke, ok
from fleet_support import contents, differing, rows_of

from wheelsoil.fleet import Manifest, Store, ask, compact, holdings_of, open_store, packs
from wheelsoil.fleet.manifests import pack_of, sealed, text_of_pack, unsealed

SQL = "select campaign, run, grade, duration_s from runs order by campaign, run"


class KilledError(BaseException):
    """As if the process had ended here."""


@pytest.fixture(autouse=True)
def small_packs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the eight campaigns two packs, of three and two groups."""
    monkeypatch.setattr(packs, "CAMPAIGNS_OF_A_PACK", 5)
    monkeypatch.setattr(packs, "CAMPAIGNS_OF_A_GROUP", 2)


@pytest.fixture
def own(store: Path, tmp_path: Path) -> Path:
    """Return a store that may be changed."""
    return Path(shutil.copytree(store, tmp_path / "own"))


Same = Callable[[Path], None]


@pytest.fixture(scope="module")
def same(store: Path, whole: dict[str, pa.Table]) -> Same:
    """Return what holds a store to the rows of that of the fleet."""
    answer, of_each = ask(open_store(str(store)), SQL).rows, contents(store)

    def check(url: Path) -> None:
        assert not differing(url, whole)
        assert ask(open_store(str(url)), SQL).rows.equals(answer)
        assert contents(url) == of_each

    return check


def _files(url: Path) -> list[str]:
    return sorted(str(path.relative_to(url)) for path in url.rglob("*") if path.is_file())


def test_a_compacted_store_has_the_same_rows_in_few_files(
    own: Path, store: Path, fleet: Path, same: Same, tmp_path: Path
) -> None:
    assert ok("fleet", "compact", own).out == "8 campaigns put together; 2 packs in the store\n"
    same(own)
    assert not list(own.rglob("campaign=*")) and not list(own.glob("done/*"))
    names = _files(own)
    assert len(names) <= 2 + 2 * (2 + 11) and len(list(own.glob("packs/*.json"))) == 2
    assert (
        ok("fleet", "compact", own).out == "0 campaigns put together; 2 packs in the store\n" and _files(own) == names
    )
    for command in (("status",), ("diagnose",), ("sql", SQL)):
        here, there = (ok("fleet", command[0], at, *command[1:], "--json").json for at in (own, store))
        assert {**here, "store": ""} == {**there, "store": ""} if isinstance(here, dict) else here == there
    again = invoke("fleet", "run", fleet, "--store", own)
    assert "8 in the store already" in again.err and not re.search(r"\b1/\d", again.err)
    ok("fleet", "export", own, "-o", tmp_path / "tables", "--tables", "runs")


def test_what_changes_afterwards_replaces_the_row_of_the_pack(own: Path, store: Path) -> None:
    ok("fleet", "compact", own)
    target = open_store(str(own))
    old = holdings_of(open_store(str(store)))
    tables = {name: old.table(name) for name in ("campaigns", "runs")}
    import pyarrow.compute as pc

    for content, vehicle in (("a" * 16, "first"), ("b" * 16, "second")):
        changed = {}
        for name, table in tables.items():
            rows = table.filter(pc.field("campaign") == "spring/day-3").drop_columns(["campaign"])
            place = rows.schema.get_field_index("content")
            changed[name] = rows.set_column(place, rows.schema.field(place), [[content] * len(rows)])
        known = [part.name for part in holdings_of(target).parts if not part.is_pack]
        target.put(
            Manifest("spring/day-3", content, "done", verdict=vehicle, rows={"campaigns": 1, "runs": 1}), changed, known
        )
        for _ in range(2):  # beside the pack, then within one
            said = ask(target, "select content, count(*) over () as n from campaigns where campaign = 'spring/day-3'")
            assert said.rows.to_pylist() == [{"content": content, "n": 1}]
            assert ask(target, "select count(*) as n from campaigns").rows.to_pylist() == [{"n": 8}]
            assert len(rows_of(own)["campaigns"]) == 8 and len(rows_of(own)["evidence"]) == 4
            assert holdings_of(target).manifests["spring/day-3"].verdict == vehicle
            compact(target)
    assert sum(path.name == "campaigns.parquet" for path in own.rglob("*")) == 2
    assert "spring/day-3" not in rows_of(own)["evidence"]["campaign"].to_pylist()


def _killed_at(step: int, own: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Compact, and end at the n-th file that is written or removed; return whether it came to that."""
    done = 0

    def counted(name: str) -> None:
        real = getattr(Store, name)

        def call(self: Store, *args: object, **options: object) -> object:
            nonlocal done
            done += 1
            if done > step:
                raise KilledError
            return real(self, *args, **options)

        monkeypatch.setattr(Store, name, call)

    with monkeypatch.context() as patched:
        monkeypatch = patched
        counted("_write")
        counted("_remove")
        try:
            compact(open_store(str(own)))
        except KilledError:
            return True
    return False


def _kills(steps: range, own: Path, same: Same, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    killed = 0
    monkeypatch.setattr(packs, "_STALE_S", -1.0)  # no other writer is at work
    for step in steps:
        place = tmp_path / f"killed-{step}"
        shutil.copytree(own, place)
        if not _killed_at(step, place, monkeypatch):
            break
        killed += 1
        same(place)
        compact(open_store(str(place)))
        same(place)
        assert {name.partition("/")[0] for name in _files(place)} == {".compact.lock", "packs", "store.json"}, step
        assert len(list(place.glob("packs/*.json"))) == len(list(place.glob("packs/*/sources.json"))) == 2, step
        shutil.rmtree(place)
    return killed


@pytest.mark.slow
def test_a_kill_while_it_compacts_changes_no_row(
    own: Path, same: Same, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _kills(range(10, 90, 40), own, same, tmp_path, monkeypatch) == 2


@pytest.mark.slow
def test_no_kill_changes_a_row(own: Path, same: Same, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _kills(range(0, 300, 7), own, same, tmp_path, monkeypatch) > 10


@pytest.mark.parametrize("kind", ["byte flipped", "cut", "another table", "manifest {}", "sources cut"])
def test_a_damaged_pack_costs_its_row_group_or_its_campaigns(kind: str, own: Path, whole: dict[str, pa.Table]) -> None:
    ok("fleet", "compact", own)
    everything = [row["campaign"] for row in whole["campaigns"].to_pylist()]
    [pack] = [path for path in own.glob("packs/*.json") if "spring/day-5" in path.read_text()]
    of_pack = {
        one.campaign
        for part in holdings_of(open_store(str(own))).parts
        if part.name.endswith(pack.name)
        for one in part.all
    }
    path = pack.with_suffix("") / "campaigns.parquet"
    data = bytearray(path.read_bytes())
    if kind == "byte flipped":
        data[60] ^= 0xFF
        path.write_bytes(data)
    elif kind == "cut":
        path.write_bytes(data[:500])
    elif kind == "another table":
        shutil.copy(path.with_name("diagnoses.parquet"), path)
    elif kind == "manifest {}":
        pack.write_text("{}")
    else:
        path.with_name("sources.json").write_text("{")
    said = invoke("fleet", "sql", own, "from campaigns order by campaign", "--json")
    if kind == "sources cut":
        assert said.code == 0 and len(said.json) == 8
    else:
        lost = set(everything) - {row["campaign"] for row in said.json}
        assert said.code == 1 and lost == (of_pack if kind != "byte flipped" else set(sorted(of_pack)[:2]))
        assert all(f"  {name}: " in said.err for name in lost)
        assert invoke("fleet", "compact", own).code == 0
        assert lost == {one["campaign"] for one in invoke("fleet", "check", own, "--json").json["damaged"]}
    assert json.loads((own / "store.json").read_text())


@pytest.mark.slow
@pytest.mark.usefixtures("warm", "one_process")
def test_a_damaged_pack_is_made_anew(own: Path, fleet: Path, same: Same) -> None:
    ok("fleet", "compact", own)
    for path in own.glob("packs/*/campaigns.parquet"):
        path.write_bytes(path.read_bytes()[:500])
    again = invoke("fleet", "run", fleet, "--store", own)
    assert "0 in the store already" in again.err and "made anew" in again.err
    same(own)
    ok("fleet", "compact", own)
    ok("fleet", "check", own)
    same(own)
    assert len(list(own.glob("packs/*.json"))) == 2


def _without_sizes(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key not in ("parts", "made_at_ns")}


def _without_tails(values: dict[str, Any]) -> dict[str, Any]:
    """Return a manifest of before footers had a checksum; that of the whole was of its keys in order."""
    values["parts"] = {table: facts[:2] for table, facts in values["parts"].items()}
    seal = hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
    return dict(reversed(values.items())) | {"checksum": seal}


@pytest.mark.parametrize("older", [_without_sizes, _without_tails])
def test_a_store_of_before_is_opened_and_compacted(
    older: Callable[[dict[str, Any]], dict[str, Any]], own: Path, same: Same
) -> None:
    for path in own.glob("done/*.json"):
        values = json.loads(path.read_text())
        del values["checksum"]
        path.write_text(json.dumps(older(values)))
    same(own)
    ok("fleet", "compact", own)
    same(own)


GROUPS = (
    (Manifest("a", "1", "done", verdict="named", rows={"runs": 2}, cpu_s=0.5, peak_bytes=7, made_at_ns=3),),
    (Manifest("b", "2", "failed", "a fault", rows={"runs": 0, "notes": 1}), Manifest("c", "3", "done")),
)


def test_a_pack_s_manifest_is_read_as_written_and_as_it_once_was() -> None:
    text = text_of_pack(GROUPS, {"runs.parquet": [12, "", ""]})
    light = [[{key: vars(one)[key] for key in ("campaign", "content", "state")} for one in own] for own in GROUPS]
    once = sealed({"groups": light, "parts": {"runs.parquet": [12, "", ""]}})
    assert pack_of("packs/p.json", text).groups == GROUPS
    assert [[one.campaign for one in own] for own in pack_of("packs/p.json", once).groups] == [["a"], ["b", "c"]]
    assert pack_of("packs/p.json", once).files == pack_of("packs/p.json", text).files
    values = unsealed(text)
    del values["campaigns"]["causes"]  # as before there was a column for them
    assert pack_of("packs/p.json", sealed(values)).groups == GROUPS


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("state", ["done", "failed"]),
        ("state", ["done", "failed", "gone"]),
        ("campaign", ["a", "b", 3]),
        ("peak_bytes", [7, 0, True]),
        ("peak_bytes", [7, 0, -1]),
        ("cpu_s", [0.5, 0.0, [0.0]]),
        ("files", [{}, {}, {}]),
        ("foo", [1, 2, 3]),
        ("rows", {"runs": [2, 0, "none"]}),
        ("rows", {"foo": [1, 1, 1]}),
        ("rows", [2, 0, None]),
        ("campaign", None),
    ],
)
def test_a_pack_s_manifest_with_values_of_another_kind_is_refused(key: str, values: object) -> None:
    whole = unsealed(text_of_pack(GROUPS, {}))
    whole["campaigns"][key] = values
    with pytest.raises(ValueError, match=r"campaigns|value|key"):
        pack_of("packs/p.json", sealed(whole))


def test_two_compactions_do_not_meet(own: Path) -> None:
    import fcntl

    with (own / ".compact.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        said = invoke("fleet", "compact", own)
    assert said.code == 2 and "another compaction is running" in said.err and list(own.glob("done/*"))


def test_a_store_of_the_first_version_is_read_and_compacted_without_loss(tmp_path: Path) -> None:
    """A single-wheel table of 24 November 2026: its manifest has no checksums, and there were no packs."""
    with tarfile.open(Path(__file__).with_name("store_of_2026_11_24.tar.xz")) as kept:
        kept.extractall(tmp_path, filter="data")
    url = tmp_path / "store"
    before = rows_of(url)
    assert {table: len(rows) for table, rows in before.items() if len(rows)} == {
        "campaigns": 1,
        "notes": 9,
        "fits": 8,
        "coefficients": 5,
        "diagnoses": 1,
        "causes": 16,
        "gains": 4,
    }
    assert ask(open_store(str(url)), "select campaign, verdict from diagnoses").rows.to_pylist() == [
        {"campaign": "bench/tests", "verdict": "one_of"}
    ]
    status = ok("fleet", "status", url).out
    assert "1 one of" in status and re.search("causes +not kept by the version that made the store", status)
    compact(open_store(str(url)))
    assert not holdings_of(open_store(str(url)), thorough=True).damaged
    assert not differing(url, before)
    assert not any(name.startswith("done/") for name in _files(url))
