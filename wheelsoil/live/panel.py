"""The logger's side of the status page: it never blocks, and it restarts the page's process when that ends."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from daq.logger import Command
from wheelsoil.live.wire import GOODBYE, LARGEST_BYTES, command_from, packed
from wheelsoil.web.listening import checked_token, listen, page_addresses

RESTART_S = 5.0
"""Shortest time between two starts of the page's process."""

_GOODBYE_S = 2.0
_MOST_COMMANDS = 32
_COMMANDS_BYTES = 8192
"""Limit of waiting commands: few, so that none is executed long after it was sent."""
_HOME = Path(__file__).resolve().parents[2]


class PagePanel:
    """A `daq.logger.panel.Panel` whose page runs in a separate process.

    A pair of datagram sockets, kept over restarts of the page, connects the two processes. A datagram that does not
    fit because the page is slow, stopped or dead is dropped and counted. A thread starts the process and waits for
    its end, so that the logger's own thread never does. The kernel kills the process when the logger dies.

    Parameters
    ----------
    host : str
        Address to listen on. Any address except this machine's loopback requires a token.
    port : int
        0: a free one.
    token : str or None
        Token that the page requires. None: no token on a loopback address, a new random one elsewhere.
    vehicle : str
        Name that the page shows before the first snapshot.

    Raises
    ------
    HardwareError
        The address cannot be listened on, or the port is taken.
    ConfigError
        The token or the port cannot be used.

    Attributes
    ----------
    addresses : tuple of str
        URLs that open the page, token included.
    dropped : int
        Number of snapshots that the page did not accept.
    starts : int
        Number of starts of the page's process.
    pid : int or None
        Process id of the page; None while it is not running.
    fault : str
        Why the page's process does not start or stay; empty while it runs.
    """

    def __init__(self, host: str, port: int, token: str | None, vehicle: str, restart_s: float = RESTART_S) -> None:
        self._listening = listen(host, port)
        bound, self.port = self._listening.getsockname()[:2]
        try:
            self.token = checked_token(token, bound)
        except BaseException:
            self._listening.close()
            raise
        self.addresses = page_addresses(self._listening, self.token)
        self.dropped = self.starts = 0
        self.pid: int | None = None
        self.fault = ""
        self._ours, self._theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end, size in ((self._ours, LARGEST_BYTES), (self._theirs, _COMMANDS_BYTES)):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, size)
            end.setblocking(False)
        settings = {"vehicle": vehicle, "token": self.token, "host": host, "bound": bound, "logger": os.getpid()}
        self._settings = json.dumps(settings).encode()
        self._restart_s = restart_s
        self._closing = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._keeper = threading.Thread(target=self._keep, name="status page", daemon=True)
        self._keeper.start()

    @property
    def address(self) -> str:
        """The URL to open first."""
        return self.addresses[0]

    def show(self, snapshot: Mapping[str, Any]) -> None:
        """Send a snapshot to the page, or drop it; see `daq.logger.panel.Panel`."""
        if self._closing.is_set():
            return
        try:
            self._ours.send(packed(snapshot))
        except (OSError, ValueError, RecursionError):
            self.dropped += 1

    def commands(self) -> list[Command]:
        """Return the commands received since the last call."""
        found: list[Command] = []
        while not self._closing.is_set() and len(found) < _MOST_COMMANDS:
            try:
                datagram = self._ours.recv(1 << 14)
            except OSError:
                break
            command = command_from(datagram)
            if not isinstance(command, str):
                found.append(command)
        return found

    def close(self) -> None:
        """Notify the page that the logger ends, and end the page."""
        if self._closing.is_set():
            return
        self._closing.set()
        try:
            self._ours.send(GOODBYE)
        except OSError:
            self.dropped += 1
        self._ours.shutdown(socket.SHUT_RDWR)
        self._keeper.join(_GOODBYE_S)
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()
            self._keeper.join(_GOODBYE_S)
        for end in (self._ours, self._theirs, self._listening):
            end.close()

    def _keep(self) -> None:
        """Start the page's process whenever it is not running."""
        while not self._closing.is_set():
            started_s = time.monotonic()
            try:
                self._process = self._started()
            except OSError as error:  # no memory or no process left: the logger has priority
                self.fault = f"its process cannot be started: {error.strerror or error}"
            else:
                self.starts += 1
                self.pid = self._process.pid
                if not self._ends_early(self._process):
                    self.fault = ""
                    self._process.wait()
                self.pid = None
            self._closing.wait(max(0.0, started_s + self._restart_s - time.monotonic()))

    def _ends_early(self, process: subprocess.Popen[bytes]) -> bool:
        """Return whether the process ends before the next start would be due, and note that as the fault."""
        try:
            status = process.wait(self._restart_s)
        except subprocess.TimeoutExpired:
            return False
        if status > 0:  # below zero somebody ended it
            self.fault = f"its process ended at once, with status {status}"
        return True

    def _started(self) -> subprocess.Popen[bytes]:
        handles = (self._listening.fileno(), self._theirs.fileno())
        path = os.pathsep.join(filter(None, (str(_HOME), os.environ.get("PYTHONPATH"))))
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "wheelsoil.live.server", *map(str, handles)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=handles,
            start_new_session=True,  # the logger handles Ctrl-C
            env={**os.environ, "PYTHONPATH": path},
        )
        assert process.stdin is not None
        with suppress(BrokenPipeError), process.stdin as settings:
            settings.write(self._settings)  # not on the command line: the token is a secret
        return process
