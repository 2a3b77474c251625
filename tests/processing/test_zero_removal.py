"""A known zero taken off known channels: axes, signs, time, holes, and what is said of it."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
from synthetic_run import RADIUS_M, START_NS, channel, driven_speed, speeds, stamps, vehicle

from daq import Channel, ChannelZero, ConfigError, Determination, VehicleConfig
from daq.config import TransducerSection, WheelSection
from processing import ProcessedRun
from processing.pipeline import process, process_stream
from processing.transducer_zero import RunZeros, check_weight, drift_between
from wheelsoil.wording.notes import texts_of

MASS, GRAVITY, LOAD = 75.0, 9.80665, 7000.0
WEIGHT = MASS * GRAVITY
BRIDGES = 60.0 - 110.0j
DURATION_S = 20.0
SIGNALS = {"drawbar_pull": "W.Fx", "vertical_load": "W.Fz", "driving_torque": "W.My", "wheel_angle": "W.Angle"}
START = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=START_NS / 1000)


def _config(frame: str = "vehicle", zero: str = "none", **signals: str) -> VehicleConfig:
    return vehicle(
        wheel=WheelSection(radius_m=RADIUS_M, width_m=0.3, outboard_mass_kg=MASS),
        transducer=TransducerSection(frame=frame, zero=zero),  # type: ignore[arg-type]
        signals=SIGNALS | signals,
    )


def _channels(frame: str, *, tared: bool = False, torque_zero_nm: float = 0.0) -> dict[str, Channel]:
    """Return what a transducer with offsets reads of a wheel that carries 7000 N and pulls 500 N."""
    at = stamps(DURATION_S, 1000.0)
    psi = 0.3 + np.cumsum(driven_speed(at)) / 1000.0 / RADIUS_M
    later = psi + 1e-4 * driven_speed(at) / RADIUS_M
    turn = np.exp(1j * psi)
    acceleration = np.gradient(driven_speed(at), at)
    on_wheel = 500.0 - MASS * acceleration + 1j * (LOAD - (0.0 if tared else WEIGHT))
    read = on_wheel * turn + BRIDGES if frame == "wheel" else on_wheel + BRIDGES / turn
    return speeds(DURATION_S) | {
        "drawbar_pull": channel("drawbar_pull", at, read.real, "N"),
        "vertical_load": channel("vertical_load", at, read.imag, "N"),
        "driving_torque": channel("driving_torque", at, np.full(len(at), 300.0 + torque_zero_nm), "Nm"),
        "wheel_angle": channel("wheel_angle", at + 1e-4, np.mod(later, 2 * np.pi), "rad"),
    }


def _zero(
    x: tuple[float, ...], z: tuple[float, ...], frame: str, *, hours: float = -1.0, torque: float = 0.0, **more: object
) -> Determination:
    """Return a determination `hours` after the start of the run; three numbers are a spin, one a standstill."""

    def one(values: tuple[float, ...], unit: str) -> ChannelZero:
        turning = {"cos": values[1], "sin": values[2], "rotating_sigma": 4.0} if len(values) == 3 else {}
        return ChannelZero(offset=values[0], offset_sigma=3.0, unit=unit, **turning)

    lateral = (torque, 0.0, 0.0) if len(x) == 3 else (torque,)
    return Determination.model_validate(
        {
            "time_utc": START + timedelta(hours=hours),
            "recording": f"{hours:g} h",
            "sha256": f"{hours}",
            "method": "spin" if len(x) == 3 else "standstill",
            "frame": frame,
            "channels": {"W.Fx": one(x, "N"), "W.Fz": one(z, "N"), "W.My": one(lateral, "Nm")},
        }
        | more
    )


OX, OZ = BRIDGES.real, BRIDGES.imag
REST = 1.1
SUM = BRIDGES * np.exp(-1j * REST)
WAYS = {
    "spin, vehicle axes": ("vehicle", "spin", False, _zero((0, OX, OZ), (-WEIGHT, OZ, -OX), "vehicle")),
    "spin, vehicle axes, tared before": ("vehicle", "lifted", True, _zero((0, OX, OZ), (0, OZ, -OX), "vehicle")),
    "spin, wheel axes": ("wheel", "spin", False, _zero((OX, 0, WEIGHT), (OZ, -WEIGHT, 0), "wheel")),
    "standstill, wheel axes": ("wheel", "none", False, _zero((OX,), (OZ,), "wheel")),
    "standstill, vehicle axes": ("vehicle", "spin", False, _zero((SUM.real,), (SUM.imag - WEIGHT,), "vehicle")),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_ground_load_is_the_same_whichever_way_the_zero_was_taken(way: str) -> None:
    frame, zero, tared, determination = WAYS[way]
    run = process(_channels(frame, tared=tared), _config(frame, zero), zeros=RunZeros((determination,)))
    if way == "standstill, vehicle axes":  # its rotating part was not seen: it is wrong at every other angle
        load, pull = (values[run.used] for values in (run.vertical_load_n, run.drawbar_pull_n))
        assert abs(np.mean(load) - LOAD + SUM.imag) < 10
        assert abs(np.mean(pull) - 500 + SUM.real) < 10
    else:
        np.testing.assert_allclose(run.vertical_load_n[run.used], LOAD, atol=1.0)
        np.testing.assert_allclose(run.drawbar_pull_n[run.used], 500.0, atol=1.5)


def test_without_a_zero_the_offsets_stay() -> None:
    run = process(_channels("wheel"), _config("wheel", "spin"))
    assert np.std(run.drawbar_pull_n[run.used]) > 5
    assert run.quality.zeros == {}
    assert np.isnan(run.quality.sensors["drawbar_pull"].systematic_sigma)


PIECES = {"all roles": (False, 0), "only what came": (True, 0), "angle a second late": (True, 10**9)}


@pytest.mark.parametrize(
    ("frame", "sparse", "late_ns"),
    [
        pytest.param(
            frame, *how, id=f"{frame}-{name}", marks=[pytest.mark.slow] * ((frame == "wheel") != (how == (True, 0)))
        )
        for frame in ("vehicle", "wheel")
        for name, how in PIECES.items()
    ],
)
def test_pieces_of_any_size_give_the_same(frame: str, sparse: bool, late_ns: int) -> None:
    _, zero, _, determination = WAYS[f"spin, {frame} axes"]
    channels, config, zeros = _channels(frame), _config(frame, zero), RunZeros((determination,))
    whole = process(channels, config, zeros=zeros)
    apart = np.random.default_rng(1).uniform(0, DURATION_S, 200 if sparse else 25)
    edges = START_NS + (np.sort(apart) * 1e9).astype(np.int64)
    pieces = [{r: Channel(r, c.unit, c.time_ns[:0], c.values[:0]) for r, c in channels.items()}]  # as a `Run` begins
    came_ns = {role: c.time_ns + late_ns * (role == "wheel_angle") for role, c in channels.items()}
    for start, stop in pairwise([0, *edges.tolist(), 2**62]):
        rows = {role: (came >= start) & (came < stop) for role, came in came_ns.items()}
        wanted = [role for role in channels if rows[role].any() or not sparse]
        pieces.append(
            {r: Channel(r, channels[r].unit, channels[r].time_ns[rows[r]], channels[r].values[rows[r]]) for r in wanted}
        )
    parts = process_stream(pieces, config, zeros=zeros)
    np.testing.assert_array_equal(parts.reason, whole.reason)
    # the collector joins what lies on one node in another order
    np.testing.assert_allclose(parts.vertical_load_n[whole.used], whole.vertical_load_n[whole.used], atol=0.02)
    ages_s = {role: zero.ages_s[0] for role, zero in whole.quality.zeros.items()}
    assert {role: zero.ages_s[0] for role, zero in parts.quality.zeros.items()} == pytest.approx(ages_s, abs=0.5)


def _torque(run: ProcessedRun) -> float:
    return float(np.mean(run.driving_torque_nm[run.used]))


def test_between_two_of_a_kind_the_zero_is_interpolated_and_else_the_nearest_holds() -> None:
    x, z = (0.0, OX, OZ), (-WEIGHT, OZ, -OX)
    before, after = (_zero(x, z, "vehicle", hours=h, torque=t) for h, t in ((-1.0, 10.0), (3.0, 50.0)))
    channels, config = _channels("vehicle", torque_zero_nm=20.0), _config()
    run = process(channels, config, zeros=RunZeros((before, after)))
    assert _torque(run) == pytest.approx(300.0, abs=0.1)
    facts = run.quality.sensors["driving_torque"]
    assert facts.systematic_sigma == pytest.approx(np.hypot(0.75 * 3, 0.25 * 3), rel=0.01)
    assert any(
        "the zero of driving_torque moved by +40.0 ± 4.2 N m from before" in note
        for note in texts_of(run.quality.notes)
    )

    resting = _zero((0.0,), (-WEIGHT,), "vehicle", hours=0.5, torque=50.0)
    alone = process(channels, config, zeros=RunZeros((before, resting)))
    assert _torque(alone) == pytest.approx(270.0, abs=0.1)
    assert alone.quality.zeros["driving_torque"].ages_s == pytest.approx((-1800.0,), abs=1)


def test_signs_and_units_of_the_zero_are_those_of_the_bus() -> None:
    plain = _zero((0.0, OX, OZ), (-WEIGHT, OZ, -OX), "vehicle")
    turned = {
        "W.Fx": plain.channels["W.Fx"],
        "W.Fz": ChannelZero(
            offset=WEIGHT / 1e3, offset_sigma=3e-3, cos=-OZ / 1e3, sin=OX / 1e3, rotating_sigma=0.0, unit="kN"
        ),
        "W.My": ChannelZero(offset=-0.2, offset_sigma=0.01, unit="kNm"),
    }
    config = _config(vertical_load="-W.Fz", driving_torque="-W.My")
    one = plain.model_copy(update={"channels": turned})
    run = process(_channels("vehicle", torque_zero_nm=200.0), config, zeros=RunZeros((one,)))
    np.testing.assert_allclose(run.vertical_load_n[run.used], LOAD, atol=1.0)
    assert _torque(run) == pytest.approx(300.0, abs=0.1)
    assert run.quality.sensors["vertical_load"].systematic_sigma == pytest.approx(3.0)


def test_the_systematic_sigma_in_wheel_axes_is_the_rotating_one() -> None:
    run = process(_channels("wheel"), _config("wheel"), zeros=RunZeros((WAYS["spin, wheel axes"][3],)))
    assert run.quality.sensors["drawbar_pull"].systematic_sigma == pytest.approx(np.hypot(4, 4) / 2)
    assert run.quality.sensors["vertical_load"].systematic_sigma == pytest.approx(np.hypot(4, 4) / 2)
    rest = process(_channels("wheel"), _config("wheel"), zeros=RunZeros((WAYS["standstill, wheel axes"][3],)))
    assert np.isnan(rest.quality.sensors["vertical_load"].systematic_sigma)
    assert any("the outboard weight is the declared one" in note for note in texts_of(rest.quality.notes))


def test_after_a_standstill_in_vehicle_axes_the_systematic_sigma_of_the_forces_is_not_known() -> None:
    rest = process(_channels("vehicle"), _config(), zeros=RunZeros((WAYS["standstill, vehicle axes"][3],)))
    sigma = {role: facts.systematic_sigma for role, facts in rest.quality.sensors.items()}
    assert np.isnan([sigma["drawbar_pull"], sigma["vertical_load"]]).all()  # and both are wrong by 60 to 130 N
    assert sigma["driving_torque"] == pytest.approx(3.0)
    assert any("the transducer's rotating zero is not known" in note for note in texts_of(rest.quality.notes))


def test_without_the_angle_only_the_stationary_part_comes_off() -> None:
    channels = _channels("vehicle")
    del channels["wheel_angle"]
    run = process(channels, _config(), zeros=RunZeros((WAYS["spin, vehicle axes"][3],)))
    assert np.mean(run.vertical_load_n[run.used]) == pytest.approx(LOAD, abs=10)
    assert np.std(run.vertical_load_n[run.used]) > 5
    assert any("only the stationary zero" in note for note in texts_of(run.quality.notes))


@pytest.mark.parametrize("frame", ["vehicle", "wheel"])
def test_the_rotating_zero_is_taken_off_all_samples_of_angles_that_arrive_late(frame: str) -> None:
    channels, (_, zero, _, determination) = _channels(frame), WAYS[f"spin, {frame} axes"]
    angle, rng = channels["wheel_angle"], np.random.default_rng(4)
    came = rng.uniform(size=len(angle)) > 0.05  # one in twenty is away, at times for 10 ms and more
    for first in rng.integers(100, len(angle) - 100, 200):
        came[first : first + 12] = False
    came[[0, -1]] = True
    channels["wheel_angle"] = Channel(angle.name, angle.unit, angle.time_ns[came], angle.values[came])
    run = process(channels, _config(frame, zero), zeros=RunZeros((determination,)))
    assert not any("wheel angle is not known" in note for note in texts_of(run.quality.notes))
    np.testing.assert_allclose(run.vertical_load_n[run.used], LOAD, atol=2.0)
    np.testing.assert_allclose(run.drawbar_pull_n[run.used], 500.0, atol=2.0)


def test_a_hole_in_the_angle_costs_only_the_rotating_part_there() -> None:
    channels = _channels("vehicle")
    angle = channels["wheel_angle"]
    keep = (angle.time_ns < START_NS + 9 * 10**9) | (angle.time_ns > START_NS + 11 * 10**9)
    channels["wheel_angle"] = Channel("wheel_angle", "rad", angle.time_ns[keep], angle.values[keep])
    run = process(channels, _config(), zeros=RunZeros((WAYS["spin, vehicle axes"][3],)))
    assert run.used[(run.time_s > 9.5) & (run.time_s < 10.5)].all()
    sound = run.used & ((run.time_s < 8.5) | (run.time_s > 11.5))
    np.testing.assert_allclose(run.vertical_load_n[sound], LOAD, atol=1.0)
    (note,) = [note for note in texts_of(run.quality.notes) if "only the stationary" in note]
    assert re.search(r"of (5,9|6,0)\d\d of 60,000 transducer samples", note)  # two seconds of three channels


@pytest.mark.parametrize(
    ("hours", "degc", "said"),
    [(-30.0, 20.0, "30.0 h before the run: take one"), (-1.0, 42.0, "taken at 20 degC, and the run began at 42 degC")],
)
def test_a_doubtful_zero_is_remarked(hours: float, degc: float, said: str) -> None:
    one = _zero((0.0, OX, OZ), (-WEIGHT, OZ, -OX), "vehicle", hours=hours, temperature_degc=20.0)
    run = process(_channels("vehicle"), _config(), zeros=RunZeros((one,), "zero.toml", degc))
    assert sum(said in note for note in texts_of(run.quality.notes)) == 1
    fresh = _zero((0.0, OX, OZ), (-WEIGHT, OZ, -OX), "vehicle", temperature_degc=20.0)
    sound = process(_channels("vehicle"), _config(), zeros=RunZeros((fresh,), "zero.toml", 25.0))
    assert len(sound.quality.notes) == len(run.quality.notes) - 1


def test_a_channel_without_a_zero_is_named() -> None:
    one = WAYS["spin, vehicle axes"][3]
    bare = one.model_copy(update={"channels": {"W.Fx": one.channels["W.Fx"]}})
    run = process(_channels("vehicle"), _config(zero="spin"), zeros=RunZeros((bare,)))
    assert any("has no zero of vertical_load, driving_torque" in note for note in texts_of(run.quality.notes))
    assert np.mean(run.vertical_load_n[run.used]) == pytest.approx(LOAD, abs=10)  # as transducer.zero says


def test_a_zero_of_other_axes_is_refused() -> None:
    with pytest.raises(ConfigError, match="taken in wheel axes"):
        process(_channels("vehicle"), _config(), zeros=RunZeros((WAYS["spin, wheel axes"][3],)))


def test_a_rest_at_another_angle_is_no_drift() -> None:
    one = _zero((1.0,), (2.0,), "vehicle", angle_deg=350.0)
    other = _zero((1.0,), (2.0,), "vehicle", hours=1.0, angle_deg=20.0)
    rows, remarks = drift_between(one, other)
    assert not any(row.significant for row in rows)
    assert any("30 deg further on" in remark for remark in texts_of(remarks))


@pytest.mark.parametrize(
    ("frame", "zero", "checked"), [("vehicle", "none", True), ("vehicle", "lifted", False), ("wheel", "lifted", True)]
)
def test_the_weight_is_checked_where_the_transducer_feels_it(frame: str, zero: str, checked: bool) -> None:
    known = WAYS[f"spin, {frame} axes"][3].channels
    forces = {"drawbar_pull": (known["W.Fx"], 1.0), "vertical_load": (known["W.Fz"], 1.0)}
    found = check_weight(forces, _config(frame, zero))
    assert (found is not None) == checked
    assert found is None or found.mass_kg == pytest.approx(MASS, abs=0.5)
