"""Loading DBCs: what ships, what is refused and how it says so, and several on one bus."""

from __future__ import annotations

import logging
from pathlib import Path

import cantools.database
import pytest
from cantools.database import errors
from hypothesis import example, given
from hypothesis import strategies as st

from daq import ConfigError, Quantity, VehicleConfig, find_unit, load_toml
from daq.can import load_database, messages_by_bus, shipped_dbc
from daq.can.databases import load_for_vehicle
from daq.can.signal_places import misplaced
from daq.errors import DatabaseError

SHIPPED = ("wft.dbc", "wheel_speed.dbc", "gnss.dbc")
GOOD = """VERSION ""
BU_: A
BO_ 256 Alpha: 8 A
 SG_ One : 0|16@1+ (1,0) [0|0] "N" A
 SG_ Two : 16|16@1+ (1,0) [0|0] "N" A

BO_ 257 Beta: 8 A
 SG_ Three : 0|16@1+ (1,0) [0|0] "N" A
"""


def vehicle(*dbcs: str, channel: str = "can0") -> VehicleConfig:
    return VehicleConfig.model_validate({"bus": [{"channel": channel, "dbc": list(dbcs)}]})


@pytest.mark.parametrize("name", [*SHIPPED, "motion.dbc"])
def test_shipped_files_load_strictly_and_are_complete(name: str) -> None:
    reference = cantools.database.load_file(shipped_dbc(name), strict=True)
    database = load_database(shipped_dbc(name))
    assert database.left_out == ()
    assert [m.name for m in database.messages] == [m.name for m in reference.messages]
    for message in database.messages:
        assert message.comment
        assert message.cycle_time_s in (0.001, 0.01, 0.05)
        for signal in message.signals:
            assert signal.comment
            assert any(find_unit(signal.unit, [quantity]) for quantity in Quantity)
            assert signal.minimum is not None and signal.maximum is not None
            low, high = sorted(raw * signal.scale + signal.offset for raw in signal.raw_range)
            assert low <= signal.minimum < signal.maximum <= high


def test_the_example_vehicle_loads_with_its_files() -> None:
    path = shipped_dbc("wft.dbc").with_name("vehicle.toml")
    databases = load_for_vehicle(load_toml(path, VehicleConfig), path.parent)
    assert [database.name for database in databases["can0"]] == list(SHIPPED)
    assert len(messages_by_bus(databases)["can0"]) == 7


def test_an_unknown_shipped_name_comes_with_the_nearest() -> None:
    with pytest.raises(DatabaseError, match=r"nearest: wheel_speed\.dbc"):
        shipped_dbc("wheelspeed.dbc")


def test_a_file_and_its_content_give_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.dbc").write_bytes(GOOD.encode())
    one, two = load_database(tmp_path / "a.dbc"), load_database(GOOD.encode(), "a.dbc")
    assert one == two
    assert len(one.sha256) == 64


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_either_encoding_of_the_degree_sign_is_understood(encoding: str) -> None:
    database = load_database(GOOD.replace('"N"', '"°/s"').replace("\n", "\r\n").encode(encoding), "a.dbc")
    unit = database.messages[0].signals[0].unit
    assert unit == "°/s"


@pytest.mark.parametrize(
    ("more", "line", "why", "kept"),
    [
        ('VAL_ 256 Gear 0 "P" ;', 9, "no signal Gear in a message 256", 2),
        ("SIG_VALTYPE_ 256 Gear : 1;", 9, "no signal Gear in a message 256", 2),
        ('CM_ SG_ 256 "lost name";', 9, "syntax error", 2),
        ('CM_ "no end"\nBO_ 9 C: 8 A', 9, r"no end \(;\)", 3),
        ('BO_ 4096 Wide: 8 A\n SG_ X : 0|8@1+ (1,0) [0|0] "" A', 9, "too long for an 11-bit identifier", 2),
        ('BO_ 9 C: 8 A\n SG_ 2X : 0|8@1+ (1,0) [0|0] "" A', 10, "syntax error", 3),
        ('BO_ 9 2C: 8 A\n SG_ X : 0|8@1+ (1,0) [0|0] "" A', 9, "syntax error", 2),
        ('BO_ 9 C: 8 A\n SG_ 2 M : 0|8@1+ (1,x) [0|0] "" A\n SG_ Y m1 : 8|8@1+ (1,0) [0|0] "" A', 9, "syntax", 2),
    ],
)
def test_a_bad_line_is_named_and_a_lenient_load_leaves_it_out(more: str, line: int, why: str, kept: int) -> None:
    content = (GOOD + more + "\n").encode()
    with pytest.raises(DatabaseError, match=rf"{why}(.|\n)*line {line}: (.|\n)*--lenient-dbc") as refused:
        load_database(content, "a.dbc")
    assert refused.value.exit_code == 2
    database = load_database(content, "a.dbc", lenient=True)
    assert len(database.messages) == kept
    assert any(f"line {line}: " in note for note in database.left_out)
    assert database.lenient


