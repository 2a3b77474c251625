"""A vehicle whose nodes send on a virtual bus, for the doctor."""

from __future__ import annotations

import shutil
import socket
import threading
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from daq import VehicleConfig, load_toml
from daq.can import CLASSIC_DTYPE, FrameFlag, encode, merge
from daq.can.databases import load_for_vehicle
from daq.sources import open_sink

SHIPPED = Path(__file__).parents[1] / "dbc"
PERIOD_S = 0.01


def vehicle_folder(folder: Path, **replaced: str) -> Path:
    """Write the shipped vehicle with its DBCs onto a virtual bus of its own; return its vehicle.toml.

    Parameters
    ----------
    folder : Path
    **replaced : str
        Lines ``key = ...`` of the file to write anew.
    """
    folder.mkdir(exist_ok=True)
    for path in SHIPPED.glob("*.dbc"):
        shutil.copy(path, folder)
    lines = {"channel": f'"bus-{uuid.uuid4().hex}"', "interface": '"virtual"', **replaced}
    text = "\n".join(
        f"{key} = {lines[key]}" if (key := line.partition(" = ")[0]) in lines else line
        for line in (SHIPPED / "vehicle.toml").read_text(encoding="utf-8").splitlines()
    )
    (folder / "vehicle.toml").write_text(text, encoding="utf-8")
    return folder / "vehicle.toml"


@contextmanager
def nodes(
    vehicle_file: Path, *, without: tuple[str, ...] = (), errors: bool = False, **values: float
) -> Iterator[None]:
    """Have every message of the vehicle's DBCs sent each 10 ms, with the GNSS time that it is.

    Parameters
    ----------
    vehicle_file : Path
    without : tuple of str
        Messages that are not sent.
    errors : bool
        Whether an error frame goes before each round.
    **values : float
        Signals that are not 1; ``TimeOfDay`` is added to the time.
    """
    vehicle = load_toml(vehicle_file, VehicleConfig)
    (bus,) = vehicle.bus
    messages = [m for d in load_for_vehicle(vehicle, vehicle_file.parent)[bus.channel] for m in d.messages]
    sent = [message for message in messages if message.name not in without]
    done = threading.Event()

    def send() -> None:
        sink = open_sink(bus)
        while not done.wait(PERIOD_S):
            now_ns = time.time_ns()
            sent_values = {
                "Status": 0.0,
                **values,
                "TimeOfDay": (now_ns * 1e-9 + values.get("TimeOfDay", 0.0)) % 86_400,
            }
            batch = merge([encode(m, _of(m.by_name, sent_values), [now_ns], bus.channel).frames for m in sent])
            if errors:
                sink.send(_error_frame(), 1.0)
            sink.send(batch.frames, 1.0)
        sink.close()

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def free_port() -> int:
    """Return a port that nobody has."""
    with socket.socket() as made:
        made.bind(("127.0.0.1", 0))
        return int(made.getsockname()[1])


def _of(names: Mapping[str, object], sent_values: Mapping[str, float]) -> dict[str, float]:
    return {name: sent_values.get(name, 1.0) for name in names}


def _error_frame() -> np.ndarray:
    frame = np.zeros(1, CLASSIC_DTYPE)
    frame["flags"], frame["length"], frame["can_id"] = FrameFlag.ERROR, 8, 0x008
    return frame
