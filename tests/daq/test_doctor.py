"""One contract for every check of the doctor: it can pass, and what it is for makes it warn or fail."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from doctor_support import free_port, nodes, vehicle_folder

from daq import Channel, ChannelZero, Determination, ZeroConfig, zeros_toml
from daq.can import load_database
from daq.logger.doctor import CHECKS, Line, Situation, Verdict, examine, gather
from daq.logger.doctor.host import (
    judged_status,
    judged_time,
    judged_times,
    judged_unit,
    kernel_clock_status,
    sync_times_s,
)
from daq.logger.doctor.links import Link, with_details
from daq.logger.run_files import folder_lock
from daq.sources import SourceCounters

ROOT = Path(__file__).parents[2]
LISTEN_S = 0.6
BY_NAME = {check.name: check.run for check in CHECKS}

# What `ip -details -json link show` of iproute2 6.1 says of a serial adapter, and of a controller after its manual.
SLCAN = """{"linkinfo":{"info_kind":"can","info_data":{"ctrlmode_supported":["LISTEN-ONLY"],"state":"ERROR-ACTIVE",
"restart_ms":0,"bittiming_bitrate":500000,"bitrate_const":[10000,500000,1000000],"clock":0}}}"""
CONTROLLER = """{"linkinfo":{"info_kind":"can","info_data":{"state":"ERROR-ACTIVE","berr_counter":{"tx":0,"rx":0},
"restart_ms":100,"bittiming":{"bitrate":1000000,"sample_point":"0.750"},"data_bittiming":{"bitrate":5000000}}}}"""
UP = Link("can0", exists=True, is_can=True, up=True, mtu=16, queue_length=1000)
GOOD = with_details(UP, json.loads(CONTROLLER))


@pytest.fixture(scope="module")
def ready(tmp_path_factory: pytest.TempPathFactory) -> Situation:
    """Return what was gathered of a vehicle that is well, recorded into a folder of its own."""
    return listened(tmp_path_factory.mktemp("ready"))


def listened(folder: Path, *, listen_s: float = LISTEN_S, **sent: float | bool | tuple[str, ...]) -> Situation:
    vehicle = vehicle_folder(folder)
    with nodes(vehicle, **sent):  # type: ignore[arg-type]
        return gather(vehicle, folder, listen_s, free_port())


def alone(folder: Path, **replaced: str) -> Situation:
    """Gather where nobody sends."""
    return gather(vehicle_folder(folder, **replaced), folder, 0.1, free_port())


def on_link(ready: Situation, link: Link, **replaced: object) -> Situation:
    """Return the situation with a SocketCAN interface in place of the virtual one."""
    (bus,) = ready.sections
    section = ready.vehicle.bus[0].model_copy(update={"interface": "socketcan", **replaced})
    vehicle = ready.vehicle.model_copy(update={"bus": (section,)})
    return replace(ready, vehicle=vehicle, links={bus: replace(link, name=bus)})


def hearing(ready: Situation, **changed: object) -> Situation:
    (bus,) = ready.receptions
    return replace(ready, receptions={bus: replace(ready.receptions[bus], **changed)})  # type: ignore[arg-type]


def with_logger(ready: Situation, **changed: float) -> Situation:
    logger = ready.vehicle.logger.model_copy(update=changed)
    return replace(ready, vehicle=ready.vehicle.model_copy(update={"logger": logger}))


def with_bitrate(ready: Situation, bitrate: int) -> Situation:
    (bus,) = ready.receptions
    return hearing(ready, section=ready.sections[bus].model_copy(update={"bitrate": bitrate}))


def written(folder: Path, text: str) -> Situation:
    (folder / "vehicle.toml").write_text(text)
    return gather(folder / "vehicle.toml", folder, 0.1, free_port())


def with_zero(folder: Path, ready: Situation, age_h: float | None, content: str = "") -> Situation:
    taken = datetime.now(UTC) - timedelta(hours=age_h or 0)
    channels = {"WFT_Forces.Fx": ChannelZero(offset=1.0, offset_sigma=0.1, unit="N")}
    one = Determination(
        time_utc=taken, recording="z.mcap", sha256="0", method="standstill", frame="vehicle", channels=channels
    )
    text = content if age_h is None else zeros_toml(ZeroConfig(zero=(one,)))
    (folder / "zero.toml").write_text(text, encoding="utf-8")
    return replace(ready, vehicle_file=folder / "vehicle.toml")


def naming_zero(ready: Situation) -> Situation:
    transducer = ready.vehicle.transducer.model_copy(update={"zero_file": "zero.toml"})
    return replace(ready, vehicle=ready.vehicle.model_copy(update={"transducer": transducer}))


def without_validity(ready: Situation) -> Situation:
    return replace(ready, roles={role: one for role, one in ready.roles.items() if role != "ground_speed_valid"})


def counters(buffer_bytes: int | None, dropped: int | None = 0) -> SourceCounters:
    return SourceCounters(10, dropped, 0, buffer_bytes)


@dataclass(frozen=True)
class Case:
    """A check, what it must say, and what it is given (or its lines, where the machine itself would have to change)."""

    check: str
    verdict: str
    says: str
    given: Callable[[Path, Situation], Situation | Line]


CASES = [
    Case("vehicle.toml", "pass", "test vehicle", lambda _, ready: ready),
    Case("vehicle.toml", "fail", "unknown key 'weel'", lambda folder, _: written(folder, "[weel]\nradius_m = 1\n")),
    Case("vehicle.toml", "fail", "nothing to record", lambda folder, _: written(folder, "")),
    Case("DBC files", "pass", "7 messages", lambda _, ready: ready),
    Case("DBC files", "fail", "no such DBC file", lambda folder, _: alone(folder, dbc='["none.dbc"]')),
    Case("DBC files", "warn", "no DBC", lambda folder, _: alone(folder, dbc="[]")),
    Case("roles", "pass", " roles", lambda _, ready: ready),
    Case("roles", "fail", "no DBC has a signal", lambda folder, _: alone(folder, ground_speed='"GNSS_2.Sped"')),
    Case("roles", "warn", "no wheel_speed and no ground_speed", lambda folder, _: written(folder, "[signals]\n")),
    Case("interface", "pass", "virtual, opened", lambda _, ready: ready),
    Case("interface", "fail", "there is no interface", lambda _, ready: on_link(ready, Link("can0"))),
    Case("interface", "fail", "no SocketCAN", lambda _, ready: on_link(ready, Link("can0", kernel_has_can=False))),
    Case("interface", "fail", "no CAN interface", lambda f, _: alone(f, channel='"lo"', interface='"socketcan"')),
    Case("interface", "fail", "knows no interface", lambda folder, _: alone(folder, interface='"virtuel"')),
    Case("interface", "fail", "is down", lambda _, ready: on_link(ready, replace(GOOD, up=False))),
    Case("bit rate", "pass", "1000000 bit/s, data 5000000", lambda _, ready: on_link(ready, GOOD)),
    Case("bit rate", "pass", "virtual bus", lambda _, ready: on_link(ready, replace(UP, kind="vcan"))),
    Case(
        "bit rate", "fail", "500000 bit/s, vehicle.toml says 1000000", lambda _, ready: on_link(ready, serial_adapter())
    ),
    Case("bit rate", "warn", "states none", lambda _, ready: on_link(ready, GOOD, bitrate=None)),
    Case("bit rate", "fail", "has no bit rate", lambda _, ready: on_link(ready, replace(GOOD, bitrate=None))),
    Case("bit rate", "fail", "classical CAN", lambda _, ready: on_link(ready, GOOD, fd=True)),
    Case("bit rate", "warn", "iproute2", lambda _, ready: on_link(ready, UP)),
    Case("controller", "pass", "ERROR-ACTIVE", lambda _, ready: on_link(ready, GOOD)),
    Case("controller", "warn", "alone on", lambda _, ready: on_link(ready, replace(GOOD, state="ERROR-PASSIVE"))),
    Case("controller", "fail", "takes no part", lambda _, ready: on_link(ready, replace(GOOD, state="BUS-OFF"))),
    Case("bus-off", "pass", "100 ms", lambda _, ready: on_link(ready, GOOD)),
    Case("bus-off", "warn", "for ever", lambda _, ready: on_link(ready, serial_adapter())),
    Case("send queue", "pass", "1000", lambda _, ready: on_link(ready, GOOD)),
    Case("send queue", "warn", "wait", lambda _, ready: on_link(ready, replace(GOOD, queue_length=1))),
    Case("receive buffer", "pass", "8388608 bytes", lambda _, ready: hearing(ready, counters=counters(8 << 20))),
    Case("receive buffer", "pass", "no receive buffer", lambda _, ready: ready),
    Case("receive buffer", "warn", "net.core.rmem_max=8388608", lambda _, r: hearing(r, counters=counters(212_992))),
    Case("time stamps", "pass", "0.20 ms", lambda _, ready: hearing(ready, stamp_age_s=2e-4)),
    Case("time stamps", "warn", "5.0 s off", lambda _, ready: hearing(ready, stamp_age_s=5.0)),
    Case("time stamps", "fail", "without", lambda _, ready: hearing(ready, stamp_age_s=math.nan)),
    Case("traffic", "pass", "frames in", lambda _, ready: ready),
    Case("traffic", "fail", "silent", lambda folder, _: alone(folder)),
    Case("traffic", "fail", "3 lost", lambda _, ready: hearing(ready, counters=counters(8 << 20, 3))),
    Case("bus load", "pass", "of 1000000 bit/s", lambda _, ready: ready),
    Case("bus load", "warn", "of 85000 bit/s", lambda _, ready: with_bitrate(at_rate(ready), 85_000)),
    Case("bus load", "fail", "more than the bus can carry", lambda _, ready: with_bitrate(ready, 5_000)),
    Case("error frames", "pass", "none", lambda _, ready: ready),
    Case("error frames", "fail", "(protocol)", lambda folder, _: listened(folder, errors=True)),
    Case("DBC coverage", "pass", "100%", lambda _, ready: ready),
    Case("DBC coverage", "fail", "0x100 (", lambda _, ready: described(ready, 1)),
    Case("DBC coverage", "warn", "14%", lambda _, ready: described(ready, 256)),
    Case("silent messages", "pass", "all 7", lambda _, ready: ready),
    Case("silent messages", "warn", "GNSS_3", lambda folder, _: listened(folder, without=("GNSS_3",))),
    Case("signals", "pass", "3.6 kt (bus", lambda folder, _: listened(folder, Speed=3.6)),
    Case("signals", "pass", "samples", lambda _, ready: ready),
    Case("signals", "fail", "GNSS_2.Speed did not come", lambda folder, _: listened(folder, without=("GNSS_2",))),
    Case("signals", "warn", "not available", lambda _, ready: replace(ready, channels=unavailable(ready))),
    Case("signals", "warn", "Overrange", lambda folder, _: listened(folder, Status=2.0)),
    Case("roles", "warn", "add ground_speed_valid", lambda _, ready: without_validity(ready)),
    Case("wheel load", "pass", "0.25 of the weight", lambda folder, _: listened(folder, Fz=9000.0)),
    Case("wheel load", "warn", "0.00023 of the weight of 3600 kg", lambda folder, _: listened(folder, Fz=9.0)),
    Case("wheel load", "warn", "-0.25 of the weight", lambda folder, _: listened(folder, Fz=-9000.0)),
    Case("GNSS fix", "pass", "fix", lambda _, ready: ready),
    Case("GNSS fix", "fail", "no fix", lambda folder, _: listened(folder, SpeedValid=0.0)),
    Case("GNSS time", "pass", "jitter", lambda _, ready: ready),
    Case("GNSS time", "pass", "leap seconds", lambda folder, _: listened(folder, TimeOfDay=18.0)),
    Case("GNSS time", "warn", "+18", lambda folder, _: listened(folder, TimeOfDay=-18.0)),
    Case("GNSS time", "warn", "+60", lambda folder, _: listened(folder, TimeOfDay=-60.0)),
    Case("host clock", "pass", "UTC", lambda _, ready: ready),
    Case("host clock", "fail", "never set", lambda *_: judged_time(datetime(1970, 1, 1, tzinfo=UTC))),
    Case("clock steps", "pass", "not set", lambda _, ready: replace(ready, clock_moved_s=1e-6)),
    Case("clock steps", "warn", "-3600.000 s", lambda _, ready: replace(ready, clock_moved_s=-3600.0)),
    Case("clock synchronised", "pass", "says that it is", lambda *_: judged_status(0x2001)),
    Case("clock synchronised", "warn", "chrony", lambda *_: judged_status(0x0041)),
    Case("folder", "pass", "writable", lambda _, ready: ready),
    Case("folder", "pass", "makes it", lambda folder, ready: replace(ready, out=folder / "a" / "b")),
    Case("folder", "fail", "is a file", lambda _, ready: replace(ready, out=ready.vehicle_file)),
    Case("folder", "fail", "no file can be made", lambda _, ready: replace(ready, out=Path("/proc/wheelsoil"))),
    Case("other logger", "pass", "none", lambda _, ready: ready),
    Case("disk space", "pass", "minutes at", lambda _, ready: ready),
    Case("disk space", "pass", "nothing was received", lambda _, ready: replace(ready, bytes_per_s=0.0)),
    Case("disk space", "warn", "minutes at", lambda _, ready: with_logger(ready, disk_warn_min=1e9)),
    Case("disk space", "fail", "in reserve", lambda _, ready: with_logger(ready, disk_reserve_mb=1e12)),
    Case("disk speed", "pass", "64 kB", lambda *_: judged_times("", [0.004] * 50, 1e5)),
    Case("disk speed", "warn", "power cut", lambda *_: judged_times("", [0.004] * 45 + [0.4] * 5, 1e5)),
    Case("disk speed", "fail", "are needed", lambda *_: judged_times("", [1.0] * 50, 1e5)),
    Case("status page", "pass", "free", lambda _, ready: replace(ready, page_port=free_port())),
    Case("Python", "pass", "imported in", lambda _, ready: ready),
    Case("zero", "warn", "not there", lambda _, ready: ready),
    Case("zero", "warn", "refuses until", lambda folder, ready: naming_zero(replace(ready, out=folder))),
    Case("zero", "warn", "will not carry it", lambda folder, ready: with_zero(folder, ready, 1.0)),
    Case("zero", "pass", "1.0 h old", lambda folder, ready: naming_zero(with_zero(folder, ready, 1.0))),
    Case("zero", "warn", "48.0 h old", lambda folder, ready: naming_zero(with_zero(folder, ready, 48.0))),
    Case("zero", "warn", "no determination", lambda folder, ready: with_zero(folder, ready, None)),
    Case("zero", "fail", "unknown key", lambda folder, ready: with_zero(folder, ready, None, "x = 1")),
    Case("service", "pass", "watchdog", lambda *_: judged_unit([ROOT / "deploy" / "wheelsoil-log.service"])),
    Case("service", "warn", "not installed", lambda folder, _: judged_unit([folder / "wheelsoil-log.service"])),
    Case("service", "warn", "lacks Type=notify", lambda folder, _: judged_unit([poor_unit(folder)])),
]


def serial_adapter() -> Link:
    return with_details(UP, json.loads(SLCAN))


def described(ready: Situation, can_id: int) -> Situation:
    """Return the situation with a DBC of one message."""
    (bus,) = ready.receptions
    text = f'VERSION ""\nBS_:\nBU_: X\nBO_ {can_id} One: 1 X\n SG_ S : 0|8@1+ (1,0) [0|1] "" X\n'
    database = load_database(text.encode(), "other.dbc")
    return replace(ready, databases={bus: (database,)})


def at_rate(ready: Situation) -> Situation:
    """Return the situation as if each frame had come a millisecond after the one before, so that the load is known."""
    (bus,) = ready.receptions
    return hearing(ready, seconds=len(ready.receptions[bus].frames) / 700)


def unavailable(ready: Situation) -> dict[str, Channel]:
    return {role: replace(c, values=np.full(len(c.values), np.nan)) for role, c in ready.channels.items()}


def poor_unit(folder: Path) -> Path:
    (folder / "wheelsoil-log.service").write_text("[Service]\nExecStart=wheelsoil log\nRestart=always\nWatchdogSec=5\n")
    return folder / "wheelsoil-log.service"


def lines_of(check: str, given: Situation | Line) -> list[Line]:
    return [given] if isinstance(given, Line) else list(BY_NAME[check](given))


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.check}: {case.verdict}: {case.says}")
def test_a_check_says_what_is_the_case(case: Case, tmp_path: Path, ready: Situation) -> None:
    lines = lines_of(case.check, case.given(tmp_path, ready))
    assert any(line.verdict == case.verdict and case.says in line.found + line.next_step for line in lines), lines
    worst = {"pass": {"pass"}, "warn": {"pass", "warn"}, "fail": {"pass", "warn", "fail"}}[case.verdict]
    assert {line.verdict.value for line in lines} <= worst
    assert all(bool(line.next_step) == (line.verdict is not Verdict.PASS) for line in lines)


def test_every_check_is_shown_to_pass_and_to_complain() -> None:
    elsewhere = {("other logger", "fail"), ("status page", "fail"), ("Python", "warn")}  # tests of their own, below
    shown = {(case.check, case.verdict) for case in CASES} | elsewhere
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    for check in CHECKS:
        assert (check.name, "pass") in shown
        assert {(check.name, "warn"), (check.name, "fail")} & shown, check.name


def complaints(check: str, now: Situation) -> list[str]:
    return [line.found for line in BY_NAME[check](now) if line.verdict is not Verdict.PASS]


def test_a_logger_on_the_folder_is_noticed(tmp_path: Path, ready: Situation) -> None:
    there = replace(ready, out=tmp_path)
    with folder_lock(tmp_path):
        assert "another logger" in complaints("other logger", there)[0]
    assert not complaints("other logger", there)


def test_the_space_of_a_disk_that_takes_nothing_is_not_reported(ready: Situation) -> None:
    mounted = [line.split() for line in Path("/proc/self/mounts").read_text().splitlines()]
    readonly = [Path(words[1]) for words in mounted if words[3].split(",")[0] == "ro" and Path(words[1]).is_dir()]
    if not readonly:
        pytest.skip("no file system is mounted read-only here")
    there = replace(ready, out=readonly[0])
    assert complaints("folder", there)
    assert list(BY_NAME["disk space"](there)) == []


def test_a_port_in_use_is_noticed(ready: Situation) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert complaints("status page", replace(ready, page_port=taken.getsockname()[1]))


def test_asammdf_beside_python_can_is_noticed(
    tmp_path: Path, ready: Situation, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "asammdf.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    assert "asammdf" in complaints("Python", ready)[0]


def test_a_vehicle_that_is_well_fails_no_check(ready: Situation) -> None:
    lines = list(examine(ready))
    assert [line for line in lines if line.verdict is Verdict.FAIL] == []
    assert {line.check for line in lines} <= set(BY_NAME)  # and so none is without a name
    assert ready.bytes_per_s > 0


def test_the_kernel_is_asked_for_its_clock(tmp_path: Path) -> None:
    status = kernel_clock_status()
    assert status is None or 0 <= status < 1 << 16
    took_s = sync_times_s(tmp_path, 3)
    assert len(took_s) == 3
    assert min(took_s) > 0


def test_what_nothing_is_known_of_still_gives_lines(tmp_path: Path) -> None:
    """A vehicle.toml that cannot be used leaves the machine to be looked at."""
    lines = list(examine(written(tmp_path, "no toml")))
    named = {line.check for line in lines}
    assert {"vehicle.toml", "host clock", "folder", "disk speed", "Python"} <= named
    assert [line.check for line in lines if line.verdict is Verdict.FAIL] == ["vehicle.toml"]
    assert not {"DBC files", "roles", "traffic", "zero"} & named  # what would be said of them is not true
    assert sum("vehicle.toml has faults: DBC files, roles" in line.found for line in lines) == 1


def test_a_bus_twice_in_the_file_is_received_once(tmp_path: Path) -> None:
    text = '[[bus]]\nchannel = "twice"\ninterface = "virtual"\n' * 2
    assert list(written(tmp_path, text).receptions) == ["twice"]
