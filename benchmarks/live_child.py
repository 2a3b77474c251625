"""A logger in a process of its own, fed through a stand-in bus: ``python -m benchmarks.live_child KIND FOLDER``.

Prints the port it listens at, records until its standard input ends, and prints how much processor time it took from
the first line there to the closed file, how much of it for judging (health), and how many frames it recorded.
"""

from __future__ import annotations

import _thread
import json
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import stand_in
from benchmarks.can_log import databases

Ready = Callable[[socket.socket], None]


class Judging:
    """The processor time that the health monitor takes."""

    seconds = 0.0

    def watch(self) -> None:
        """Measure from now on."""
        from daq.logger.health import HealthMonitor

        for name in ("take", "report"):
            setattr(HealthMonitor, name, self._timed(getattr(HealthMonitor, name)))

    def _timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **options: Any) -> Any:
            start = time.thread_time()
            try:
                return function(*args, **options)
            finally:
                self.seconds += time.thread_time() - start

        return timed


def ours(folder: Path, stop: threading.Event, ready: Ready, flush_s: float = 0.2) -> int:
    """Record as `wheelsoil log` does: receive, write, decode, judge."""
    from daq import VehicleConfig
    from daq.logger import log
    from daq.sources import SocketCanSource

    receiver = stand_in.listening()
    vehicle = VehicleConfig.model_validate(
        {
            "bus": [{"channel": "lo", "bitrate": 1_000_000}],
            "signals": {"drawbar_pull": "WFT_Forces.Fx", "vertical_load": "WFT_Forces.Fz"},
            "logger": {"flush_s": flush_s, "sync_s": max(flush_s, 1.0), "disk_reserve_mb": 1},
        }
    )
    done = log(
        vehicle,
        folder / f"{'flushed' if flush_s < 1 else 'unflushed'}.mcap",
        databases={"lo": tuple(databases())},
        stop=stop,
        progress=lambda _: ready(receiver),
        opener=lambda bus: SocketCanSource(bus.channel, made=receiver),
    )
    return done.frames["lo"]


def can_logger(folder: Path, ready: Ready) -> int:
    """Record into a BLF as python-can's script `can_logger` does, which ends by an interrupt."""
    import can

    receiver = stand_in.listening()
    bus = stand_in.python_can_bus(receiver)
    logger = can.Logger(str(folder / "can_logger.blf"))
    ready(receiver)
    try:
        while True:
            msg = bus.recv(1)
            if msg is not None:
                logger(msg)
    except KeyboardInterrupt:
        pass
    finally:
        bus.shutdown()
        logger.stop()
    return int(logger.object_count)


def notifier(folder: Path, stop: threading.Event, ready: Ready) -> int:
    """Record into a BLF with python-can's Notifier, the way its documentation shows for programs of one's own."""
    import can

    receiver = stand_in.listening()
    bus = stand_in.python_can_bus(receiver)
    writer = can.Logger(str(folder / "notifier.blf"))
    listening = can.Notifier(bus, [writer])
    ready(receiver)
    stop.wait()
    listening.stop()  # and the writer
    bus.shutdown()
    return int(writer.object_count)


def main(kind: str, folder: Path) -> None:
    stop = threading.Event()
    listening: list[socket.socket] = []
    began: list[tuple[float, float]] = []
    judging = Judging()
    judging.watch()

    def ready(receiver: socket.socket) -> None:
        if not listening:
            listening.append(receiver)
            print(receiver.getsockname()[1], flush=True)

    def listen() -> None:
        sys.stdin.readline()
        began.append((time.process_time(), judging.seconds))
        sys.stdin.read()
        stand_in.wait_until_read(listening[0])
        stop.set()
        if kind == "can_logger":
            _thread.interrupt_main()

    threading.Thread(target=listen, daemon=True).start()
    frames = {
        "ours": lambda: ours(folder, stop, ready),
        "unflushed": lambda: ours(folder, stop, ready, flush_s=1e6),
        "can_logger": lambda: can_logger(folder, ready),
        "notifier": lambda: notifier(folder, stop, ready),
    }[kind]()
    [(cpu_s, judged_s)] = began
    print(json.dumps([time.process_time() - cpu_s, judging.seconds - judged_s, frames]), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
