"""The table of bad input: each gets one clear message with the next step and its exit code, never a traceback.

A case makes its input from a good campaign and returns the command line; the table says what must come of it.
"""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke

from daq import RunInfo
from daq.can import FrameBatch, encode, load_database, merge, shipped_dbc
from daq.recording import Recording, RecordingWriter

Make = Callable[["Bench"], list[object]]
FIT_HEAD = "slip,vertical_load_n,drawbar_pull_n"


@dataclass(frozen=True)
class Bench:
    """A folder to spoil things in, and a campaign that is good."""

    folder: Path
    campaign: Path

    @property
    def vehicle(self) -> str:
        return (self.campaign / "vehicle.toml").read_text()

    def copy(self) -> Path:
        """Return a copy of the campaign's first run with its files, without what the recording carries."""
        target = self.folder / "campaign"
        shutil.copytree(self.campaign, target)
        (target / "run-2.mcap").unlink()
        (target / "runs.toml").unlink()
        return target

    def respelled(self, old: str, new: str) -> Path:
        """Return a copy whose vehicle.toml is changed."""
        target = self.copy()
        assert old in self.vehicle, old
        (target / "vehicle.toml").write_text(self.vehicle.replace(old, new))
        return target

    def write(self, name: str, text: str) -> Path:
        path = self.folder / name
        path.write_text(text)
        return path

    def frames(self) -> FrameBatch:
        return Recording.open(self.campaign / "run-1.mcap").frames()

    def recording(self, frames: FrameBatch, chunk_bytes: int = 1 << 20) -> Path:
        carried = Recording.open(self.campaign / "run-1.mcap").attachments
        path, info = self.folder / "spoiled.mcap", RunInfo(id="spoiled")
        with RecordingWriter(path, run=info, attachments=carried, chunk_bytes=chunk_bytes) as writer:
            writer.write_frames(frames)
        return path

    def driven(self, **channels: float) -> Path:
        """Return 20 s of steady driving as a recording; quantities in SI, a NaN leaves the frames out."""
        given = {"load": 8000.0, "pull": 300.0, "rim": 2.0, "ground": 1.5} | channels
        messages = {
            m.name: m
            for f in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc")
            for m in load_database(shipped_dbc(f)).messages
        }
        start = 1_780_000_000_000_000_000

        def at(rate: float) -> np.ndarray:
            return start + (np.arange(int(20 * rate)) / rate * 1e9).astype(np.int64)

        rpm = given["rim"] / 0.47 * 60 / (2 * np.pi)
        parts = [
            encode(messages["WheelSpeeds"], {"RearLeft": rpm}, at(100), "can0").frames,
            encode(messages["GNSS_2"], {"Speed": given["ground"] * 3600 / 1852}, at(20), "can0").frames,
            encode(messages["GNSS_3"], {"SpeedValid": 1}, at(20), "can0").frames,
        ]
        if np.isfinite(given["load"]):
            parts.append(
                encode(messages["WFT_Forces"], {"Fx": given["pull"], "Fz": given["load"]}, at(200), "can0").frames
            )
        return self.recording(merge(parts))

    def table(self, *rows: str) -> list[object]:
        wheel = self.write("wheel.toml", "[wheel]\nradius_m = 0.3\nwidth_m = 0.2\n")
        data = self.write("table.csv", "\n".join([FIT_HEAD, *rows]) + "\n")
        return ["fit", "--table", data, "--vehicle", wheel, "--soil", "clay"]


def _two_dbcs_on_one_id(bench: Bench) -> list[object]:
    folder = bench.respelled('"gnss.dbc"', '"gnss.dbc", "other.dbc"')
    text = (folder / "wft.dbc").read_text().replace("WFT_Forces", "Someone_Else", 1).replace(" Fx ", " Gx ", 1)
    (folder / "other.dbc").write_text(text)
    return ["process", folder]


