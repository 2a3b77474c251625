"""The study of wheels: its mix, what counts as right, and one campaign from frames to a line."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from blind.jsonl import read_lines
from blind.wheels import (
    COUNT,
    TRANSDUCER,
    Hidden,
    drawn,
    leaves_open,
    main,
    options_of,
    page,
    right,
    right_channel,
    right_wheel,
    with_told,
    wrong,
)
from blind.wheels_truth import WheelsYardstick


def line(seed: int, **answers: tuple[str, list[str]]) -> dict[str, Any]:
    """Return a line of a campaign: what each of alone, one and all says."""
    hidden = drawn(seed)
    said = {
        by: {"verdict": verdict, "names": names, "cpu_s": 6.0 if by == "all" else 1.0}
        for by, (verdict, names) in answers.items()
    }
    facts = {name: getattr(hidden, name) for name in ("seed", "kind", "key", "size", "wheel", "family")}
    engine = {"model": "a" * 40, "processing": "b" * 40, "dirty": False}
    return {"alone": None, "told": None, **facts, **said, "engine": engine}


def test_the_mix_is_that_which_was_asked_for() -> None:
    hidden = [drawn(seed) for seed in range(COUNT)]
    kinds = Counter(one.kind for one in hidden)
    assert kinds == {"transducer": 40, "sinkage": 20, "peak": 10, "speed": 10, "nothing": 20}
    assert {one.key for one in hidden if one.wheel} == set(TRANSDUCER)
    assert all((one.kind == "transducer") == bool(one.wheel) for one in hidden)


def test_a_name_is_right_with_its_wheel_only() -> None:
    faulty = next(seed for seed in range(COUNT) if drawn(seed).wheel == "RL")
    key = drawn(faulty).key
    one = ("nothing_detectable", [])
    named = line(faulty, one=one, all=("named", [f"{key}@RL"]))
    assert right(named, "all") and right_wheel(named) and not wrong(named, "all")
    for names in ([key], [f"{key}@FL"]):
        other = line(faulty, one=one, all=("named", names))
        assert wrong(other, "all") and not right(other, "all") and not right_wheel(other)
    zeros = line(faulty, one=one, all=("one_of", ["load_zero@RL", "load_gain@RL"]))
    zeros |= {"key": "load_zero", "family": "load_zero"}
    assert right_channel(zeros)
    zeros["all"]["names"].append("crosstalk@RL")
    assert right_wheel(zeros) and not right_channel(zeros)
    several = line(faulty, one=one, all=("one_of", [f"{key}@RL", "crosstalk@RL"]))
    assert right_wheel(several) and not right(several, "all") and not wrong(several, "all")
    assert not right_wheel(line(faulty, one=one, all=("one_of", [f"{key}@RL", "speed_bias"])))
    assert wrong(line(faulty, one=("named", [key]), all=one), "one"), "nothing acts at the front left wheel"


def test_the_page_counts_what_the_lines_say() -> None:
    lines = [
        line(0, alone=("one_of", ["a", "b"]), one=("one_of", ["a", "b"]), all=("named", ["torque_zero@FL"])),
        line(4, one=("one_of", ["slip_sinkage", "stress_peak_shift"]), all=("named", ["slip_sinkage"])),
        line(8, one=("nothing_detectable", []), all=("nothing_detectable", [])),
    ]
    lines[0] |= {"key": "torque_zero", "family": "torque_zero", "wheel": "FL"}
    lines[0]["told"] = {"d": 30.0, "d_sep": 9.0, "d_sep_usual": 4.0}
    text = page(lines)
    assert "d_sep > 5, on ground as simulated |  | 1 of 1 (95 %: 0.03 to 1.00) |" in text
    assert "d_sep > 5, on ground as usual |  | 0 of 0" in text and "| FL | 30.0 | 9.0 | 4.0 |" in text
    assert "| one transducer's error named with its wheel | 36 of 40 | 1 of 1 |" in text
    assert "| campaigns without a cause: a cause named | 0 of 20 | 0 of 1 |" in text
    assert "| names gained and lost by all wheels, all causes |  | 2 and 0 (McNemar's p 0.5) |" in text
    assert "6.0 (median)" in text and leaves_open(lines[0]["alone"])


@pytest.fixture(scope="module")
def yardsticks() -> tuple[WheelsYardstick, WheelsYardstick]:
    options = options_of(Hidden(0, "torque_gain", 0.05, "RL"))
    return WheelsYardstick(options), WheelsYardstick(options, patchy=True)


def test_what_the_data_tell_grows_with_the_size_and_is_less_where_the_ground_varies(
    yardsticks: tuple[WheelsYardstick, WheelsYardstick],
) -> None:
    even, patchy = yardsticks
    for key, size in (("torque_gain", 0.02), ("load_zero", 200.0)):
        one, twice = even.told(key, size, "RL"), even.told(key, 2 * size, "RL")
        assert 0 < one.d_sep < one.d and twice.d == pytest.approx(2 * one.d, rel=0.1)
        assert patchy.told(key, size, "RL").d < one.d


def test_zero_and_gain_of_a_load_are_each_others_rival(yardsticks: tuple[WheelsYardstick, WheelsYardstick]) -> None:
    even, _ = yardsticks
    for wheel in ("FL", "RL"):
        told = even.told("load_zero", 400.0, wheel)
        assert told.rival == f"load_gain@{wheel}" and told.d_sep < 0.2 * told.d
    front, rear = (even.told("load_zero", 400.0, wheel) for wheel in ("FL", "RL"))
    assert front.d_sep / front.d < rear.d_sep / rear.d, "an added mass is carried at the rear"


def test_what_is_known_is_not_measured_again(tmp_path: Path) -> None:
    one = line(next(seed for seed in range(COUNT) if drawn(seed).wheel), one=("named", []), all=("named", []))
    facts = {key: one[key] for key in ("seed", "key", "size", "wheel")}
    (tmp_path / "told.jsonl").write_text(json.dumps(facts | {"told": {"d": 1.0}}) + "\n", encoding="utf-8")
    nothing = line(8, one=("named", []), all=("named", []))
    assert [x["told"] for x in with_told([one, nothing], tmp_path)] == [{"d": 1.0}, None]


@pytest.mark.slow
def test_one_campaign_from_frames_to_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["wheels", "--seeds", "8", "--out", str(tmp_path)])
    assert main() == 0
    [found] = read_lines(tmp_path / "wheels.jsonl")
    assert found["kind"] == "nothing" and not wrong(found, "all") and found["all"]["cpu_s"] > 0
