"""A fleet of vehicles with several instrumented wheels: rows of each, of all together, and no number counted twice."""

from __future__ import annotations

import re
import shutil
import tarfile
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from cli_support import invoke, ok, silence
from diagnosis_samples import diagnosis
from fleet_support import differing, in_one_process, killed_at, rows_of
from live_browser import shown
from playwright.sync_api import Browser, expect
from shared_results import made_once

from daq import DataError
from model.diagnosis import Campaign, Diagnosis
from wheelsoil.fleet import COLUMNS, Overview, ask, compact, holdings_of, open_store, overview_of, plan_fleet, pool

IDS = ("FL", "RL")
ZERO_NM = 150.0
OF_EACH = {(day, wheel) for day in ("day-1", "day-2") for wheel in IDS}
OF_ALL = {("day-1", "all"), ("day-2", "all")}


def simulate(folder: Path, day: int, *hidden: object) -> None:
    """Simulate a campaign of three runs with two wheels, whose transducers are WFT-FL and WFT-RL."""
    place = folder / f"day-{day}"
    ok("simulate", "-o", place, "--wheels", 2, "--runs", 3, "--duration", 15, "--seed", day, *hidden)
    parts = (place / "vehicle.toml").read_text(encoding="utf-8").split("[wheel.transducer]")
    text = parts[0] + "".join(
        f'[wheel.transducer]\nserial = "WFT-{wheel}"{part}' for wheel, part in zip(IDS, parts[1:], strict=True)
    )
    (place / "vehicle.toml").write_text(text, encoding="utf-8")