def _unknown_unit(bench: Bench) -> list[object]:
    folder = bench.copy()
    text = (folder / "wft.dbc").read_text(encoding="utf-8")
    (folder / "wft.dbc").write_text(text.replace('"N"', '"zorkmid"'), encoding="utf-8")
    return ["process", folder]


def _truncated(bench: Bench) -> list[object]:
    path = bench.recording(bench.frames(), chunk_bytes=100_000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    return ["process", path]


def _cut_in_the_header(bench: Bench) -> list[object]:
    path = bench.folder / "cut.mcap"
    path.write_bytes((bench.campaign / "run-1.mcap").read_bytes()[:5])
    return ["process", path]


def _foreign(bench: Bench) -> list[object]:
    from mcap.writer import Writer

    path = bench.folder / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "somebody else")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/temperature", "cdr", schema)
        writer.add_message(channel, 1, b"\0\1\0\0" + struct.pack("<d", 20.0), 1)
        writer.finish()
    vehicle = bench.campaign / "vehicle.toml"
    return ["process", path, "--vehicle", vehicle]


def _other_format(bench: Bench) -> list[object]:
    path = bench.folder / "run.blf"
    path.write_text("(1700000000.000000) can0 100#0011223344556677\n")
    return ["import", path, "-o", bench.folder / "run.mcap"]


def _low_slip(bench: Bench) -> list[object]:
    return ["fit", bench.driven(rim=1.52, ground=1.5), "--slip-threshold", 0.2]


def _nan_soil(bench: Bench) -> list[object]:
    folder = bench.copy()
    text = (folder / "terrain.toml").read_text()
    line = next(line for line in text.splitlines() if line.startswith("cohesion_kpa"))
    (folder / "terrain.toml").write_text(text.replace(line, "cohesion_kpa = nan", 1))
    return ["fit", folder]


def _soil_out_of_range(bench: Bench) -> list[object]:
    folder = bench.copy()
    text = (folder / "terrain.toml").read_text()
    for key, value in (("friction_angle_deg", 75), ("sinkage_exponent", -1)):
        line = next(line for line in text.splitlines() if line.startswith(key))
        text = text.replace(line, f"{key} = {value}", 1)
    (folder / "terrain.toml").write_text(text)
    return ["fit", folder]


def _changed(name: str, *changes: tuple[str, object], verb: str = "process") -> Make:
    """Return what makes the command on one run whose file of settings has other values."""

    def make(bench: Bench) -> list[object]:
        folder = bench.copy()
        text = (bench.campaign / name).read_text()
        for key, value in changes:
            line = next(line for line in text.splitlines() if line.startswith(key))
            text = text.replace(line, f"{key} = {value}", 1)
        (folder / name).write_text(text)
        return [verb, folder / "run-1.mcap"]

    return make


def _large_plate(bench: Bench) -> list[object]:
    return ["soil", "--plate", bench.write("plate.csv", "sinkage_m,pressure_pa\n0.01,1e4\n0.02,2e4\n"), "--radius", 50]


def _other_brakes(bench: Bench) -> list[object]:
    folder = bench.copy()
    text = (folder / "vehicle.toml").read_text()
    (folder / "vehicle.toml").write_text(text.replace('brakes = "released"', 'brakes = "parked"', 1))
    return ["process", folder]


def _several(bench: Bench) -> list[object]:
    return ["process", bench.folder / "a.mcap", bench.folder / "b.log"]


def _hostile_id(bench: Bench) -> list[object]:
    with RecordingWriter(bench.folder / "x.mcap", run=RunInfo(id="../../evil")) as writer:
        writer.write_frames(bench.frames()[:100])
    return ["export", bench.folder / "x.mcap", "-o", bench.folder / "out"]


