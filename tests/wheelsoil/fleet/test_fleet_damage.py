"""Files of a store that are damaged or exchanged: their campaigns are named and set aside, all others answer."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import pyarrow as pa
import pytest
from cli_support import invoke, ok
from fleet_support import differing

from wheelsoil.fleet import Damage, ask, open_store
from wheelsoil.wording.store_text import damage_lines

Damaging = Callable[[Path, str], None]


def _one(store: Path, table: str, campaign: str) -> Path:
    [path] = (store / table / f"campaign={campaign.replace('/', '%2F')}").glob("*.parquet")
    return path


def _manifest(store: Path, campaign: str) -> Path:
    [path] = (store / "done").glob(f"{campaign.replace('/', '%2F')}.*")
    return path


def _cut(store: Path, campaign: str) -> None:
    path = _one(store, "campaigns", campaign)
    path.write_bytes(path.read_bytes()[:700])


def _cut_footer(store: Path, campaign: str) -> None:
    path = _one(store, "campaigns", campaign)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) - 200] + whole[-8:] + bytes(192))  # as long as it was


def _other_footer(store: Path, campaign: str) -> None:
    path = _one(store, "campaigns", campaign)
    whole = path.read_bytes()
    path.write_bytes(whole[:-300] + bytes(292) + whole[-8:])


def _emptied(store: Path, campaign: str) -> None:
    _one(store, "campaigns", campaign).write_bytes(b"")


def _removed(store: Path, campaign: str) -> None:
    _one(store, "campaigns", campaign).unlink()


def _another_table(store: Path, campaign: str) -> None:
    shutil.copy(_one(store, "diagnoses", "spring/day-5"), _one(store, "campaigns", campaign))
    _without_sizes(_manifest(store, campaign))


def _another_campaign(store: Path, campaign: str) -> None:
    shutil.copy(_one(store, "campaigns", "autumn/day-6"), _one(store, "campaigns", campaign))
    _without_sizes(_manifest(store, campaign))


def _without_sizes(manifest: Path) -> None:
    """Make it one of a store of before sizes and checksums were kept."""
    values = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({key: value for key, value in values.items() if key not in ("parts", "checksum")}))


def _flipped(store: Path, campaign: str) -> None:
    path = _one(store, "campaigns", campaign)
    data = bytearray(path.read_bytes())
    data[60] ^= 0xFF
    path.write_bytes(data)


def _flipped_of_old(store: Path, campaign: str) -> None:
    _flipped(store, campaign)
    _without_sizes(_manifest(store, campaign))


def _no_manifest(text: str) -> Damaging:
    def damage(store: Path, campaign: str) -> None:
        _manifest(store, campaign).write_text(text)

    return damage


def _key(name: str, value: object) -> Damaging:
    def damage(store: Path, campaign: str) -> None:
        path = _manifest(store, campaign)
        path.write_text(json.dumps(json.loads(path.read_text()) | {name: value}))

    return damage


def _other_manifest(store: Path, campaign: str) -> None:
    shutil.copy(_manifest(store, "autumn/day-6"), _manifest(store, campaign))


DAMAGES: dict[str, Damaging] = {
    "cut": _cut,
    "footer cut": _cut_footer,
    "footer overwritten": _other_footer,
    "emptied": _emptied,
    "removed": _removed,
    "another table": _another_table,
    "another campaign": _another_campaign,
    "byte flipped": _flipped,
    "byte flipped, old manifest": _flipped_of_old,
    "manifest {}": _no_manifest("{}"),
    "manifest []": _no_manifest("[]"),
    "manifest empty": _no_manifest(""),
    "manifest of noughts": _no_manifest("\0" * 300),
    "unknown key": _key("foo", 1),
    "rows of an unknown table": _key("rows", {"foo": 1}),
    "rows are a text": _key("rows", "seven"),
    "another verdict": _key("verdict", "named"),
    "another campaign's manifest": _other_manifest,
}
OF_ALL = "select campaign from campaigns order by campaign"


EXTREMES = ("cut", "removed", "another campaign", "byte flipped", "manifest {}", "unknown key", "another verdict")


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind not in EXTREMES)) for kind in DAMAGES]
)
def test_a_damaged_campaign_is_named_and_the_others_answer(
    kind: str, store: Path, whole: dict[str, pa.Table], tmp_path: Path
) -> None:
    campaign, own = "spring/day-3", tmp_path / "own"
    shutil.copytree(store, own)
    DAMAGES[kind](own, campaign)
    expected = [row["campaign"] for row in whole["campaigns"].to_pylist() if row["campaign"] != campaign]
    answer = invoke("fleet", "sql", own, "from campaigns order by campaign", "--json")
    assert answer.code == 1 and [row["campaign"] for row in answer.json] == expected
    assert f"  {campaign}: " in answer.err and "next: `wheelsoil fleet run ROOT" in answer.err
    checked = invoke("fleet", "check", own, "--json")
    assert checked.code == 1 and checked.json["campaigns"] == 7
    assert {one["campaign"] for one in checked.json["damaged"]} == {campaign}
    status = invoke("fleet", "status", own)
    if not kind.startswith("byte flipped"):  # which only those see that read it
        assert status.code == 1 and campaign in status.err and "7, 1 failed" in status.out


@pytest.mark.parametrize("kind", ["cut", "byte flipped", "unknown key"])
def test_every_command_answers_without_it(kind: str, store: Path, tmp_path: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(store, own)
    DAMAGES[kind](own, "spring/day-3")
    report = invoke("fleet", "report", own, "-o", tmp_path / "fleet.html")
    assert (
        report.code == 1
        and "spring/day-3" in report.err
        and "1 damaged, set aside" in (tmp_path / "fleet.html").read_text()
    )
    assert len(json.loads((tmp_path / "fleet.json").read_text())["campaigns"]) == 7
    exported = invoke("fleet", "export", own, "-o", tmp_path / "tables")
    assert exported.code == 1 and "spring/day-3" in exported.err
    assert invoke("fleet", "diagnose", own).code == (kind != "byte flipped")  # in a column that it does not read


def test_the_head_of_a_store_is_made_anew(store: Path, tmp_path: Path, fleet: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(store, own)
    for head in ("[]", "", "{}", '{"schema": 1}', "\0\0"):
        (own / "store.json").write_text(head)
        said = invoke("fleet", "sql", own, OF_ALL, "--json")
        assert said.code == 1 and len(said.json) == 8 and "store.json cannot be read" in said.err
    assert invoke("fleet", "run", fleet, "--store", own).code == 1  # one is broken
    assert "8 campaigns in 62 files are as they were written" in ok("fleet", "check", own).out
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "store.json").write_text("[]")
    other = invoke("fleet", "status", tmp_path / "other")
    assert other.code == 2 and "there is no store" in other.err


@pytest.mark.usefixtures("warm", "one_process")
def test_what_is_damaged_is_made_anew(fleet: Path, store: Path, whole: dict[str, pa.Table], tmp_path: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(store, own)
    damaged = ("bench/wheel", "broken")  # which are soon made
    _flipped(own, "bench/wheel")
    DAMAGES["manifest {}"](own, "broken")
    again = invoke("fleet", "run", fleet, "--store", own, "--check")
    assert again.code == 1 and "6 in the store already" in again.err  # one is broken
    assert f"made anew, since their files in the store are damaged: {', '.join(damaged)}" in again.err
    ok("fleet", "check", own)
    assert not differing(own, whole)
    for name in whole:
        assert len(list((own / name).rglob("*.parquet"))) == len(list((store / name).rglob("*.parquet")))


def test_a_file_that_is_not_asked_for_stops_no_query(store: Path, tmp_path: Path) -> None:
    own = tmp_path / "own"
    shutil.copytree(store, own)
    _one(own, "samples", "spring/day-1").write_bytes(b"PAR1")
    assert len(ask(open_store(str(own)), OF_ALL).damaged) == 0
    found = ask(open_store(str(own)), "select count(distinct campaign) as n from samples")
    assert found.rows.to_pylist() == [{"n": 5}] and [one.what for one in found.damaged] == ["size"]


@pytest.mark.parametrize(("count", "more"), [(40, []), (42, ["  and 2 more files"])])
def test_of_many_damaged_files_the_first_are_listed_and_the_rest_counted(count: int, more: list[str]) -> None:
    damaged = [Damage(f"day {i}", f"rows/{i}.parquet", "size", f"manifests/{i}") for i in range(count)]
    first, *listed, step = damage_lines("s", damaged)
    assert first.startswith(f"{count} campaigns") and step.startswith("next:")
    assert listed[40:] == more and listed[39] == "  day 39: the file is not as long as it was (rows/39.parquet)"


def test_what_is_asked_anew_is_not_answered_from_a_cache(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "s"), create=True)
    with patch.object(store.files, "invalidate_cache") as forget:
        assert not store._holds("none") and not forget.called
        assert not store._holds("none", anew=True) and forget.called
