"""What a run tells a person of itself."""

from __future__ import annotations

import re

import numpy as np
import pytest
from synthetic_run import RADIUS_M, channel, forces, speeds, stamps, vehicle

from daq import Channel
from processing import ProcessedRun, SensorFacts
from processing.pipeline import process
from processing.pipeline.latency import SpeedComparison
from processing.pipeline.quality import _zero_notes, speed_notes
from wheelsoil.wording.notes import note_text, texts_of


def _notes(channels: dict[str, Channel]) -> str:
    return "\n".join(texts_of(process(channels, vehicle()).quality.notes))


@pytest.mark.parametrize("zero_n", [0.0, 120.0])
def test_standstill_shows_a_zero_and_subtracts_nothing(zero_n: float) -> None:
    rng = np.random.default_rng(1)
    at = stamps(40.0, 200.0)

    def speed(time: np.ndarray) -> np.ndarray:
        return np.clip(time - 8.0, 0.0, 3.0) * (time > 8)

    pull = zero_n + 20 * rng.standard_normal(len(at)) + 500 * (speed(at) > 0)
    felt = {"drawbar_pull": channel("D", at, pull), "driving_torque": channel("T", at, pull)}
    run = process(speeds(40.0, 0.1, speed=speed) | felt, vehicle(vehicle={"standstill_brakes": "released"}))
    (standing,) = run.quality.standstills
    assert standing.released
    assert standing.levels["drawbar_pull"] == pytest.approx(zero_n, abs=5 * standing.sigmas["drawbar_pull"])
    assert standing.duration_s == pytest.approx(8.2, abs=0.5)
    for name, unit in (("drawbar pull", "N"), ("driving torque", "N m")):
        said = re.compile(rf"{name} at standstill reads 1[12]\d\.\d ± \d\.\d {unit}: a zero")
        assert any(said.match(note) for note in texts_of(run.quality.notes)) == (zero_n > 0)
    np.testing.assert_allclose(np.median(run.drawbar_pull_n[run.used]), zero_n + 500, atol=5)


def standing_run(declared: str = "unknown", brake: Channel | None = None) -> ProcessedRun:
    """Return a run that stands 10 s, drives 10 s and stands again, with 120 N and 30 N m read at rest."""
    at = stamps(30.0, 200.0)

    def speed(time: np.ndarray) -> np.ndarray:
        return np.clip(np.minimum(time - 10.0, 20.0 - time), 0.0, 2.0)

    noise = np.random.default_rng(2).standard_normal((2, len(at)))
    felt = {"drawbar_pull": channel("D", at, 120.0 + noise[0]), "driving_torque": channel("T", at, 30.0 + noise[1])}
    shown = {"brake": brake} if brake else {}
    return process(speeds(30.0, 0.1, speed=speed) | felt | shown, vehicle(vehicle={"standstill_brakes": declared}))


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ("released", "N: a zero, the ground's tilt or the rut; not subtracted"),
        ("held", "N with held brakes: this is no zero"),
        ("unknown", "N: not taken for a zero, brakes may hold it; say standstill_brakes in vehicle.toml"),
    ],
)
def test_what_a_standstill_shows_depends_on_the_brakes(declared: str, said: str) -> None:
    run = standing_run(declared)
    assert [stand.brakes for stand in run.quality.standstills] == [declared, declared]
    assert [stand.released for stand in run.quality.standstills] == [declared == "released"] * 2
    (note,) = (text for text in texts_of(run.quality.notes) if "drawbar pull at standstill" in text)
    assert note.endswith(said)
    stands = run.quality.standstills * 3
    [often, _] = texts_of(_zero_notes(stands))
    assert often.count(" ± ") == 4 and len(stands) == 6 and often.endswith(said)


