"""Real logs against answers that others computed."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from support import data_dir

from daq.can import CLASSIC_DTYPE, FrameBatch, FrameFlag, coverage, decode, load_database
from daq.errors import DatabaseError

LINE = re.compile(rb"\((\d+)\.(\d{6})\) (\S+) ([0-9A-F]+)#([0-9A-F]*)")


def candump(path: Path) -> FrameBatch:
    """Read a gzipped candump log; independent of the product's own reader."""
    rows = LINE.findall(gzip.decompress(path.read_bytes()))
    buses = sorted({bus.decode() for _, _, bus, _, _ in rows})
    frames = np.zeros(len(rows), CLASSIC_DTYPE)
    frames["time_ns"] = [int(s) * 10**9 + int(us) * 1000 for s, us, *_ in rows]
    frames["bus"] = [buses.index(bus.decode()) for _, _, bus, _, _ in rows]
    frames["can_id"] = [int(can_id, 16) for *_, can_id, _ in rows]
    frames["flags"] = [FrameFlag.EXTENDED if len(can_id) > 3 else 0 for *_, can_id, _ in rows]
    frames["length"] = [len(data) // 2 for *_, data in rows]
    frames["data"] = np.frombuffer(
        b"".join(bytes.fromhex(row[4].decode()).ljust(8, b"\0") for row in rows), "u1"
    ).reshape(-1, 8)
    return FrameBatch(frames, tuple(buses))


def test_comma2k19_wheel_speeds_equal_the_answer_key() -> None:
    folder = data_dir("comma2k19-example1")
    with pytest.raises(DatabaseError, match=r"line 753: VAL_ 295 GEAR(.|\n)*--lenient-dbc"):
        load_database(folder / "toyota_rav4_2019.dbc")
    database = load_database(folder / "toyota_rav4_2019.dbc", lenient=True)
    assert len(database.left_out) == 1
    assert "line 753: VAL_ 295 GEAR" in database.left_out[0]
    channels = decode(candump(folder / "candump.log.gz"), {"can0": [database]})
    key = np.load(folder / "processed_log" / "CAN" / "wheel_speed" / "value.npy")
    times = np.load(folder / "processed_log" / "CAN" / "wheel_speed" / "t.npy")
    assert key.shape == (4974, 4)
    for column, wheel in enumerate(("FL", "FR", "RL", "RR")):
        channel = channels["can0", f"WHEEL_SPEEDS.WHEEL_SPEED_{wheel}"]
        np.testing.assert_allclose(channel.values / 3.6, key[:, column], rtol=0, atol=1e-12)
        np.testing.assert_allclose(channel.time_ns * 1e-9, times, rtol=0, atol=1e-6)


def test_a_truck_is_decoded_by_parameter_group() -> None:
    folder = data_dir("css-canedge")
    database = load_database(folder / "CSS-Electronics-SAE-J1939-DEMO.dbc")
    frames = candump(folder / "truck_j1939_stationary.candump.log.gz")
    bus = next(name for name in frames.buses if name.endswith("1"))
    channels = decode(frames, {bus: [database]})
    on_bus = frames.on_bus(bus).frames
    group = (on_bus["can_id"] >> 8) & 0x3FFFF
    for number, name, first, scale in (
        (0xF004, "EEC1.EngineSpeed", 3, 0.125),
        (0xFEF1, "CCVS1.WheelBasedVehicleSpeed", 1, 1 / 256),
    ):
        rows = on_bus[(group == number) & (on_bus["flags"] & FrameFlag.EXTENDED != 0)]
        raw = rows["data"][:, first] + 256.0 * rows["data"][:, first + 1]
        assert len(rows) > 3000
        np.testing.assert_array_equal(channels[bus, name].values, raw * scale)
        np.testing.assert_array_equal(channels[bus, name].time_ns, rows["time_ns"])
    known = {row.message for row in coverage(frames, {bus: [database]}).ids if row.message}
    assert known == {"EEC1", "CCVS1"}


def test_a_gps_module_is_decoded_with_its_validity() -> None:
    folder = data_dir("css-canedge")
    database = load_database(folder / "canmod-gps.dbc")
    frames = candump(folder / "car_3BA199E2_165_2.candump.log.gz")
    bus = next(name for name in frames.buses if name.endswith("2"))
    channels = decode(frames, {bus: [database]})
    speed, valid = channels[bus, "gnss_speed.Speed"], channels[bus, "gnss_speed.SpeedValid"]
    assert valid.labels == {0: "Invalid", 1: "Valid"}
    assert 0 <= speed.values[valid.values == 1].max() < 60
    latitude = channels[bus, "gnss_pos.Latitude"].values[channels[bus, "gnss_pos.PositionValid"].values == 1]
    assert np.ptp(latitude) < 0.5
