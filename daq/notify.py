"""What a service manager is told: ready, alive, stopping (systemd's sd_notify protocol, without its library)."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping


class Notifier:
    """Sends states to the socket that the service manager gave; without one it says nothing.

    Parameters
    ----------
    address : str
        Path of a datagram socket; a leading ``@`` is one in the abstract namespace. Empty: nobody listens.
    """

    def __init__(self, address: str = "") -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> Notifier:
        """Return the one that ``NOTIFY_SOCKET`` asks for."""
        return cls(environment.get("NOTIFY_SOCKET", ""))

    def ready(self, status: str = "") -> None:
        """Say that the service has started."""
        self._send("READY=1", f"STATUS={status}")

    def alive(self) -> None:
        """Say that the service still does its work."""
        self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Say in a line what it does."""
        self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """Say that the service is about to end."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Let go of the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, *lines: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # a manager that does not listen is no reason to stop recording
                self._socket.sendto("\n".join(line.replace("\n", " ") for line in lines).encode(), self._address)
