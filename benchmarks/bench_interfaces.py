"""Logging through an interface of python-can: `wheelsoil log` and `can.logger` at once on a UDP multicast bus."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from can.interfaces.udp_multicast.utils import pack_message

from benchmarks import stand_in
from benchmarks.can_log import AUX_DBC, databases, test_log
from benchmarks.table import Row, at_least, compared
from benchmarks.timing import spent_by
from daq.can import messages_from_frames, shipped_dbc

GROUP, PORT = "239.74.163.7", 43113
"""Where python-can's udp_multicast listens if it is not told a port."""
RATE_HZ = 6000.0
STARTED_S, MEASURED_S, ROUNDS = 5.0, 10.0, 3
WAYS = {"record only": (["--no-view"], 1.2), "with decode and view": ([], 1.5)}
"""Options of our logger, and the most that it may take, times what the peer takes."""
PEER = "can.logger to BLF"
VEHICLE = """\
[wheel]
radius_m = 0.4
width_m = 0.2
[[bus]]
channel = "{group}"
interface = "udp_multicast"
dbc = {dbcs}
[signals]
drawbar_pull = "WFT_Forces.Fx"
vertical_load = "WFT_Forces.Fz"
"""


def rows() -> list[Row]:
    """Measure what a frame costs each logger of the same bus, started and warm."""
    frames = test_log(26.0, databases()).frames[: round(RATE_HZ * (STARTED_S + MEASURED_S + 5))]
    datagrams = [pack_message(message) for message in messages_from_frames(frames)]
    took: dict[str, list[float]] = {name: [] for name in (*WAYS, PEER)}
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            for name, seconds in _round(Path(folder), datagrams).items():
                took[name].append(seconds / (RATE_HZ * MEASURED_S))
    what = f"log {RATE_HZ / 1e3:g} kframes/s through python-can's udp_multicast, a frame"
    return [
        compared(
            f"{what}, {name}", took[name], PEER, took[PEER], lambda s: f"{1e6 * s:.1f} us", at_least(1 / most, "x")
        )
        for name, (_, most) in WAYS.items()
    ]


def _round(folder: Path, datagrams: list[bytes]) -> dict[str, float]:
    """Return the processor time of each logger while the same frames came."""
    with ExitStack() as stack:
        children = {
            name: stack.enter_context(_child(_ours(folder / name, options))) for name, (options, _) in WAYS.items()
        }
        command = [
            sys.executable,
            "-m",
            "can.logger",
            "-i",
            "udp_multicast",
            "-c",
            GROUP,
            "-f",
            str(folder / "peer.blf"),
        ]
        children[PEER] = stack.enter_context(_child(command))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            sender.connect((GROUP, PORT))
            warm = round(RATE_HZ * STARTED_S)
            stand_in.send(sender, datagrams[:warm], RATE_HZ)
            before = {name: spent_by(child.pid) for name, child in children.items()}
            stand_in.send(sender, datagrams[warm : warm + round(RATE_HZ * MEASURED_S)], RATE_HZ)
            return {name: spent_by(child.pid) - before[name] for name, child in children.items()}


def _ours(folder: Path, options: Sequence[str]) -> list[str]:
    folder.mkdir()
    (folder / "aux.dbc").write_text(AUX_DBC, encoding="utf-8")
    dbcs = [str(shipped_dbc(f"{name}.dbc")) for name in ("wft", "wheel_speed", "gnss")] + ["aux.dbc"]
    vehicle = folder / "vehicle.toml"
    vehicle.write_text(VEHICLE.format(group=GROUP, dbcs=json.dumps(dbcs)), encoding="utf-8")
    command = str(Path(sys.executable).with_name("wheelsoil"))
    return [command, "log", str(vehicle), "-o", str(folder / "run.mcap"), "--no-page", *options]


@contextmanager
def _child(command: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Give a process that ends by an interrupt."""
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet) as child:
        try:
            yield child
            if child.poll() is not None:
                raise subprocess.CalledProcessError(child.returncode, command)
        finally:
            child.send_signal(signal.SIGINT)
            child.wait(30)
