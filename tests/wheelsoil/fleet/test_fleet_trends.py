"""What campaigns say of their transducers over the days, by themselves, and against the last one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from cli_support import ok
from fleet_support import rows_of

from model.diagnosis.pooling import Passport, Point, Trend
from wheelsoil.fleet import Change, Manifest, Store, holdings_of, open_store, overview_of, pool
from wheelsoil.fleet.overview import _map
from wheelsoil.fleet.pooled import _observations
from wheelsoil.fleet.tables import schema_of
from wheelsoil.fleet.trend_figures import averaged
from wheelsoil.wording.passport_text import passport_line, trend_lines

BEGIN = datetime(2026, 5, 4, 8, tzinfo=UTC)


@pytest.fixture
def empty(tmp_path: Path) -> Store:
    """Return a store without campaigns."""
    return open_store(str(tmp_path / "s"), create=True)


def _put(store: Store, name: str, day: int | None, causes: Mapping[str, Any] | None = None, **own: Any) -> None:
    """Write a campaign of a day, with a cause."""
    start = None if day is None else BEGIN + timedelta(days=day)
    row = {"content": name, "state": "done", "path": "", "start": start, **own}
    rows: dict[str, list[dict[str, Any]]] = {"campaigns": [row]}
    if causes:
        rows["causes"] = [{"content": name, "role": "named", **causes}]
    tables = {table: pa.Table.from_pylist(each, schema_of(table)) for table, each in rows.items()}
    counts = {table: len(each) for table, each in tables.items()}
    verdict = "named" if causes else "nothing_detectable"
    store.put(Manifest(name, name, row["state"], verdict=verdict, rows=counts), tables)


def _error(family: str, kind: str = "measurement") -> dict[str, Any]:
    value = {"parameter": "offset", "unit": "N m", "value": 12.0, "lower95": 10.0, "upper95": 14.0}
    return {"family": family, "kind": kind, "probability": 0.98, **value}


def test_a_campaign_that_names_an_error_of_the_transducer_counts(empty: Store, tmp_path: Path) -> None:
    _put(empty, "a", 0, _error("torque_zero"), transducer="WFT-9")
    _put(empty, "b", 1, _error("speed_bias"), transducer="WFT-8")
    _put(empty, "c", 2, _error("slope", "physical"), transducer="WFT-7")
    _put(empty, "d", None, _error("load_zero"))
    found = pool(empty)
    assert [one.campaign for one in found.named] == ["b", "a", "d"]
    assert found.wrong == found.transducers == ("", "WFT-9")
    overview = overview_of(empty)
    assert overview.headline == "2 of 4 campaigns name an error of the transducer: torque zero and load zero."
    assert "2 <small>of 2 wrong</small>" in overview.html(tmp_path)
    said = ok("fleet", "diagnose", empty.url).out
    assert "a (WFT-9, 2026-05-04): torque zero 12 N m (10 N m to 14 N m), 98.0 %" in said
    assert "b (not the transducer's, 2026-05-05): speed bias" in said
    assert "d (transducer without serial): load zero" in said
    named = ok("fleet", "diagnose", empty.url, "--json").json["named_by_campaigns"]
    assert [(one["campaign"], one["value"]) for one in named] == [("b", 12.0), ("a", 12.0), ("d", 12.0)]


def test_failures_are_listed_first_then_by_verdict_and_the_larger_error(empty: Store) -> None:
    for name, state, verdict, error_n in (
        ("nothing", "done", "nothing_detectable", 900.0),
        ("one of", "done", "one_of", 500.0),
        ("named, small", "done", "named", 300.0),
        ("unexplained", "done", "unexplained", 100.0),
        ("named, large", "done", "named", 400.0),
        ("failed", "failed", None, None),
    ):
        rows = {"campaigns": {"content": name, "state": state, "path": ""}}
        if verdict:
            rows["diagnoses"] = {"content": name, "verdict": verdict, "R0_base": error_n}
        tables = {table: pa.Table.from_pylist([row], schema_of(table)) for table, row in rows.items()}
        empty.put(Manifest(name, name, state, verdict=verdict or "", rows=dict.fromkeys(rows, 1)), tables)
    names = ["failed", "unexplained", "named, large", "named, small", "one of", "nothing"]
    assert overview_of(empty).campaigns["campaign"].tolist() == names


def _changes(store: Store) -> dict[tuple[str, str], Change]:
    return {(one.of, one.name): one for one in pool(store).changes}


def test_the_last_campaign_is_compared_with_the_one_before_it(empty: Store) -> None:
    def pull(value: float, half: float) -> dict[str, float]:
        edges = zip(("lower95", "upper95"), (value - half, value + half), strict=True)
        return {"pull_at_slip_0_2_n": value} | {f"pull_at_slip_0_2_{edge}_n": each for edge, each in edges}

    _put(empty, "first", 0, vehicle="V", terrain="clay", **pull(100.0, 3.0))
    _put(empty, "then", 3, vehicle="V", terrain="sand", transducer="A", **pull(100.0, 3.0))
    _put(empty, "same time", 9, vehicle="V", terrain="clay", transducer="B", **pull(93.0, 4.0))
    _put(empty, "last", 9, _error("torque_zero"), vehicle="V", terrain="clay", transducer="B", **pull(94.0, 4.0))
    _put(empty, "no date", None, vehicle="V", terrain="clay")
    _put(empty, "failed", 20, vehicle="V", terrain="clay", state="failed")
    _put(empty, "other", 4, vehicle="W", terrain="loam")
    found = _changes(empty)
    assert set(found) == {("vehicle", "V"), ("terrain", "clay")}, "sand, loam and W were met once"
    vehicle, terrain = found["vehicle", "V"], found["terrain", "clay"]
    assert (vehicle.campaign, vehicle.before) == ("same time", "then")
    assert (terrain.campaign, terrain.before) == ("same time", "first")
    assert vehicle.differs == {"transducer": ("A", "B"), "terrain": ("sand", "clay")}
    assert terrain.pull is not None and terrain.pull.is_beyond and terrain.pull.half95_n == pytest.approx(5.0)
    _put(empty, "nearer", 10, vehicle="W", terrain="clay", **pull(95.0, 4.0))
    again = _changes(empty)["terrain", "clay"]
    assert again.pull is not None and not again.pull.is_beyond
    assert again.differs["vehicle"] == ("V", "W")
    said = ok("fleet", "diagnose", empty.url).out
    assert "terrain clay: nearer (2026-05-14) after same time (2026-05-13): vehicle V → W" in said


def test_a_cause_that_grew_is_listed_with_both_sizes(empty: Store) -> None:
    grown = _error("torque_zero") | {"value": 24.0, "lower95": 22.0, "upper95": 26.0}
    _put(empty, "spring", 0, _error("torque_zero"), vehicle="V", terrain="clay")
    _put(empty, "autumn", 9, grown, vehicle="V", terrain="clay")
    [size] = _changes(empty)["vehicle", "V"].sizes
    assert (size.last, size.now) == (12.0, 24.0)
    said = ok("fleet", "diagnose", empty.url).out
    assert "torque zero, offset went from 12.0 to 24.0 N m" in " ".join(said.split())
    [found, _] = ok("fleet", "diagnose", empty.url, "--json").json["changes"]
    assert found["sizes"][0]["difference"] == 12.0


def test_averaged_points_keep_what_is_known() -> None:
    random = np.random.default_rng(1)
    points = [Point(str(i), *random.uniform(0.5, 2.0, 3)) for i in range(143)]
    few = averaged(points, 20)
    assert averaged(points[:20], 20) == sorted(points[:20], key=lambda point: point.years) and len(few) == 20

    def known(of: list[Point]) -> tuple[float, float]:
        weight = np.array([point.sigma**-2.0 for point in of])
        return float(weight.sum()), float(weight @ [point.value for point in of])

    assert known(few) == pytest.approx(known(points))
    assert [point.years for point in few] == sorted(point.years for point in few)


def test_each_zero_and_gain_is_shown_over_the_days(store: Path, tmp_path: Path) -> None:
    said = ok("fleet", "diagnose", store).out
    passports = pool(open_store(str(store))).passports
    for one in passports:
        for effect, trend in one.trends.items():
            if effect.endswith(("_zero", "_gain")):
                assert said.count(f"    {effect.replace('_', ' ')}: ") == len(passports)
                assert f"{100 * trend.at[0]:.2f} %" in said or trend.unit != "1"
    ok("fleet", "report", store, "-o", tmp_path / "fleet.html")
    html = (tmp_path / "fleet.html").read_text()
    assert html.count('<div class="trends">') == len(passports) and html.count("load gain, %") == len(passports)


def test_a_store_in_which_no_transducer_has_a_serial_is_read(empty: Store, store: Path) -> None:
    for row in rows_of(store)["evidence"].to_pylist()[:2]:
        name = row["campaign"]
        own = {**{key: value for key, value in row.items() if key != "campaign"}, "transducer": None, "content": name}
        table = pa.Table.from_pylist([own], schema_of("evidence"))
        empty.put(Manifest(name, name, "done", verdict="named", rows={"evidence": 1}), {"evidence": table})
    assert not any(serial for serial, _ in _observations(holdings_of(empty), [None]))


@pytest.mark.parametrize(("years", "slope"), [((54.0, 54.5), "; 1.00 % (0.80 % to 1.20 %) a month"), ((54.25,), "")])
def test_a_trend_has_a_slope_where_there_are_two_dates(years: tuple[float, ...], slope: str) -> None:
    points = tuple(SimpleNamespace(years=each) for each in years)
    trend = Trend("torque_gain", "relative", "1", (0.02, 0.001), (0.12, 0.012), 54.25, points)  # type: ignore[arg-type]
    [line] = trend_lines(SimpleNamespace(trends={"torque_gain": trend}))  # type: ignore[arg-type]
    said, _, behind = line.partition(" on ")
    assert said == "torque gain: 2.00 % (1.80 % to 2.20 %)" and behind.startswith("2024-") and behind[10:] == slope


@pytest.mark.parametrize(
    ("probability", "said"), [(0.5, ""), (0.8, "; all campaigns share what is not the transducer's: slope (80 %)")]
)
def test_a_passport_says_what_is_shared_and_who_disagrees(probability: float, said: str) -> None:
    shared = (SimpleNamespace(effect="slope", probability=probability),)
    one = Passport("7", ("a", "b"), "nothing", (), 0.2, (), {}, 0.0, {"b": 0.001}, shared)  # type: ignore[arg-type]
    expected = f"7: 2 campaigns, May to June: nothing detectable{said}; not as the others: b"
    assert passport_line(one, "May", "June") == expected
    weighed = (SimpleNamespace(effect="torque_gain", probability=0.6),)
    doubted = replace(one, wrong=0.7, candidates=weighed)  # type: ignore[arg-type]
    unsure = "no cause is sure: torque gain (60.0 %) is most probable"
    assert passport_line(doubted, "May", "June") == expected.replace("nothing detectable", unsure)


@pytest.mark.parametrize(("east_deg", "north_deg"), [(0.05, 0.0), (0.0, 0.02), (0.03, -0.01)])
def test_places_are_as_far_apart_on_the_map_as_its_scale_says(east_deg: float, north_deg: float) -> None:
    latitude, longitude = [52.0, 52.0 + north_deg], [13.0, 13.0 + east_deg]
    campaigns = pd.DataFrame({"campaign": ["a", "b"], "latitude_deg": latitude, "longitude_deg": longitude})
    shown = _map(campaigns.assign(pull_at_slip_0_2_n=[100.0, 200.0])) or {}
    (x, y, *_), (other_x, other_y, *_) = shown["places"]
    pixels, text = shown["scale"]
    km = float(text.split()[0]) / (1000 if text.endswith(" m") else 1)
    expected = np.hypot(np.radians(east_deg) * np.cos(np.radians(52.0)), np.radians(north_deg)) * 6371
    assert np.hypot(other_x - x, other_y - y) * km / pixels == pytest.approx(expected, rel=0.01)
    assert np.sign([other_x - x, y - other_y]).tolist() == np.sign([east_deg, north_deg]).tolist()
