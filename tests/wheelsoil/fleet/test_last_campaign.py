"""The campaign of a store that a report is compared with, and what is meant by a place that could be both."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pyarrow as pa
import pytest
from fleet_support import rows_of

from daq import ConfigError
from wheelsoil.fleet import Manifest, Store, last_campaign, open_store
from wheelsoil.fleet.tables import schema_of
from wheelsoil.wording.change_text import of_another_thing
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.last_report import changes_since, load_last, store_meant

DAY_S = 86_400
MAY_S = int(datetime(2026, 5, 1, 8, tzinfo=UTC).timestamp())
ESTIMATE = {"value": 0.30, "lower95": 0.28, "upper95": 0.32, "unit": "1"}
SIZE = {"parameter": "offset_nm", "unit": "N m", "value": 78.0, "lower95": 73.0, "upper95": 83.0}


def runs_of(day: int, folder: str = "/field/today", serial: str = "WFT-1", wheel: str = "") -> Processed:
    run = SimpleNamespace(
        path=Path(folder, "run-1.mcap"),
        vehicle=SimpleNamespace(
            vehicle=SimpleNamespace(name="tractor"),
            transducer=SimpleNamespace(serial=serial),
            wheel=SimpleNamespace(id=wheel),
        ),
        terrain=SimpleNamespace(soil=SimpleNamespace(name="clay")),
    )
    return cast(Processed, [(run, SimpleNamespace(start_ns=(MAY_S + day * DAY_S) * 10**9))])


def put(store: Store, name: str, day: int, more: dict[str, list[dict[str, Any]]] | None = None, **own: Any) -> None:
    """Write a campaign of a day in May; `own` are columns of its row."""
    start = datetime.fromtimestamp(MAY_S + day * DAY_S, UTC)
    row = {"state": "done", "path": f"/field/{name}", "vehicle": "tractor", "transducer": "WFT-1", "terrain": "clay"}
    row |= {"start": start, "used_share": 0.75, "pull_at_slip_0_2_n": 700.0} | own
    edges = {"pull_at_slip_0_2_lower95_n": 670.0, "pull_at_slip_0_2_upper95_n": 730.0}
    tables = {"campaigns": [row | edges], **(more or {})}
    made = {key: pa.Table.from_pylist(rows, schema=schema_of(key)) for key, rows in tables.items()}
    store.put(Manifest(name, "0" * 16, "done", rows={key: len(rows) for key, rows in tables.items()}), made)


@pytest.fixture
def own(tmp_path: Path) -> Store:
    """Return an empty store."""
    return open_store(str(tmp_path / "store"), create=True)


def test_it_is_the_latest_earlier_one_of_the_same_vehicle_terrain_and_transducer(own: Store) -> None:
    put(own, "first", 1)
    put(own, "second", 2)
    put(own, "other wheel", 3, transducer="WFT-2")
    put(own, "other soil", 4, terrain="sand")
    put(own, "failed", 4, state="failed")
    put(own, "today", 5)
    put(own, "later", 6)
    assert last_campaign(own, runs_of(5))[0].name == "second"
    assert last_campaign(own, runs_of(5, serial="WFT-2"))[0].name == "other wheel"
    assert last_campaign(own, runs_of(5, serial="WFT-9"))[0].name == "other wheel"
    assert last_campaign(own, runs_of(2))[0].name == "first"
    with pytest.raises(ConfigError, match="no earlier campaign of this vehicle") as refused:
        last_campaign(own, runs_of(1, folder="/field/first"))
    for words in ("5 other campaigns, 4 of this", "before 2026-05-02 08:00 UTC", "wheelsoil fleet run"):
        assert words in str(refused.value)


def test_another_wheel_and_transducer_of_a_vehicle_of_that_name_is_said(own: Store) -> None:
    put(own, "first", 1, wheel_radius_m=0.47, wheel_width_m=0.318)
    last = last_campaign(own, runs_of(5, serial="WFT-9"))[0]
    assert last.subject == {"transducer": "WFT-1", "wheel radius r": "0.47 m", "wheel width b": "0.318 m"}
    other = of_another_thing(last, {"vehicle": "tractor", "wheel radius r": "0.6 m", "transducer": "WFT-9"})
    assert other == "the last campaign is of transducer WFT-1, not WFT-9; wheel radius r 0.47 m, not 0.6 m"


def test_a_wheel_is_compared_with_itself(own: Store) -> None:
    sizes = {"FL": 41.0, "RL": 20.0, "all": 30.0}
    gains = [{"wheel": wheel, "model": "base", "channel": "driving_torque", "R0": r} for wheel, r in sizes.items()]
    put(own, "single", 1)
    put(own, "both", 2, {"gains": gains}, wheel="FL")
    last = last_campaign(own, runs_of(5, wheel="FL"))[0]
    [error] = [one for one in last.stated if one.kind == "error"]
    assert (last.name, error.value) == ("both", 41.0)
    assert last_campaign(own, runs_of(5, wheel="RL"))[0].name == "single"
    assert last_campaign(own, runs_of(5))[0].name == "single"
    with pytest.raises(ConfigError, match="tractor' on 'clay', wheel RL, before 2026-05-02"):
        last_campaign(own, runs_of(1, wheel="RL"))


def test_its_soil_causes_pull_error_and_data_are_compared(own: Store) -> None:
    more = {
        "coefficients": [
            {"model": "recommended", "parameter": "tan_phi", **ESTIMATE},
            {"model": "lyasko", "parameter": "m1", **ESTIMATE},
        ],
        "causes": [
            {"family": "torque_zero", "role": "named", **SIZE},
            {"family": "drawbar_pull_zero", "role": "barred", **SIZE},
            {"family": "slip_sinkage", "role": "candidate"},
        ],
        "gains": [
            {"model": "base", "channel": "driving_torque", "R0": 41.0},
            {"model": "extended", "channel": "driving_torque", "R0": 20.0},
        ],
    }
    put(own, "monday", 1, more)
    last, damaged = last_campaign(own, runs_of(5))
    assert not damaged and (last.kind, last.name, last.made_at[:10]) == ("campaign", "monday", "2026-05-02")
    now = {
        "fit": {
            "soils": [{"campaign": "today", "values": {"tan_phi": 0.36}, "sigmas": {"tan_phi": 0.01}}],
            "traction": {"pull": {"pull_n": 720.0, "interval95": [690.0, 750.0]}},
        },
        "causes": {"causes": []},
        "runs": {"run-1": {"usable_share": 0.9}},
        "quality": {"a": {"samples": 300, "used_share": 0.8}, "b": {"samples": 100, "used_share": 0.4}},
        "glance": {"key_figures": {"error.t.calibrated_soil": {"value": 44.0, "unit": "N m"}}},
    }
    found = {change.name: change for change in changes_since(last, now)}
    assert [name for name, change in found.items() if change.beyond] == [
        ("torque_zero", "offset_nm"),
        ("soil", "tan_phi"),
    ]
    assert (last.driven, found["soil", "tan_phi"].unit) == ("2 May 2026", "")
    assert found["soil", "tan_phi"].difference == pytest.approx(0.06)
    assert found["soil", "tan_phi"].last_half95 == pytest.approx(0.02)
    assert found["pull_at_slip_0.2",].difference == pytest.approx(20.0)
    assert found["error", "t", "calibrated_soil"].difference == pytest.approx(3.0)
    assert found["used_share",].difference == pytest.approx(0.7 - 0.75)
    assert len(found) == 5  # a usable share of the samples in motion is not in a store


def test_a_fleet_keeps_the_soil_of_each_diagnosis(store: Path) -> None:
    soils = [row for row in rows_of(store)["coefficients"].to_pylist() if row["model"].endswith(("soil", "mended"))]
    day = {row["parameter"]: row for row in soils if row["campaign"] == "spring/day-1"}
    assert {"tan_phi", "cohesion_pa"} <= day.keys() and day["cohesion_pa"]["unit"] == "Pa"
    assert all(row["lower95"] < row["value"] < row["upper95"] for row in day.values())


def test_a_folder_means_its_report_before_the_store_that_it_is(tmp_path: Path) -> None:
    head = tmp_path / "store.json"
    head.write_text('{"schema": "wheelsoil/store/1"}')
    assert store_meant(str(tmp_path)) == store_meant(str(head)) == str(tmp_path)
    assert store_meant("s3://bucket/fleet") == "s3://bucket/fleet"
    report = {"schema": "wheelsoil/report/2", "made_at": "2026-05-04T10:00:00", "sections": {}}
    (tmp_path / "report.json").write_text(json.dumps(report))
    assert store_meant(str(tmp_path)) is None and load_last(tmp_path).name == "report.json"
    assert store_meant(str(head)) == str(tmp_path)


def test_a_report_may_be_called_store(tmp_path: Path) -> None:
    report = {"schema": "wheelsoil/report/2", "made_at": "2026-05-04T10:00:00", "sections": {}}
    (tmp_path / "store.json").write_text(json.dumps(report))
    (tmp_path / "store.html").write_text("")
    for place in (tmp_path, tmp_path / "store.json", tmp_path / "store.html"):
        assert store_meant(str(place)) is None and load_last(place).name == "store.json"