def test_what_belongs_to_other_messages_stays_when_a_block_is_left_out() -> None:
    text = """VERSION ""
BU_: A
BO_ 5 Mux: 8 A
 SG_ Which M : 0|4@1+ (1,0) [0|0] "" A
 SG_ Ranged m0 : 8|8@1+ (1,0) [0|0] "" A

BO_ 4096 Wide: 8 A
 SG_ X : 0|8@1+ (1,0) [0|0] "" A

SG_MUL_VAL_ 5 Ranged Which 0-3;
"""
    (message,) = load_database(text.encode(), "a.dbc", lenient=True).messages
    assert message.by_name["Ranged"].multiplexer_ids == (0, 1, 2, 3)


def test_overlapping_signals_are_refused_and_let_pass_leniently() -> None:
    content = GOOD.replace("16|16@1+", "8|16@1+").encode()
    with pytest.raises(DatabaseError, match=r"overlapping(.|\n)*line 4: (.|\n)*line 5: "):
        load_database(content, "a.dbc")
    database = load_database(content, "a.dbc", lenient=True)
    assert "overlapping" in database.left_out[0]
    assert len(database.messages[0].signals) == 2


@st.composite
def laid_out(draw: st.DrawFn) -> str:
    """A message of a few signals, some of them multiplexed, that may overlap or reach beyond it."""
    length, many = draw(st.integers(0, 8)), draw(st.booleans())
    lines = [' SG_ Which M : 0|4@1+ (1,0) [0|0] "" A'] if many else []
    for i in range(draw(st.integers(1, 5))):
        start, bits = draw(st.integers(0, 70)), draw(st.integers(1, 20))
        case = draw(st.sampled_from(["", " m0", " m1"])) if many else ""
        lines.append(f' SG_ S{i}{case} : {start}|{bits}@{draw(st.sampled_from("01"))}+ (1,0) [0|0] "" A')
    return "\n".join(['VERSION ""', "BU_: A", f"BO_ 5 M: {length} A", *lines, ""])


@given(laid_out())
@example('VERSION ""\nBU_: A\nBO_ 5 M: 8 A\n SG_ S0 : 7|8@0+ (1,0) [0|0] "" A\n SG_ S1 : 8|8@1+ (1,0) [0|0] "" A\n')
def test_signals_are_misplaced_where_cantools_says_so(text: str) -> None:
    [message] = cantools.database.load_string(text, "dbc", strict=False).messages
    said = ""
    try:
        message.refresh(strict=True)
    except errors.Error as error:
        said = str(error)
    told = misplaced(message)
    assert bool(told) == bool(said)
    if said:
        assert told.split(" in message")[0].split(" and ")[0] == said.split(" in message")[0].split(" and ")[0]


def test_an_identifier_twice_is_refused_and_the_last_wins_leniently() -> None:
    content = GOOD.replace("BO_ 257", "BO_ 256").encode()
    with pytest.raises(DatabaseError, match=r"0x100 is defined twice(.|\n)*Alpha, Beta"):
        load_database(content, "a.dbc")
    assert [m.name for m in load_database(content, "a.dbc", lenient=True).messages] == ["Beta"]


@pytest.mark.parametrize("content", [b"", b"\x00\x01\xff\xfe binary", b"BLF log file\x00", b"{}", b"VERSION"])
def test_a_file_that_is_no_dbc_is_reported(content: bytes) -> None:
    for lenient in (False, True):
        with pytest.raises(DatabaseError, match="DBC"):
            load_database(content, "a.dbc", lenient=lenient)


def test_files_that_are_not_there_are_all_named(tmp_path: Path) -> None:
    (tmp_path / "wheels.dbc").write_text(GOOD)
    with pytest.raises(DatabaseError, match=r"2 faults(.|\n)*wheel\.dbc(.|\n)*nearest: wheels\.dbc(.|\n)*b\.dbc"):
        load_for_vehicle(vehicle("wheel.dbc", "b.dbc"), tmp_path)
    with pytest.raises(ConfigError):
        load_database(tmp_path)


def test_a_shipped_name_is_found_from_any_folder(tmp_path: Path) -> None:
    databases = load_for_vehicle(vehicle("gnss.dbc"), tmp_path)
    assert databases["can0"][0].messages[0].name == "GNSS_1"


def test_two_layouts_of_one_identifier_on_a_bus_are_all_listed() -> None:
    one = load_database(GOOD.encode(), "one.dbc")
    other = load_database(GOOD.replace("(1,0)", "(2,0)").encode(), "other.dbc")
    with pytest.raises(DatabaseError, match=r"2 faults(.|\n)*0x100(.|\n)*one\.dbc(.|\n)*other\.dbc(.|\n)*0x101"):
        messages_by_bus({"can0": [one, other]})
    messages_by_bus({"can0": [one], "can1": [other]})


def test_the_same_layout_twice_is_fine() -> None:
    again = GOOD + 'CM_ BO_ 256 "said differently";\n'
    merged = messages_by_bus({"can0": [load_database(GOOD.encode(), "a.dbc"), load_database(again.encode(), "b.dbc")]})
    assert list(merged["can0"]) == ["Alpha", "Beta"]


def test_cantools_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    logging.getLogger("cantools").handlers.clear()
    load_database(GOOD.replace("Beta", "Alpha").encode(), "a.dbc", lenient=True)
    captured = capfd.readouterr()
    assert captured.out == captured.err == ""
