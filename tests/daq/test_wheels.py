"""Several ``[[wheel]]`` in vehicle.toml: each is one wheel to everything else, and contradictions are refused."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest

from daq import (
    ZERO_FILE,
    ChannelZero,
    ConfigError,
    Determination,
    RunInfo,
    RunsConfig,
    RutReading,
    VehicleConfig,
    ZeroConfig,
    parse_toml,
    zeros_toml,
)
from daq.can import load_database, resolve_roles, shipped_dbc
from daq.logger.doctor import Situation, files
from daq.recording import RecordingWriter
from daq.runs import Run, open_runs
from daq.zero_file import carried_zeros

HEAD = (
    '[vehicle]\nname = "four"\naxles = 2\n[signals]\nground_speed = "GNSS_2.Speed"\n'
    "[sensors.vertical_load]\nsigma = 60.0\n"
)
BUSES = "".join(f'[[bus]]\nchannel = "can{n}"\ndbc = ["wft.dbc", "wheel_speed.dbc", "gnss.dbc"]\n' for n in range(2))
FRONT, REAR = ("FL", 1, 2.7), ("RL", 2, 0.0)
LIFTED = Determination(
    time_utc=datetime(2026, 5, 4, tzinfo=UTC),
    recording="lifted.mcap",
    sha256="0",
    method="standstill",
    frame="vehicle",
    channels={"WFT_Forces.Fx": ChannelZero(offset=1.0, offset_sigma=0.1, unit="N")},
)


def wheel(name: str, axle: int, x_m: float, more: str = "", transducer: str = "", signals: str = "") -> str:
    bus = axle - 1
    return (
        f'[[wheel]]\nid = "{name}"\naxle = {axle}\nx_m = {x_m}\ny_m = 0.9\nradius_m = 0.47\nwidth_m = 0.318\n{more}\n'
        f'[wheel.signals]\nvertical_load = "can{bus}:WFT_Forces.Fz"\n{signals}\n'
        f"[wheel.sensors.vertical_load]\nlatency_s = 0.00{axle}\n"
        f'[wheel.transducer]\nserial = "W-{name}"\n{transducer}\n'
    )


def parsed(*wheels: str, head: str = HEAD) -> VehicleConfig:
    return parse_toml("".join([head, *wheels]), VehicleConfig, "vehicle.toml")


def test_a_wheel_of_several_is_what_a_file_with_it_alone_says() -> None:
    several = parsed(wheel(*FRONT), wheel(*REAR))
    assert several.wheel is None and several.wheel_ids == ("FL", "RL")
    rear = several.for_wheel("RL")
    assert rear.wheel is not None and not rear.wheels
    assert (rear.wheel.id, rear.wheel.position, rear.wheel.axle, rear.wheel.x_m) == ("RL", "RL", 2, 0.0)
    assert {role: str(name) for role, name in rear.signals.items()} == {
        "ground_speed": "GNSS_2.Speed",
        "vertical_load": "can1:WFT_Forces.Fz",
    }
    assert rear.latency_s("vertical_load") == 0.002
    assert (rear.transducer.serial, several.for_wheel("FL").transducer.serial) == ("W-RL", "W-FL")
    assert rear.for_wheel("RL") == rear.for_wheel() == rear


def test_a_file_of_one_wheel_is_written_as_it_was_and_one_of_several_as_it_is_read() -> None:
    single = parse_toml("[wheel]\nradius_m = 0.47\nwidth_m = 0.3\n", VehicleConfig, "vehicle.toml")
    dumped = single.model_dump(mode="json")
    assert "wheels" not in dumped and "id" not in dumped["wheel"]
    assert single.for_wheel() is single and single.wheel_ids == ()
    several = parsed(wheel(*FRONT), wheel(*REAR))
    assert [each["id"] for each in several.model_dump()["wheel"]] == ["FL", "RL"]
    assert VehicleConfig.model_validate(several.model_dump()) == several
    assert "wheel" not in RutReading(depth_m=0.1, sigma_m=0.005, time_s=1.0).model_dump()


@pytest.mark.parametrize(
    ("wheels", "said"),
    [
        ([wheel(*FRONT), wheel(*REAR).replace('"RL"', '"FL"')], "two wheels have the id 'FL'; give each its own"),
        (
            [wheel(*FRONT), wheel(*REAR).replace("W-RL", "W-FL")],
            "wheels FL and RL have the same transducer serial 'W-FL'; correct one",
        ),
        (
            [wheel(*each, transducer='zero_file = "zero.toml"') for each in (FRONT, REAR)],
            "wheels FL and RL have the same zero_file 'zero.toml'",
        ),
        (
            [wheel(*FRONT), wheel(*REAR).replace("can1", "can0")],
            "wheels FL and RL have the same signal 'can0:WFT_Forces.Fz' for vertical_load",
        ),
        ([wheel(*FRONT).replace("vertical_load =", "wheel_speed ="), wheel(*REAR)], "wheel FL has no load: add verti"),
        ([wheel("FL", 1, 0.0), wheel("RL", 2, 2.7)], r"FL \(axle = 1, x_m = 0\) is not ahead of wheel RL \(axle = 2"),
        (
            [wheel(*FRONT), wheel("RL", 1, 0.0)],
            "wheels FL and RL have the same axle = 1, but x_m = 0 and 2.7, one behind the other; correct one of them",
        ),
        (
            [wheel(*FRONT), wheel("RL", 2, 2.7)],
            r"wheels FL and RL have the same place \(x_m = 2.7, y_m = 0.9\); correct one of them",
        ),
        (
            [wheel(*FRONT), wheel("RR", *REAR[1:])],
            'wheel RR: id = "RR" contradicts y_m = 0.9, which is on the left: y_m points to the left; correct one',
        ),
        (
            [wheel(*FRONT, more='position = "front right"')],
            'wheel FL: position = "front right" contradicts y_m = 0.9, which is on the left',
        ),
        ([wheel(*FRONT, transducer='side = "right"')], 'wheel FL: side = "right" contradicts y_m = 0.9'),
        (
            [wheel("FR", *FRONT[1:], transducer='frame = "wheel"').replace("y_m = 0.9", "y_m = -0.9")],
            'wheel FR: side = "left" contradicts y_m = -0.9, which is on the right',
        ),
        ([wheel(*FRONT).replace("axle = 1\n", ""), wheel(*REAR)], "FL: axle is missing: with several wheels"),
        ([wheel(*FRONT), wheel("RL", 3, 0.0)], "wheel RL: axle = 3 is not on a vehicle with vehicle.axles = 2"),
        (
            [wheel(*FRONT, signals='yaw_rate = "Imu.Yaw"')],
            r"signals: yaw_rate: of the whole vehicle(.|\n)*\[\[wheel\]\] 1",
        ),
        ([wheel(*FRONT, signals='brakes = "A.B"')], r"no role is called 'brakes' \(nearest: brake\)"),
        ([wheel(*FRONT, more="radious_m = 0.5")], r"unknown key 'radious_m'\n.*\[\[wheel\]\] 1\n.*nearest: radius_m"),
        ([wheel("F L", *FRONT[1:])], "id: an id holds letters, digits, - and _ only"),
        ([wheel("all", *FRONT[1:])], "id: 'all' is what all wheels together are called"),
        ([wheel(*FRONT).replace('id = "FL"\n', "")], r"key 'id' is missing\n.*, \[\[wheel\]\] 1\n.*add it"),
        ([wheel(*FRONT), '[transducer]\nserial = "A"\n'], r"\[transducer\] beside several \[\[wheel\]\]"),
        ([wheel(*FRONT), "[wheel.sensors.drawbar_pull]\nz_m = 1.0\n"], "drawbar_pull takes no z_m: only ground_speed"),
    ],
)
def test_wheels_that_contradict_each_other_are_refused(wheels: Sequence[str], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        parsed(*wheels)
    assert "vehicle.toml" in str(caught.value)


@pytest.mark.parametrize("name", ["FR", "rear_right-2", "hub", "left-right", "LEG"])
def test_an_id_may_name_no_side_or_both(name: str) -> None:
    [found] = parsed(wheel(name, *FRONT[1:]).replace("y_m = 0.9", "y_m = -0.9")).wheels
    assert found.y_m == -0.9 and found.transducer.side == "left", "in vehicle axes its side changes nothing"


def test_a_signal_of_one_wheel_is_not_for_all() -> None:
    with pytest.raises(ConfigError, match=r"drawbar_pull in \[signals\]: of one wheel, for its \[wheel.signals\]"):
        parsed(wheel(*FRONT), head=HEAD.replace("ground_speed =", 'drawbar_pull = "A.B"\nground_speed ='))


def test_all_contradictions_are_listed_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        parsed(wheel("FL", 1, 0.0), wheel("RL", 2, 2.7).replace("W-RL", "W-FL"))
    assert "serial" in str(caught.value) and "is not ahead of" in str(caught.value)


def test_a_command_of_one_wheel_asks_which() -> None:
    several = parsed(wheel(*FRONT), wheel(*REAR))
    with pytest.raises(ConfigError, match=r"several wheels(.|\n)*found: FL, RL\n(.|\n)*--wheel FL"):
        several.for_wheel()
    with pytest.raises(
        ConfigError, match=r"no wheel has the id 'RX'(.|\n)*nearest: RL\n(.|\n)*one of FL, RL by --wheel"
    ):
        several.for_wheel("RX")
    assert parsed(wheel(*FRONT)).for_wheel() == parsed(wheel(*FRONT)).for_wheel("FL")
    with pytest.raises(ConfigError, match=r"one \[wheel\] without an id\n(.|\n)*omit --wheel"):
        parse_toml("[wheel]\nradius_m = 0.47\nwidth_m = 0.3\n", VehicleConfig, "vehicle.toml").for_wheel("FL")


def test_a_wrong_signal_names_its_wheel() -> None:
    databases = {"can0": (load_database(shipped_dbc("wft.dbc")),), "can1": (load_database(shipped_dbc("gnss.dbc")),)}
    several = parsed(wheel(*FRONT), wheel(*REAR))
    assert "vertical_load" in resolve_roles(several.for_wheel("FL"), databases, ("vertical_load",))
    with pytest.raises(ConfigError, match=r"\[signals\] vertical_load, wheel RL"):
        resolve_roles(several.for_wheel("RL"), databases, ("vertical_load",))


def test_the_zero_file_of_each_wheel_goes_along(tmp_path: Path) -> None:
    wheels = (wheel(*each, transducer=f'zero_file = "{each[0]}-{ZERO_FILE}"') for each in (FRONT, REAR))
    vehicle = parsed(*wheels)
    (tmp_path / "RL-zero.toml").write_text("", encoding="utf-8")
    assert carried_zeros(vehicle, tmp_path) == {"RL-zero.toml": b""}


def test_the_doctor_checks_every_wheel(tmp_path: Path) -> None:
    speed = 'wheel_speed = "WheelSpeeds.FrontLeft"'
    vehicle = parsed(wheel(*FRONT, signals=speed), wheel(*REAR, transducer='zero_file = "rear.toml"'))
    (tmp_path / "zero-FL.toml").write_text("", encoding="utf-8")
    now = Situation(tmp_path / "vehicle.toml", tmp_path, 8100, vehicle)
    assert [line.found for line in files.roles(now)] == ["no wheel_speed of RL: no slip"]
    front, rear = files.zero(now)
    assert front.where.endswith("zero-FL.toml") and "no determination" in front.found
    assert rear.where.endswith("rear.toml") and "not there" in rear.found
    assert [line.next_step[-10:] for line in (front, rear)] == ["--wheel FL", "--wheel RL"]
    (tmp_path / "zero-FL.toml").write_text(zeros_toml(ZeroConfig(zero=(LIFTED,))), encoding="utf-8")
    unnamed, _ = files.zero(now)
    assert 'under [wheel.transducer] of wheel FL in vehicle.toml: zero_file = "zero-FL.toml"' in unnamed.next_step


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign folder of two wheels whose recording says nothing of them."""
    (tmp_path / "vehicle.toml").write_text("".join([HEAD, BUSES, wheel(*FRONT), wheel(*REAR)]), encoding="utf-8")
    with RecordingWriter(tmp_path / "run-1.mcap", run=RunInfo(id="run-1")):
        pass
    return tmp_path