def _table(*rows: str, head: str = FIT_HEAD, verb: str = "diagnose", wheel: str = "", soil: bool = True) -> Make:
    """Return what makes the command on a single-wheel table."""

    def make(bench: Bench) -> list[object]:
        table = bench.write("rows.csv", "\n".join([head, *rows, ""]))
        vehicle = bench.write("wheel.toml", f"[wheel]\nradius_m = 0.1\nwidth_m = 0.08\n{wheel}\n")
        return [verb, "--table", table, "--vehicle", vehicle, *(["--soil", "lunar"] if soil else [])]

    return make


_ROWS = ("0.1,25,5", "0.3,25,8", "0.5,25,9")


@dataclass(frozen=True)
class Case:
    name: str
    make: Make
    code: int
    says: tuple[str, ...]
    next_step: bool = True


CASES = (
    Case("table with loads in kN", _table("0.1,0.025,5", "0.3,0.025,8"), 1, ("not in N", "vertical_load_n*1000")),
    Case(
        "table with torques in N mm",
        _table("0.1,25,5,900", "0.3,25,8,1100", head=f"{FIT_HEAD},driving_torque_nm"),
        1,
        ("column 'driving_torque_nm' does not fit the load", "driving_torque_nm=driving_torque_nm*0.001"),
    ),
    Case("plate of 50 m", _large_plate, 2, ("radius_m is the size of no plate", "50 mm are 0.05 m")),
    Case(
        "vehicle lighter than its wheel's load",
        _changed("vehicle.toml", ("mass_kg", 360)),
        0,
        ("is more than the weight of the whole vehicle",),
    ),
    Case(
        "added load in grams",
        _changed("runs.toml", ("added_load_kg", 300000)),
        2,
        ("runs.toml: run 'run-1'", "at most 10 times mass_kg", "300000 g are 300 kg"),
    ),
    Case(
        "friction angle in radians",
        _changed("terrain.toml", ("friction_angle_deg", 0.244), verb="fit"),
        2,
        ("0.244 rad are 14.0 degrees",),
    ),
    Case(
        "moduli exchanged",
        _changed("terrain.toml", ("cohesive_modulus_kn", 580000), ("frictional_modulus_kn", 1), verb="fit"),
        0,
        ("k_c and k_phi are exchanged",),
    ),
    Case("table without a soil", _table(*_ROWS, soil=False), 2, ("the soil of the table is not known", "--terrain")),
    Case("table with one row", _table(_ROWS[0], verb="fit"), 1, ("too few driven samples", "three slips")),
    Case(
        "mixed wheels and one wheel file",
        _table("0.1,25,5,smooth", "0.1,25,7,lugged", head=f"{FIT_HEAD},wheel"),
        2,
        ("rows of several wheels, and one wheel file", "smooth, lugged", "--where wheel=NAME"),
    ),
    Case(
        "negative sinkage",
        _table("0.1,25,5,-0.004", head=f"{FIT_HEAD},sinkage_m"),
        1,
        ("line 2: -0.004", "--rename sinkage_m=sinkage_m*-1"),
    ),
    Case("lugs above the radius", _table(*_ROWS, wheel="lug_height_m = 0.12"), 2, ("not below radius_m",), False),
    Case(
        "lugs above the radius in a table",
        _table("0.1,25,5,0.1,12", head=f"{FIT_HEAD},radius_m,lug_height_m"),
        1,
        ("line 2: 12", "lug_height_m*0.001"),
    ),
    Case("missing file", lambda b: ["process", b.folder / "nowhere.mcap"], 3, ("no such file", "nowhere.mcap")),
    Case(
        "missing folder of the output",
        lambda b: ["report", b.campaign, "-o", b.folder / "no" / "r.html"],
        2,
        ("no such folder",),
    ),
    Case(
        "output is there",
        lambda b: ["report", b.campaign, "-o", b.campaign / "runs.toml"],
        2,
        ("exists already", "--force"),
    ),
    Case("several at once", _several, 3, ("2 faults", "a.mcap", "b.log")),
    Case("empty folder", lambda b: ["process", b.folder], 2, ("holds no run",)),
    Case("folder of campaigns", lambda b: ["report", b.campaign.parent], 2, ("next: name /", "/clay")),
    Case("runs.toml names a missing file", lambda b: _listing(b, "gone.mcap"), 3, ("no such file", "gone.mcap")),
    Case("empty file", lambda b: ["process", b.write("empty.mcap", "")], 3, ("empty",)),
    Case("truncated recording", _truncated, 0, ("read without what is damaged", "wheelsoil recover")),
    Case("recording cut in its header", _cut_in_the_header, 3, ("not an MCAP file",)),
    Case("foreign MCAP", _foreign, 3, ("no wheelsoil raw topics", "/temperature")),
    Case(
        "no MCAP at all",
        lambda b: ["process", b.write("x.mcap", "hello, this is no recording")],
        3,
        ("not an MCAP file",),
    ),
    Case("log of another format", _other_format, 3, ("looks like candump", "rename it")),
    Case(
        "no log at all",
        lambda b: ["import", b.write("x.log", "hello\nworld\n"), "-o", b.folder / "x.mcap"],
        3,
        ("no frame could be read",),
    ),
    Case("wrong DBC", lambda b: _replaced_dbc(b, "this is no DBC"), 2, ("cantools", "wft.dbc")),
    Case(
        "DBC that is not there",
        lambda b: ["process", b.respelled('"gnss.dbc"', '"gns.dbc"')],
        2,
        ("no such DBC file", "nearest: gnss.dbc"),
    ),
    Case("overlapping DBCs", _two_dbcs_on_one_id, 2, ("lay out identifier", "Someone_Else")),
    Case("unknown unit", _unknown_unit, 2, ("zorkmid", "WFT_Forces.Fz")),
    Case(
        "role that names no signal",
        lambda b: ["process", b.respelled("GNSS_2.Speed", "GNSS_2.Spede")],
        2,
        ("no DBC has a signal 'GNSS_2.Spede'", "nearest: GNSS_2.Speed"),
        False,
    ),
    Case(
        "role that does not exist",
        lambda b: ["process", b.respelled("ground_speed =", "grund_speed =")],
        2,
        ("grund_speed", "nearest: ground_speed"),
        False,
    ),
    Case(
        "role that is missing",
        lambda b: ["fit", b.respelled('vertical_load = "WFT_Forces.Fz"\n', "")],
        2,
        ("vertical_load", "[signals]"),
    ),
    Case("broken TOML", lambda b: ["process", b.respelled("[wheel]", "[wheel")], 2, ("not valid TOML",)),
    Case(
        "a table that is pasted a second time",
        lambda b: ["process", b.respelled("[transducer]", "[wheel]  # add\nradius_m = 0.5\n\n[transducer]")],
        2,
        ("wheel is given in line 6 and in line", "move what is new to the first, and delete the second"),
    ),
    Case(
        "a key that is given twice",
        lambda b: ["process", b.respelled("[wheel]", "[wheel]\nwidth_m = 0.3")],
        2,
        ("width_m is given in line 7 and in line 9",),
    ),
    Case(
        "a list over several lines that is given twice",
        lambda b: ["process", b.respelled("[wheel]", "[list]\n" + "\nx = [\n1,\n2]\n" * 2 + "[wheel]")],
        2,
        ("not valid TOML", "correct the line named above"),
    ),
    Case(
        "decimal comma", lambda b: ["process", b.respelled("= 0.47", "= 0,47 # m")], 2, ("point, without quotes: 0.47",)
    ),
    Case(
        "quoted comma",
        lambda b: ["process", b.respelled("= 0.47", '= "0,47"')],
        2,
        ("without quotes: 0.47", "radius_m"),
    ),
    Case(
        "unknown key",
        lambda b: ["process", b.respelled("radius_m", "radius_mm")],
        2,
        ("radius_mm", "nearest: radius_m"),
    ),
    Case(
        "no wheel",
        lambda b: ["process", b.driven(), "--vehicle", _without_wheel(b)],
        2,
        ("the wheel is not described", "no-wheel.toml"),
    ),
    Case("no vehicle", lambda b: ["process", _bare(b)], 2, ("no vehicle.toml", "--vehicle")),
    Case(
        "no soil",
        lambda b: ["fit", _bare(b), "--vehicle", b.campaign / "vehicle.toml"],
        2,
        ("the soil is not known", "--terrain"),
    ),
    Case(
        "unknown soil",
        lambda b: ["fit", b.campaign, "--soil", "clai"],
        2,
        ("no soil is called 'clai'", "nearest: clay"),
        False,
    ),
    Case("unknown channel", lambda b: ["fit", b.campaign, "--channels", "dp,q"], 2, ("no channel 'q'",)),
    Case("impossible threshold", lambda b: ["fit", b.campaign, "--slip-threshold", 2], 2, ("no slip",), False),
    Case(
        "empty run", lambda b: ["process", b.recording(b.frames()[:0])], 1, ("no sample of wheel_speed", "ground_speed")
    ),
    Case(
        "run without one of its messages",
        lambda b: ["process", b.recording(_without(b.frames(), 0x302))],
        1,
        ("no sample of ground_speed", "run spoiled, ", "spoiled.mcap: GNSS_2.Speed"),
    ),
    Case(
        "vehicle of another bus",
        lambda b: ["process", b.respelled('"can0"', '"can1"')],
        1,
        ("run run-1", "no bus of vehicle.toml (can1) is in the log (can0)", "campaign/vehicle.toml"),
    ),
    Case(
        "log of another bus",
        lambda b: ["fit", _log(b), "--vehicle", b.campaign / "vehicle.toml", "--soil", "clay"],
        1,
        ("no bus of vehicle.toml (can0) is in the log (vcan3)", "run other, ", "--bus old=new"),
    ),
    Case(
        "role without a signal in another file",
        lambda b: ["process", b.driven(), "--vehicle", _misspelled(b)],
        2,
        ("no DBC has a signal 'GNSS_2.Spede'", "misspelled.toml [signals] ground_speed"),
        False,
    ),
    Case(
        "run of an instant", lambda b: ["process", b.recording(b.frames()[:60])], 1, ("never there at the same time",)
    ),
    Case("no standstill", lambda b: ["process", b.driven()], 0, ("standstill",), False),
    Case("no slip above the threshold", _low_slip, 0, ("no slip at or above the threshold 0.2",), False),
    Case("no driven sample", lambda b: ["fit", b.driven(rim=1.4, ground=1.5)], 1, ("too few driven samples",)),
    Case("negative load", lambda b: ["fit", b.driven(load=-500.0)], 2, ("impossible", 'vertical_load = "-')),
    Case("no force at all", lambda b: ["fit", b.driven(load=np.nan)], 1, ("drawbar_pull",), False),
    Case("NaN in terrain.toml", _nan_soil, 2, ("cohesion_kpa",), False),
    Case("soil out of range", _soil_out_of_range, 2, ("2 faults", "friction_angle_deg", "sinkage_exponent"), False),
    Case(
        "brakes of another word",
        _other_brakes,
        2,
        (
            "vehicle.standstill_brakes",
            "found: 'parked'",
            'expected: "held", "released" or "unknown"',
            "write one of these",
        ),
    ),
    Case(
        "negative load in a table",
        lambda b: b.table("0.1,-100,5", "0.2,100,5"),
        1,
        ("vertical_load_n", "line 2"),
        False,
    ),
    Case("NaN in a table", lambda b: b.table("0.1,nan,5", "0.2,100,5"), 1, ("vertical_load_n",), False),
    Case("text in a table", lambda b: b.table("0.1,heavy,5", "0.2,100,5"), 1, ("vertical_load_n", "heavy"), False),
    Case(
        "column that is missing",
        lambda b: [
            "fit",
            "--table",
            b.write("t.csv", "slip,load\n0.1,5\n"),
            "--soil",
            "clay",
            "--vehicle",
            b.campaign / "vehicle.toml",
        ],
        2,
        ("vertical_load_n",),
    ),
    Case(
        "table without a wheel",
        lambda b: ["fit", "--table", b.write("t.csv", FIT_HEAD + "\n0.1,5,5\n"), "--soil", "clay"],
        2,
        ("the wheel is not known",),
    ),
    Case(
        "runs and a table",
        lambda b: ["fit", b.campaign, "--table", b.write("t.csv", FIT_HEAD)],
        2,
        ("exclude each other",),
    ),
    Case("no run", lambda _: ["fit"], 2, ("no run is given",)),
    Case("names from data stay in their folder", _hostile_id, 2, ("no DBC is known",)),
    Case(
        "bus that is not in the log",
        lambda b: _import(b, "--bus", "vcan7=can0"),
        1,
        ("no log has a bus 'vcan7'",),
        False,
    ),
    Case("option that is not understood", lambda b: _import(b, "--bus", "vcan7"), 2, ("--bus vcan7",), False),
    Case(
        "unknown interface",
        lambda b: ["replay", b.campaign / "run-1.mcap", "--interface", "sokketcan"],
        2,
        ("no interface 'sokketcan'",),
        False,
    ),
    Case(
        "bus that is not recorded",
        lambda b: ["replay", b.campaign / "run-1.mcap", "--channel", "can9=can0"],
        2,
        ("no bus is called 'can9'",),
        False,
    ),
    Case(
        "vehicle without a bus",
        lambda b: ["log", b.write("v.toml", "[vehicle]\n"), "--duration", 1],
        2,
        ("no bus to record",),
    ),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_bad_input_gets_its_message_and_exit_code(case: Case, campaign: Path, tmp_path: Path) -> None:
    result = invoke(*case.make(Bench(tmp_path, campaign)))
    assert result.code == case.code, result.err
    assert "Traceback" not in result.err
    for text in case.says:
        assert text in result.err
    if case.code:
        assert result.out == "", "an error says nothing on stdout"
    if case.next_step and case.code:
        assert "next:" in result.err


def _listing(bench: Bench, name: str) -> list[object]:
    folder = bench.copy()
    (folder / "runs.toml").write_text(f'[[run]]\nfile = "{name}"\n')
    return ["process", folder]


def _replaced_dbc(bench: Bench, text: str) -> list[object]:
    folder = bench.copy()
    (folder / "wft.dbc").write_text(text)
    return ["process", folder]


def _without_wheel(bench: Bench) -> Path:
    for name in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc"):
        shutil.copy(bench.campaign / name, bench.folder / name)
    lines = bench.vehicle.split("[wheel]")
    return bench.write("no-wheel.toml", lines[0] + "[" + lines[1].partition("\n[")[2])


def _misspelled(bench: Bench) -> Path:
    target = bench.respelled("GNSS_2.Speed", "GNSS_2.Spede")
    return (target / "vehicle.toml").rename(target / "misspelled.toml")


def _log(bench: Bench) -> Path:
    return bench.write("other.log", "(1700000000.000000) vcan3 100#0011223344556677\n")


def _bare(bench: Bench) -> Path:
    with RecordingWriter(bench.folder / "bare.mcap") as writer:
        writer.write_frames(bench.frames())
    return bench.folder / "bare.mcap"


def _without(frames: FrameBatch, can_id: int) -> FrameBatch:
    return frames[frames.frames["can_id"] != can_id]


def _import(bench: Bench, *options: str) -> list[object]:
    log = bench.write("run.log", "(1700000000.000000) can0 100#0011223344556677\n")
    return ["import", log, "-o", bench.folder / "out.mcap", *options]
