"""Small whole files of every format that is read, and how each is read to its end."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import can
import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from database_texts import ARXML, KCD, SYM
from frames_support import some_frames
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from daq import RunsConfig, TerrainConfig, VehicleConfig, parse_toml
from daq.can import load_database, messages_from_frames, shipped_dbc
from daq.logs import read_log, write_candump
from daq.recording import Recording, RecordingWriter
from daq.series import read_series
from daq.series.tables import read_table

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Format:
    """A format: the suffix of its files, what writes a small one, and what reads one to its end."""

    suffix: str
    write: Callable[[Path], None]
    read: Callable[[Path], object]
    weight: float = 1.0
    """Share of the inputs; less for what takes long."""


def _frames(path: Path) -> None:
    with can.Logger(path) as writer:
        for message in messages_from_frames(some_frames(np.random.default_rng(0), 60).frames):
            simple = not (message.is_fd or message.is_error_frame or message.is_remote_frame)
            if path.suffix == ".asc" or simple:
                writer.on_message_received(message)


def _text(text: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(text)

    return write


def _mcap(path: Path) -> None:
    with RecordingWriter(path, attachments={"vehicle.toml": b"[vehicle]\n"}, overwrite=True) as writer:
        for _ in range(3):
            writer.write_frames(some_frames(np.random.default_rng(0), 60))
            writer.flush()


def _parquet(path: Path) -> None:
    pq.write_table(pa.table({"time_s": np.arange(50) / 100, "Fz [N]": np.arange(50.0)}), path)


def _mat(path: Path) -> None:
    savemat(path, {"Fz": {"time": np.arange(50) / 100, "data": np.arange(50.0), "unit": "N"}, "a": np.eye(3)})


def _hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["Fz/time"], file["Fz/values"] = np.arange(50) / 100, np.arange(50.0)
        file["Fz/values"].attrs["unit"] = "N"


def _tdms(path: Path) -> None:
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("rack", "Fz", np.arange(50.0), {"wf_increment": 0.01})])


def _rpc3(path: Path) -> None:
    header = {"FORMAT": "BINARY", "NUM_HEADER_BLOCKS": "4", "NUM_PARAMS": "12", "DELTA_T": "0.01", "CHANNELS": "1"}
    header |= {"PTS_PER_FRAME": "16", "PTS_PER_GROUP": "16", "FRAMES": "4", "DATA_TYPE": "SHORT_INTEGER"}
    header |= {"DESC.CHAN_1": "Fz", "UNITS.CHAN_1": "N", "SCALE.CHAN_1": "0.5"}
    records = b"".join(struct.pack("<32s96s", key.encode(), value.encode()) for key, value in header.items())
    path.write_bytes(records.ljust(2048, b"\0") + np.arange(64, dtype="<i2").tobytes())


def _log(path: Path) -> object:
    return sum(map(len, read_log(path)))


def _recording(path: Path) -> object:
    recording = Recording.open(path)
    return recording.frames(), recording.events(), recording.loss, recording.metadata, recording.run


def _series(path: Path) -> object:
    series = read_series(path)
    return sum(len(block) for blocks in series.blocks() for block in blocks), series.report.remarks()


def _toml(path: Path) -> object:
    text = path.read_bytes().decode("utf-8", "replace")
    kind = VehicleConfig if "[wheel]" in text else TerrainConfig if "[soil]" in text else RunsConfig
    return parse_toml(text, kind, str(path))


_SERIES_CSV = "Time [s];Fz [kN];state\n" + "".join(f"{i / 100};{i * 1.5};go\n" for i in range(60))
_FRAMES_CSV = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n" + "".join(
    f"{i * 1000},00000{i:03X},false,Rx,0,3,01,02,{i:02X},\n" for i in range(60)
)
_BUSMASTER = (
    "***BUSMASTER Ver 2.4.0***\n***HEX***\n***SYSTEM MODE***\n***START DATE AND TIME 8:8:2014 11:49:7:965***\n"
    + ("11:49:12:9420 Rx 1 0x023 s 1 40\n" * 40)
)
_CLAY = ROOT / "recordings" / "clay"

FORMATS = {
    "candump": Format(".log", lambda path: _write_candump(path), _log),
    "asc": Format(".asc", _frames, _log),
    "trc": Format(".trc", _frames, _log),
    "blf": Format(".blf", _frames, _log),
    "frames in csv": Format(".csv", _text(_FRAMES_CSV), _log),
    "busmaster": Format(".log", _text(_BUSMASTER), _log),
    "mcap": Format(".mcap", _mcap, _recording),
    "series in csv": Format(".csv", _text(_SERIES_CSV), _series),
    "parquet": Format(".parquet", _parquet, _series),
    "mat": Format(".mat", _mat, _series, weight=0.02),
    "hdf5": Format(".h5", _hdf5, _series, weight=0.02),
    "tdms": Format(".tdms", _tdms, _series),
    "rpc iii": Format(".rsp", _rpc3, _series),
    "table": Format(".csv", _text("slip,vertical_load_n\n" + "0.1,2\n" * 30), read_table),
    "vehicle.toml": Format(".toml", _text((_CLAY / "vehicle.toml").read_text()), _toml),
    "terrain.toml": Format(".toml", _text((_CLAY / "terrain.toml").read_text()), _toml),
    "dbc": Format(".dbc", _text(shipped_dbc("wheel_speed.dbc").read_text()), load_database, weight=0.2),
    "kcd": Format(".kcd", _text(KCD), load_database, weight=0.2),
    "sym": Format(".sym", _text(SYM), load_database, weight=0.1),
    "arxml": Format(".arxml", _text(ARXML), load_database, weight=0.1),
}


def _write_candump(path: Path) -> None:
    write_candump([some_frames(np.random.default_rng(0), 60)], path)


def whole_file(name: str, folder: Path) -> bytes:
    """Return a file of a format as its own writer makes it."""
    path = folder / f"whole{FORMATS[name].suffix}"
    FORMATS[name].write(path)
    return path.read_bytes()
