"""Serves the page until Ctrl-C."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import threading
import webbrowser
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from daq.errors import HardwareError
from wheelsoil.cli.talk import addresses_to_tell
from wheelsoil.view.app import make_app
from wheelsoil.view.desk import Desk
from wheelsoil.view.opening import Files
from wheelsoil.web.guard import Rules
from wheelsoil.web.listening import checked_token, listen, page_addresses
from wheelsoil.web.serving import server_of

PORT = 8200
_TRIED = 20
_PAGE = "analyst's page"
_TERMINATED_EXIT = 143


def serve(
    paths: Sequence[Path],
    files: Files,
    *,
    host: str,
    port: int | None,
    token: str | None,
    browser: bool,
    say: Callable[[str], None],
) -> None:
    """Open the recordings and serve the page until the process is told to end.

    Parameters
    ----------
    paths : sequence of Path
    files : Files
    host : str
        Anything but this machine's own loopback asks for a token.
    port : int or None
        None: `PORT`, or the next that is free.
    token : str or None
        None: none on a loopback address, a new random one elsewhere.
    browser : bool
        Open one, where there is a display.
    say : callable
        Is told the addresses, and what was left out.

    Raises
    ------
    HardwareError
        The address cannot be listened on, or the port is taken.
    WheelsoilError
        See `daq.open.open_runs`.
    KeyboardInterrupt
        Ctrl-C.
    """
    with listening_on(host, port) as listening:
        bound = listening.getsockname()[0]
        token_asked = checked_token(token, bound)
        addresses = page_addresses(listening, token_asked)
        before = signal.signal(signal.SIGTERM, _end)
        try:
            desk = Desk(paths, files)
            try:
                _tell(desk.remarks, addresses_to_tell(addresses, token), say)
                if browser and _has_display():
                    threading.Thread(target=webbrowser.open, args=(addresses[0],), daemon=True).start()
                server = server_of(make_app(desk, Rules.of(host, bound, token_asked)), desk.close)
                asyncio.run(server.serve(sockets=[listening]))
            finally:
                desk.close()
        finally:
            signal.signal(signal.SIGTERM, before)


def _tell(remarks: Iterable[str], addresses: Iterable[str], say: Callable[[str], None]) -> None:
    for remark in remarks:
        say(remark)
    for address in addresses:
        say(f"{_PAGE}: {address}")
    say("Ctrl-C ends")


def listening_on(host: str, port: int | None) -> socket.socket:
    """Return a listening socket; without a port on `PORT` or the next free one.

    Raises
    ------
    HardwareError, ConfigError
        See `wheelsoil.web.listening.listen`.
    """
    if port is not None:
        return listen(host, port, page=_PAGE)
    for tried in range(PORT, PORT + _TRIED):
        try:
            return listen(host, tried, 0.0, page=_PAGE)
        except HardwareError as error:
            taken = "is taken" in error.faults[0].what
            if not taken or tried == PORT + _TRIED - 1:
                raise
    raise AssertionError("every port was tried")


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _end(_: int, __: FrameType | None) -> NoReturn:
    raise SystemExit(_TERMINATED_EXIT)