def opened(folder: Path, runs: str = "") -> Run:
    (folder / "runs.toml").write_text(f'[[run]]\nfile = "run-1.mcap"\nid = "run-1"\n{runs}', encoding="utf-8")
    [run] = open_runs([folder])
    return run


RUT = "[[run.rut]]\ndepth_m = 0.08\nsigma_m = 0.005\ntime_s = 3.0\n"
STATIC = '[[static]]\ntest = "lifted"\ndrawbar_pull_n = 3.0\ndrawbar_pull_sigma_n = 1.0\n'


def test_readings_go_to_their_wheel(folder: Path) -> None:
    run = opened(folder, f'{RUT}wheel = "RL"\n{STATIC}wheel = "FL"\n')
    wheels = run.by_wheel()
    assert list(wheels) == ["FL", "RL"]
    assert [len(wheels[name].info.rut) for name in wheels] == [0, 1]
    assert [len(wheels[name].static) for name in wheels] == [1, 0]
    assert wheels["RL"].vehicle == run.vehicle.for_wheel("RL")


def test_a_reading_of_no_known_wheel_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r'does not say of which wheel(.|\n)*runs.toml(.|\n)*wheel = "FL"'):
        opened(folder, RUT).by_wheel()
    with pytest.raises(ConfigError, match=r"wheel 'RK', which vehicle.toml does not have(.|\n)*RL"):
        opened(folder, f'{RUT}wheel = "RK"\n').by_wheel()
    single = HEAD.replace("axles = 2\n", "") + "[wheel]\nradius_m = 0.47\nwidth_m = 0.3\n"
    (folder / "vehicle.toml").write_text(single, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"wheel 'RL', which(.|\n)*has no id"):
        opened(folder, f'{RUT}wheel = "RL"\n').by_wheel()
    assert list(opened(folder, RUT).by_wheel()) == [""]


def test_a_recording_of_one_wheel_with_a_file_of_two_is_refused(folder: Path, tmp_path: Path) -> None:
    alone = "[wheel]\nradius_m = 0.47\nwidth_m = 0.3\n"
    with RecordingWriter(
        tmp_path / "run-1.mcap", run=RunInfo(id="run-1"), attachments={"vehicle.toml": alone.encode()}, overwrite=True
    ):
        pass
    run = opened(folder)
    with pytest.raises(ConfigError, match=r"made with one \[wheel\](.|\n)*has more wheels(.|\n)*--wheel FL"):
        run.by_wheel()
    assert run.for_wheel("RL").vehicle.wheel is not None


def test_runs_toml_takes_the_wheel_of_a_reading() -> None:
    text = f'[[run]]\nfile = "a.mcap"\n{RUT}wheel = "RL"\n'
    assert parse_toml(text, RunsConfig, "runs.toml").run[0].rut[0].model_dump()["wheel"] == "RL"
