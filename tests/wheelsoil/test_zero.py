"""`wheelsoil zero` on recordings of lifted wheels, and its file taken off again."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok
from scipy.stats import binomtest
from zero_support import SIGNALS, START_NS, Bench, rested, truth, vehicle_toml, write_lifted

from daq import ChannelZero, Determination, VehicleConfig, ZeroConfig, load_zeros, parse_toml, parse_zeros
from daq.can import shipped_dbc
from processing.transducer_zero.parts import fit_harmonics

WHEEL = Bench(frame="wheel", angle_offset_deg=40.0)
RIGHT = Bench(frame="wheel", side="right", angle_direction=-1, angle_offset_deg=-15.0)
COVERAGE_SEEDS = 30


def _within(zero: dict, expected: tuple[float, float, float], sigmas: float = 5.0) -> bool:  # type: ignore[type-arg]
    offset, cos, sin = expected
    turning = zero["rotating_sigma"]
    return (
        abs(zero["offset"] - offset) < sigmas * zero["offset_sigma"]
        and abs(zero["cos"] - cos) < sigmas * turning
        and abs(zero["sin"] - sin) < sigmas * turning
    )


def _errors(zero: ChannelZero, expected: tuple[float, float, float]) -> list[float]:
    offset, cos, sin = expected
    turning = zero.rotating_sigma or np.nan
    return [
        (zero.offset - offset) / zero.offset_sigma,
        ((zero.cos or np.nan) - cos) / turning,
        ((zero.sin or np.nan) - sin) / turning,
    ]


@pytest.mark.parametrize(
    "bench",
    [Bench(), WHEEL, RIGHT, replace(RIGHT, speed_radps=-6.5)],
    ids=["vehicle axes", "wheel axes", "right", "backward"],
)
def test_a_spin_shows_every_channel_in_its_own_axes(bench: Bench, tmp_path: Path) -> None:
    recording = write_lifted(tmp_path / "spin.mcap", bench, 3)
    printed = ok("zero", recording, "-o", tmp_path / "zero.toml", "--json").json
    (zero,) = printed["zeros"]
    assert zero["method"] == "spin"
    assert zero["revolutions"] >= 11
    assert zero["start_s"] > bench.speed_up_s - 1
    assert zero["speed_radps"] == pytest.approx(bench.speed_radps, rel=0.02)
    assert zero["temperature_degc"] == 31
    assert {name: c["unit"] for name, c in zero["channels"].items()} == SIGNALS
    wrong = [name for name, expected in truth(bench).items() if not _within(zero["channels"][name], expected)]
    assert not wrong
    assert all(5 < count < 60 for count in zero["outliers"].values())
    assert zero["check"]["mass_kg"] == pytest.approx(75.0, abs=5 * zero["check"]["mass_sigma_kg"])
    assert abs(zero["check"]["angle_error_deg"]) < 5 * zero["check"]["angle_error_sigma_deg"]
    (stored,) = load_zeros(tmp_path / "zero.toml").zero
    assert stored.recording == "spin.mcap"
    assert stored.model_dump(mode="json") == {key: zero[key] for key in stored.model_dump()}
    assert abs(stored.time_ns - START_NS - 9e9) < 2e9


@pytest.mark.slow
@pytest.mark.parametrize("bench", [Bench(), replace(WHEEL, duration_s=9.0)], ids=["vehicle axes", "wheel axes, short"])
def test_the_sigmas_hold_for_correlated_noise(bench: Bench, tmp_path: Path) -> None:
    found = []
    for seed in range(COVERAGE_SEEDS):
        recording = write_lifted(tmp_path / f"{seed}.mcap", bench, seed)
        ok("zero", recording, "-o", tmp_path / f"{seed}.toml")
        (zero,) = load_zeros(tmp_path / f"{seed}.toml").zero
        found += [error for name, expected in truth(bench).items() for error in _errors(zero.channels[name], expected)]
    errors = np.abs(found)
    for sigmas, nominal in ((1.0, 0.6827), (2.0, 0.92)):  # of few blocks the tails are Student's
        low, high = binomtest(int(np.sum(errors < sigmas)), len(errors)).proportion_ci(0.999)
        assert low < nominal + 0.1
        assert high > nominal, f"{np.mean(errors < sigmas):.3f} within {sigmas} sigma"


def test_a_standstill_shows_the_sum_at_one_angle(tmp_path: Path) -> None:
    bench = rested(Bench())
    printed = ok("zero", write_lifted(tmp_path / "rest.mcap", bench, 4), "-o", tmp_path / "z.toml", "--json").json
    (zero,) = printed["zeros"]
    assert zero["method"] == "standstill"
    assert zero["angle_deg"] == pytest.approx(np.degrees(bench.rest_angle_rad), abs=0.1)
    for name, (a, b, c) in truth(bench).items():
        channel = zero["channels"][name]
        assert channel["cos"] is None
        expected = a + b * np.cos(bench.rest_angle_rad) + c * np.sin(bench.rest_angle_rad)
        assert abs(channel["offset"] - expected) < 5 * channel["offset_sigma"], name
    assert any("one wheel angle only" in remark for remark in zero["remarks"])


def test_a_standstill_in_wheel_axes_leaves_the_weight_out(tmp_path: Path) -> None:
    bench = rested(RIGHT)
    printed = ok("zero", write_lifted(tmp_path / "rest.mcap", bench, 4), "-o", tmp_path / "z.toml", "--json").json
    channels = printed["zeros"][0]["channels"]
    assert any("the declared outboard mass of 75 kg is taken out" in said for said in printed["zeros"][0]["remarks"])
    for name, expected in (("WFT_Forces.Fx", -60.0), ("WFT_Forces.Fz", -110.0)):
        assert abs(channels[name]["offset"] - expected) < 5 * channels[name]["offset_sigma"]


def test_on_the_ground_only_what_must_read_zero(tmp_path: Path) -> None:
    bench = replace(rested(Bench()), ground_n=9500.0, bridges_n=0j)
    recording = write_lifted(tmp_path / "ground.mcap", bench, 5, brakes="released")
    refused = invoke("zero", recording, "-o", tmp_path / "z.toml")
    assert refused.code == 1
    assert "the wheel carries the vehicle" in refused.err
    assert re.search(r"vertical load 8\.7\d kN", refused.err)
    assert "--on-ground" in refused.err
    assert not (tmp_path / "z.toml").exists()
    printed = ok("zero", recording, "--on-ground", "-o", tmp_path / "z.toml", "--json").json
    channels = printed["zeros"][0]["channels"]
    assert set(channels) == {"WFT_Forces.Fx", "WFT_Moments.My"}
    level = np.hypot(0.01, np.sin(np.radians(0.3))) * 8760
    assert level < channels["WFT_Forces.Fx"]["offset_sigma"] < 1.05 * level
    assert channels["WFT_Moments.My"]["offset_sigma"] < 5
    wheel = write_lifted(tmp_path / "wheel.mcap", replace(bench, frame="wheel"), 5, brakes="released")
    printed = ok("zero", wheel, "--on-ground", "-o", tmp_path / "w.toml", "--json").json
    assert set(printed["zeros"][0]["channels"]) == {"WFT_Moments.My"}
    lifted = write_lifted(tmp_path / "lifted.mcap", rested(Bench()), 5, brakes="released")
    assert "does not stand on the wheel" in invoke("zero", lifted, "--on-ground", "-o", tmp_path / "l.toml").err


@pytest.mark.parametrize("brakes", ["held", "unknown"])
def test_a_braked_wheel_on_the_ground_gives_no_zero(brakes: str, tmp_path: Path) -> None:
    bench = replace(rested(Bench()), ground_n=9500.0)
    recording = write_lifted(tmp_path / "ground.mcap", bench, 5, brakes=brakes)
    refused = invoke("zero", recording, "--on-ground", "-o", tmp_path / "z.toml")
    assert refused.code == 2
    for part in ("held brakes", f'standstill_brakes = "{brakes}"', 'expected: "released"', "or lift the wheel"):
        assert part in " ".join(refused.err.split()), part
    assert ok("zero", write_lifted(tmp_path / "air.mcap", Bench(), 5, brakes=brakes), "-o", tmp_path / "z.toml")


def test_a_wrong_mass_and_a_wrong_angle_are_reported(tmp_path: Path) -> None:
    bench = replace(WHEEL, angle_error_deg=1.5)
    recording = write_lifted(tmp_path / "spin.mcap", bench, 6)
    wrong = tmp_path / "vehicle.toml"
    wrong.write_text(vehicle_toml(bench).replace("outboard_mass_kg = 75.0", "outboard_mass_kg = 68.0"))
    (tmp_path / "wft.dbc").write_bytes(shipped_dbc("wft.dbc").read_bytes())
    printed = ok("zero", recording, "--vehicle", wrong, "--json").json
    remarks = " ".join(printed["zeros"][0]["remarks"])
    assert re.search(r"that of 7[45]\.\d ± 0\.\d kg, and outboard_mass_kg is 68", remarks)
    assert float(re.search(r"angle_offset_deg = ([\d.]+) in place of 41.5", remarks)[1]) == pytest.approx(40, abs=1)  # type: ignore[index]
    assert (tmp_path / "zero.toml").exists()


def test_drift_between_two_recordings(tmp_path: Path) -> None:
    bench = Bench()
    before = write_lifted(tmp_path / "before.mcap", bench, 7)
    later = replace(bench, lateral_n=bench.lateral_n + 80.0, start_ns=START_NS + 3600 * 10**9)
    after = write_lifted(tmp_path / "after.mcap", later, 8)
    out = tmp_path / "zero.toml"
    printed = ok("zero", after, before, "-o", out, "--json").json
    assert [zero["recording"] for zero in printed["zeros"]] == ["before.mcap", "after.mcap"]
    (lateral,) = [row for row in printed["drift"] if (row["channel"], row["part"]) == ("WFT_Forces.Fy", "offset")]
    assert lateral["significant"]
    assert lateral["change"] == pytest.approx(80, abs=5 * lateral["sigma"])
    assert len(printed["drift"]) == 18
    assert sum(row["significant"] for row in printed["drift"]) == 1
    assert ok("zero", before, after, "-o", out, "--max-drift", "N=150,Nm=20").code == 0
    beyond = invoke("zero", before, after, "-o", out, "--max-drift", "kN=0.05,Nm=20")
    assert beyond.code == 1
    assert "WFT_Forces.Fy: offset moved by" in beyond.err
    assert len(load_zeros(out).zero) == 2  # the same recordings again
    resting = write_lifted(tmp_path / "rest.mcap", rested(bench), 9)
    assert "cannot be compared" in invoke("zero", before, resting, "-o", out).err
    for unlike in ([before, resting], [before], [before, after, resting]):
        unchecked = invoke("zero", *unlike, "-o", out, "--max-drift", "N=1e6,Nm=1e6")
        assert unchecked.code == 1
        assert "--max-drift cannot be checked" in unchecked.err
    assert invoke("zero", before, after, "-o", out, "--max-drift", "kg=3").code == 2


def test_only_a_part_is_looked_at_and_distrusted_samples_are_left_out(tmp_path: Path) -> None:
    bench = replace(Bench(), status=(8.0, 8.5))
    recording = write_lifted(tmp_path / "spin.mcap", bench, 10)
    printed = ok("zero", recording, "--from", 5, "--to", 12, "-o", tmp_path / "z.toml", "--json").json
    (zero,) = printed["zeros"]
    assert zero["start_s"] >= 5
    assert zero["start_s"] + zero["duration_s"] <= 12
    assert any("500 samples excluded" in remark for remark in zero["remarks"])
    short = invoke("zero", recording, "--from", 5, "--to", 6.2, "-o", tmp_path / "z.toml")
    assert short.code == 1
    assert "two revolutions" in short.err


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    bench = replace(WHEEL, status=(0.0, 99.0))  # distrusted from the first to the last sample
    printed = invoke("zero", write_lifted(tmp_path / "spin.mcap", bench, 10), "-o", tmp_path / "z.toml")
    assert printed.code == 1
    assert "nothing usable was received of drawbar_pull" in printed.err
    assert "nothing usable was received of vertical_load" in printed.err
    nobody = tmp_path / "vehicle.toml"
    nobody.write_text('[[bus]]\nchannel = "can0"\ndbc = ["wft.dbc"]\n[transducer]\nframe = "wheel"\n')
    (tmp_path / "wft.dbc").write_bytes(shipped_dbc("wft.dbc").read_bytes())
    needed = invoke("zero", tmp_path / "spin.mcap", "--vehicle", nobody)
    assert needed.code == 2
    for role in ("vertical_load", "drawbar_pull", "wheel_angle"):
        assert f"role '{role}' is needed" in needed.err


def test_the_file_is_appended_to_and_checked(tmp_path: Path) -> None:
    first = write_lifted(tmp_path / "spin.mcap", Bench(), 11)
    out = tmp_path / "zero.toml"
    ok("zero", first, "-o", out)
    second = write_lifted(tmp_path / "earlier.mcap", replace(Bench(), start_ns=START_NS - 10**12), 12)
    ok("zero", second, "-o", out)
    assert [one.recording for one in load_zeros(out).zero] == ["earlier.mcap", "spin.mcap"]
    out.write_text(out.read_text() + "\n[[zero]]\nmethod = 'spun'\n")
    wrong = invoke("zero", first, "-o", out)
    assert wrong.code == 2
    assert "method has a value that is not known" in wrong.err and "[[zero]] 3" in wrong.err
    assert "'recording' is missing" in wrong.err
    assert invoke("zero", first, "-o", tmp_path / "no" / "zero.toml").code == 2


def test_the_line_is_named_that_vehicle_toml_lacks(tmp_path: Path) -> None:
    unnamed = write_lifted(tmp_path / "unnamed.mcap", WHEEL, 1)
    named = write_lifted(tmp_path / "named.mcap", WHEEL, 1, zero_file="zero.toml")
    (tmp_path / "apart").mkdir()
    line = 'add under [transducer] of vehicle.toml: zero_file = "zero.toml"'
    assert line in ok("zero", unnamed).err
    assert "vehicle.toml" not in ok("zero", named).err
    printed = ok("zero", named, "-o", tmp_path / "apart" / "zero.toml").err
    assert f"put it beside vehicle.toml, and {line}" in printed


def test_a_signal_that_hardly_moves_is_as_uncertain_as_its_steps() -> None:
    at = np.arange(5000) / 1000
    quiet = fit_harmonics(at, np.full(5000, 12.0), None, 2.0)
    assert quiet.coefficients[0] == 12.0
    assert quiet.sigmas[0] == pytest.approx(2.0 / np.sqrt(12))
    rng = np.random.default_rng(0)
    shaken = fit_harmonics(at, 2 * np.rint((12.7 + 4 * rng.standard_normal(5000)) / 2), None, 2.0)
    assert shaken.sigmas[0] < 0.15
    assert abs(shaken.coefficients[0] - 12.7) < 5 * shaken.sigmas[0]


def test_the_page_shows_a_file_that_is_right() -> None:
    page = (Path(__file__).parents[2] / "docs" / "zero.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", page, re.S)
    zeros = parse_zeros(next(b for b in blocks if "[[zero]]" in b).encode(), "docs/zero.md")
    assert isinstance(zeros, ZeroConfig)
    for model in (Determination, ChannelZero):
        assert all(key in page for key in model.model_fields)
    assert parse_toml(next(b for b in blocks if "[transducer]" in b), VehicleConfig, "docs/zero.md")