@pytest.fixture(scope="session")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of two campaigns; the rear left torque of day 2 has a zero. Not to be written to."""

    def make(folder: Path) -> None:
        simulate(folder, 1)
        simulate(folder, 2, "--effect", f"torque_zero:offset_nm={ZERO_NM}", "--faulty-wheel", "RL")

    return made_once(tmp_path_factory, "field-of-wheels", make)


@pytest.fixture(scope="session")
def made(field: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of their store and of the diagnoses kept. Not to be written to."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch, in_one_process():
            patch.setenv("WHEELSOIL_CACHE", str(folder / "kept"))
            ok("fleet", "run", field, "--store", folder / "store")

    return made_once(tmp_path_factory, "fleet-of-wheels", make)


@pytest.fixture(scope="session")
def tables(made: Path) -> dict[str, pa.Table]:
    return rows_of(made / "store")


@pytest.fixture
def warm(made: Path, place: Path) -> None:
    """Keep the diagnoses for a test."""
    shutil.copytree(made / "kept", place)


@pytest.fixture(scope="session")
def overview(made: Path) -> Overview:
    return overview_of(open_store(str(made / "store")))


def keys(table: pa.Table) -> set[tuple[str, str]]:
    """Return the campaign and wheel of each row."""
    return set(zip(table["campaign"].to_pylist(), table["wheel"].to_pylist(), strict=True))


def test_each_wheel_has_its_rows_and_all_together_theirs(field: Path, tables: dict[str, pa.Table]) -> None:
    for name in ("campaigns", "runs", "samples", "fits"):
        assert keys(tables[name]) == OF_EACH, name
    for name in ("diagnoses", "causes", "gains", "coefficients", "evidence"):
        assert keys(tables[name]) == OF_EACH | OF_ALL, name
    rows = tables["campaigns"].to_pylist()
    assert [row["transducer"] for row in rows] == ["WFT-FL", "WFT-RL"] * 2
    assert [row["state"] for row in rows] == ["done"] * 4 and all(row["pull_at_slip_0_2_n"] is not None for row in rows)
    runs = Counter((row["campaign"], row["wheel"], row["run"]) for row in tables["runs"].to_pylist())
    assert len(runs) == 12 and set(runs.values()) == {1}
    alone = ok("fit", field / "day-1", "--wheel", "RL", "--json").json["models"]
    fits = [row for row in tables["fits"].to_pylist() if (row["campaign"], row["wheel"]) == ("day-1", "RL")]
    found = {row["model"]: row["R0"] for row in fits if row["channel"] == "drawbar_pull"}
    assert found == {name: pytest.approx(one["criteria"]["dp"]["R0_N"], rel=1e-9) for name, one in alone.items()}


def test_what_is_of_the_vehicle_is_counted_once(made: Path, tables: dict[str, pa.Table]) -> None:
    sensors = Counter((row["campaign"], row["role"], row["wheel"]) for row in tables["sensors"].to_pylist())
    assert set(sensors.values()) == {3}, "three runs"
    assert {wheel for _, role, wheel in sensors if role == "ground_speed"} == {""}
    assert {wheel for _, role, wheel in sensors if role == "drawbar_pull"} == set(IDS)
    tasks = ok("fleet", "sql", made / "store", "select campaign, verdict, wheels from tasks", "--json").json
    assert tasks == [
        {"campaign": "day-1", "verdict": "nothing_detectable", "wheels": 2},
        {"campaign": "day-2", "verdict": "named", "wheels": 2},
    ]
    status = ok("fleet", "status", made / "store", "--json").json
    assert (status["campaigns"], status["verdicts"]) == (2, {"nothing_detectable": 1, "named": 1})
    ok("fleet", "check", made / "store")


def test_a_cause_has_the_wheel_at_which_it_acts(tables: dict[str, pa.Table]) -> None:
    named = [row for row in tables["causes"].to_pylist() if row["role"] == "named"]
    places = [(row["campaign"], row["wheel"], row["family"], row["at_wheel"]) for row in named]
    assert ("day-2", "all", "torque_zero", "RL") in places
    assert {place[0] for place in places} == {"day-2"}
    [zero] = [row for row in named if row["wheel"] == "all"]
    assert zero["lower95"] < ZERO_NM < zero["upper95"] and zero["effect"] == "torque_zero"
    of_all = [row for row in tables["causes"].to_pylist() if row["wheel"] == "all"]
    assert {row["at_wheel"] for row in of_all} == {None, *IDS}
    assert not any("@" in row["family"] for row in of_all)


def test_transducers_are_those_of_the_wheels(made: Path) -> None:
    found = ok("fleet", "diagnose", made / "store", "--json").json
    assert [(one["serial"], one["campaigns"]) for one in found["transducers"]] == [
        ("WFT-FL", ["day-1", "day-2"]),
        ("WFT-RL", ["day-1", "day-2"]),
    ]
    for one in found["transducers"]:
        points = [point for trend in one["trends"].values() for point in trend["points"]]
        assert {point["wheel"] for point in points} == {one["serial"].removeprefix("WFT-")}
    [error] = found["named_by_campaigns"]
    assert (error["campaign"], error["wheel"], error["serial"]) == ("day-2", "RL", "WFT-RL")
    said = ok("fleet", "diagnose", made / "store").out
    assert "day-2, wheel RL (WFT-RL, 2026-" in said and "WFT-FL: 2 campaigns" in said


@pytest.mark.usefixtures("one_process")
def test_a_soil_off_its_laboratory_is_that_of_the_campaign_and_counts_once(field: Path, tmp_path: Path) -> None:
    """All wheels together have one soil; what they say together is of no transducer, and yet not without a serial."""
    day = shutil.copytree(field / "day-1", tmp_path / "field" / "day")
    text = (day / "terrain.toml").read_text(encoding="utf-8")
    (day / "terrain.toml").write_text(text.replace("friction_angle_deg = 14.0", "friction_angle_deg = 18.0"), "utf-8")
    ok("fleet", "run", day.parent, "--store", tmp_path / "s", "--effects", "torque_zero")
    found = ok("fleet", "diagnose", tmp_path / "s", "--json").json
    assert [(soil["campaign"], soil["wheel"]) for soil in found["soils_off_laboratory"]] == [("day", "all")]
    assert max(found["soils_off_laboratory"][0]["sigmas"].items(), key=lambda item: abs(item[1]))[0] == "tan_phi"
    assert found["without_serial"] == found["without_date"] == []
    assert "day, all wheels: " in ok("fleet", "diagnose", tmp_path / "s").out


def test_the_page_has_each_wheel_and_counts_campaigns(overview: Overview, tmp_path: Path) -> None:
    page, numbers = overview.html(tmp_path), overview.numbers()
    assert overview.count == overview.done == 2
    assert "<title>Fleet: 2 campaigns</title>" in page and "✓ none failed" in page
    assert numbers["causes"]["torque_zero"] == {"named": 1, "one_of": 0}
    assert [(pull["terrain"], pull["campaigns"]) for pull in numbers["pulls"]] == [("clay", 2)]
    own = [row["pull_at_slip_0_2_n"] for row in numbers["campaigns"] if row["wheel"] != "all"]
    assert numbers["pulls"][0]["median_n"] == pytest.approx(sum(own) / 4)
    assert {(row["campaign"], row["wheel"]) for row in numbers["campaigns"]} == OF_EACH | OF_ALL
    rows = re.findall(r'<tr data-campaign="(day-\d)"><td class="name">[^/]*<small>([^<]+)</small>', page)
    assert sorted(rows) == [
        (day, wheel) for day in ("day-1", "day-2") for wheel in ("all wheels", "wheel FL", "wheel RL")
    ]
    assert "torque zero of wheel RL" in page
    assert len(re.findall(r'<circle class="dens', page)) == 2


def test_a_search_counts_campaigns_and_not_their_rows(overview: Overview, tmp_path: Path, browser: Browser) -> None:
    page, _ = overview.write(tmp_path / "fleet.html")
    seen = browser.new_page()
    with closing(seen), shown(seen, page.as_uri(), {}):
        expect(seen.locator("#count")).to_have_text("2 campaigns")
        seen.get_by_label("Search").fill("wheel RL day-2")
        expect(seen.locator("#count")).to_have_text("1 of 2")
        expect(seen.locator("#table tbody tr:not([hidden])")).to_have_count(2)


def mended(folder: Path, before: str, after: str) -> None:
    file = folder / "vehicle.toml"
    text = file.read_text(encoding="utf-8")
    assert before in text
    file.write_text(text.replace(before, after), encoding="utf-8")


@pytest.mark.usefixtures("warm", "one_process")
def test_a_wheel_that_fails_says_why_and_the_other_has_its_rows(field: Path, tmp_path: Path) -> None:
    day, url = tmp_path / "field" / "day-1", tmp_path / "store"
    shutil.copytree(field / "day-1", day)
    mended(day, "can1:WFT_Moments.My", "can1:WFT_Moments.Mq")
    failed = invoke("fleet", "run", tmp_path / "field", "--store", url, "--json")
    assert failed.code == 1 and list(failed.json["failed"]) == ["day-1"]
    assert failed.json["failed"]["day-1"].startswith("wheel RL: no DBC has a signal 'WFT_Moments.Mq'")
    tables = rows_of(url)
    rows = {row["wheel"]: row for row in tables["campaigns"].to_pylist()}
    assert rows["FL"]["state"] == "done" and rows["FL"]["pull_at_slip_0_2_n"] is not None
    assert rows["RL"]["state"] == "failed" and "WFT_Moments.Mq" in rows["RL"]["fault"]
    assert keys(tables["diagnoses"]) == keys(tables["samples"]) == {("day-1", "FL")}
    assert overview_of(open_store(str(url))).done == 0
    assert not plan_fleet([tmp_path / "field"], str(url)).todo
    assert len(plan_fleet([tmp_path / "field"], str(url), retry_failed=True).todo) == 1
    mended(day, "can1:WFT_Moments.Mq", "can1:WFT_Moments.My")
    ok("fleet", "run", tmp_path / "field", "--store", url)
    assert keys(rows_of(url)["diagnoses"]) == {("day-1", wheel) for wheel in (*IDS, "all")}


@pytest.mark.usefixtures("one_process")
def test_a_silent_wheel_is_neither_done_nor_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    day, url, together = tmp_path / "field" / "day", tmp_path / "store", []
    day.parent.mkdir()
    ok("simulate", "-o", day, "--wheels", 4, "--runs", 1, "--duration", 15, "--format", "candump")
    silence(day / "run-1.log", "can3")

    def by_hand(campaigns: Sequence[Campaign], _: object) -> Diagnosis:
        together.append([campaign.of_vehicle.wheel for campaign in campaigns if campaign.of_vehicle])
        return diagnosis("nothing_detectable")

    monkeypatch.setattr("wheelsoil.fleet.campaign_task.diagnose_campaigns", by_hand)
    said = ok("fleet", "run", day.parent, "--store", url).err
    assert "day: done, nothing detectable; wheel RR: vertical_load is missing; can3:WFT_Forces.Fz" in said
    tables = rows_of(url)
    states = {row["wheel"]: (row["state"], row["fault"]) for row in tables["campaigns"].to_pylist()}
    assert states["RR"][0] == "silent" and "holds no sample" in states["RR"][1] and states["FL"] == ("done", None)
    assert keys(tables["diagnoses"]) == {("day", wheel) for wheel in ("FL", "FR", "RL", "all")}
    assert together == [[], [], [], ["FL", "FR", "RL"]]
    assert "silent: day: wheel RR: vertical_load is missing" in ok("fleet", "status", url).out
    page = overview_of(open_store(str(url))).html(tmp_path)
    assert '<span class="level">▲ silent</span> vertical_load is missing' in page
    assert '<span class="badge is-fair">▲ 1 wheel silent</span>' in page
    assert page.count("▲ silent") == 1, "all wheels together are not"
    assert "1 in the store already" in ok("fleet", "run", day.parent, "--store", url).err


@pytest.mark.usefixtures("warm", "one_process")
def test_a_diagnosis_of_all_wheels_that_fails_leaves_each_its_own(
    field: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> object:
        raise DataError.of("nothing in common")

    shutil.copytree(field / "day-2", tmp_path / "field" / "day-2")
    (tmp_path / "field" / "day-2" / "report-RL.html").touch()
    monkeypatch.setattr("wheelsoil.fleet.campaign_task.vehicles_of", refused)
    failed = invoke("fleet", "run", tmp_path / "field", "--store", tmp_path / "s", "--json")
    assert failed.code == 1 and failed.json["failed"] == {"day-2": "all wheels together: nothing in common"}
    tables = rows_of(tmp_path / "s")
    assert keys(tables["diagnoses"]) == {("day-2", wheel) for wheel in IDS}
    faults = {row["wheel"]: row["fault"] for row in tables["campaigns"].to_pylist()}
    assert faults == {"FL": None, "RL": None, "all": "nothing in common"}
    store = open_store(str(tmp_path / "s"))
    assert [(error.wheel, error.serial) for error in pool(store).named] == [("RL", "WFT-RL")]
    overview = overview_of(store)
    assert (overview.count, overview.done, overview.causes["torque_zero"]) == (1, 0, (1, 0))
    page = overview.html(tmp_path)
    assert page.count('href="field/day-2/report-RL.html"') == 1 and "▲ 1 failed" in page


@pytest.mark.usefixtures("warm", "one_process")
def test_a_call_that_is_killed_is_taken_up_again(field: Path, tables: dict[str, pa.Table], tmp_path: Path) -> None:
    call = ("fleet", "run", field, "--store", tmp_path / "s")
    killed_at(17, *call)
    assert "1 in the store already" in ok(*call).err
    assert not differing(tmp_path / "s", tables)


def test_a_store_of_before_takes_wheels_and_is_compacted_without_loss(
    made: Path, tables: dict[str, pa.Table], tmp_path: Path
) -> None:
    with tarfile.open(Path(__file__).with_name("store_of_2026_11_24.tar.xz")) as kept:
        kept.extractall(tmp_path, filter="data")
    url = tmp_path / "store"
    before = rows_of(url)
    for table in before.values():
        assert set(table["wheel"].to_pylist()) <= {""}
    for folder in (made / "store").iterdir():
        if folder.is_dir():
            shutil.copytree(folder, url / folder.name, dirs_exist_ok=True)
    together = {name: pa.concat_tables([before[name], tables[name]]) for name in COLUMNS}

    def check() -> None:
        assert not differing(url, together)
        assert _answer(url, "select count(*) n from causes where wheel = ''") == [{"n": 16}]
        assert _answer(url, "select distinct wheel from diagnoses order by 1") == [
            {"wheel": wheel} for wheel in ("", "FL", "RL", "all")
        ]
        joined = "select count(*) n from campaigns join diagnoses using (campaign, wheel)"
        assert _answer(url, joined) == [{"n": 5}]
        assert not holdings_of(open_store(str(url)), thorough=True).damaged
        assert overview_of(open_store(str(url))).count == 3

    check()
    compact(open_store(str(url)))
    assert not list(url.glob("done/*"))
    check()


def test_a_pack_of_before_is_compacted_with_wheels(made: Path, tmp_path: Path) -> None:
    """What compaction wrote before there was a column for the wheel."""
    from wheelsoil.fleet import Manifest, packs, tables

    with tarfile.open(Path(__file__).with_name("store_of_2026_11_24.tar.xz")) as kept:
        kept.extractall(tmp_path, filter="data")
    url = tmp_path / "store"
    before = rows_of(url)
    old = {name: tables.packed_schema_of(name, wheels=False) for name in COLUMNS}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packs, "packed_schema_of", old.__getitem__)
        rows = packs._rows
        patch.setattr(packs, "_rows", lambda *given: {k: t.select(old[k].names) for k, t in rows(*given).items()})
        patch.setattr(packs, "_packed", lambda manifest, _: manifest)
        compact(open_store(str(url)))
    [part] = holdings_of(open_store(str(url))).parts
    assert part.is_pack and not part.has_wheels and isinstance(next(iter(part.all)), Manifest)
    assert not differing(url, before) and _answer(url, "select distinct wheel from causes") == [{"wheel": ""}]
    for folder in (made / "store").iterdir():
        if folder.is_dir():
            shutil.copytree(folder, url / folder.name, dirs_exist_ok=True)
    compact(open_store(str(url)))
    [part] = holdings_of(open_store(str(url))).parts
    assert part.has_wheels
    rows_now = rows_of(url)
    assert rows_now["causes"].slice(0, 16).equals(before["causes"])
    assert _answer(url, "select count(*) n from campaigns") == [{"n": 5}]


def _answer(url: Path, sql: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = ask(open_store(str(url)), sql).rows.to_pylist()
    return rows