@pytest.mark.parametrize("full", [1.0, 40e5])
def test_the_brakes_channel_says_more_than_the_declaration(full: float) -> None:
    """A switch or a pressure: pressed where the run ends, a residue of 2 % where it begins, silent in between."""
    at = stamps(30.0, 50.0)
    pressed = np.where(at > 15.0, full, 0.02 * full)
    run = standing_run("held", channel("brake", at, pressed))
    assert [stand.brakes for stand in run.quality.standstills] == ["released", "held"]
    never = standing_run("held", channel("brake", at, np.zeros(len(at))))
    assert [stand.brakes for stand in never.quality.standstills] == ["released", "released"]
    late = standing_run("released", channel("brake", at[at > 12.0], pressed[at > 12.0]))
    assert [stand.brakes for stand in late.quality.standstills] == ["unknown", "held"]


def test_a_run_that_never_stands_says_that_zeros_were_not_checked() -> None:
    assert "no standstill: zeros could not be checked" in _notes(speeds(10.0))


def test_a_late_receiver_is_noticed() -> None:
    channels = speeds(60.0, delay_s=0.15)
    wheel = channels["wheel_speed"]
    notes = _notes(channels | {"wheel_speed": Channel("w", "", wheel.time_ns, wheel.values / 1.04)})
    assert "late against wheel speed beyond the declared delays" in notes
    assert "declare [sensors.ground_speed] latency_s = 0.15" in notes


@pytest.mark.parametrize(
    ("declared_s", "note"), [(0.0, "latency_s = 0.150 in place of 0"), (0.1, "0.150 in place of 0.1")]
)
def test_the_note_on_a_late_receiver_names_its_whole_delay(declared_s: float, note: str) -> None:
    facts = SensorFacts(100, 0, 20.0, 0, 0.05, declared_s, 0.03, "declared")
    speeds_found = SpeedComparison(0.15 - declared_s, 0.004)
    (found,) = speed_notes(speeds_found, {"ground_speed": facts, "wheel_speed": facts})
    assert note in note_text(found)


@pytest.mark.parametrize("latency_s", [-0.04, -0.025, 0.025, 0.04])
def test_what_a_toothed_ring_may_do_gives_no_note(latency_s: float) -> None:
    facts = SensorFacts(100, 0, 20.0, 0, 0.05, 0.07, 0.03, "declared")
    sensors = {"ground_speed": facts, "wheel_speed": facts}
    assert not list(speed_notes(SpeedComparison(latency_s, 0.004), sensors))
    assert not list(speed_notes(SpeedComparison(3 * latency_s, 0.04), sensors))


def test_an_early_receiver_is_told_without_a_number_to_declare() -> None:
    facts = SensorFacts(100, 0, 20.0, 0, 0.05, 0.07, 0.03, "declared")
    (note,) = speed_notes(SpeedComparison(-0.08, 0.005), {"ground_speed": facts, "wheel_speed": facts})
    said = note_text(note)
    assert "early against wheel speed" in said
    assert "declare" not in said.replace("declared", "")


def test_a_channel_that_is_often_away_is_named() -> None:
    loads = forces(20.0)
    torque = loads["driving_torque"]
    keep = np.arange(len(torque)) % 4000 < 3000
    loads["driving_torque"] = Channel("T", "", torque.time_ns[keep], torque.values[keep])
    assert "driving_torque is missing for 25 % of the run" in _notes(speeds(20.0) | loads)


def test_stamps_that_run_backward_are_counted() -> None:
    channels = speeds(20.0)
    wheel = channels["wheel_speed"]
    time_ns = wheel.time_ns.copy()
    time_ns[500] -= 4_000_000_000
    channels["wheel_speed"] = Channel("w", "", time_ns, wheel.values)
    assert "wheel_speed: samples excluded because their stamps run backward: 1" in _notes(channels)


def test_free_rolling_on_hard_ground_gives_the_radius() -> None:
    at = stamps(30.0, 200.0)
    rolling = {
        "driving_torque": channel("T", at, np.full(len(at), 10.0)),
        "vertical_load": channel("W", at, np.full(len(at), 8000.0)),
        "drawbar_pull": channel("D", at, np.full(len(at), -100.0)),
    }
    channels = speeds(30.0)
    wheel = channels["wheel_speed"]
    channels["wheel_speed"] = Channel("w", "", wheel.time_ns, wheel.values * RADIUS_M / 0.46)
    assert process(channels | rolling, vehicle()).quality.speed_scale * RADIUS_M == pytest.approx(0.46, abs=2e-3)
