"""Process of the status page: ``python -m wheelsoil.live.server LISTENING PAIR``, started by `PagePanel` only.

The numbers are the file descriptors of the listening socket and of the pair's end; the settings come as JSON on stdin.
"""

from __future__ import annotations

import asyncio
import ctypes
import json
import os
import signal
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp
from uvicorn import Server

from daq.logger import Command
from wheelsoil.live.hub import MOST_STREAMS, Hub
from wheelsoil.live.wire import LARGEST_BYTES, command_from, packed_command, unpacked
from wheelsoil.web.serving import Guard, Rules, files_in, routes_of, server_of

_NICENESS = 10
_FIRST_TO_GO = "900"
_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Serve the page until the logger ends."""
    settings = json.load(sys.stdin)
    # Let the kernel kill this process when the logger dies, for whatever reason.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != settings["logger"]:
        sys.exit()
    # Yield the processor to the logger, and let the kernel kill this process first when memory is short.
    with suppress(OSError):  # a service manager may forbid it
        os.nice(_NICENESS)
        Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_GO, encoding="ascii")
    listening, pair = (socket.socket(fileno=int(handle)) for handle in sys.argv[1:3])
    listening.setblocking(False)
    pair.setblocking(False)
    rules = Rules.of(settings["host"], settings["bound"], settings["token"])
    asyncio.run(_serve(listening, pair, rules, settings["vehicle"]))


def make_app(hub: Hub, pass_on: Callable[[Command], bool], rules: Rules) -> ASGIApp:
    """Return the page as an ASGI application; `pass_on` returns False when the logger does not take the command."""

    async def events(_: Request) -> Response:
        if hub.streams >= MOST_STREAMS:
            return PlainTextResponse(f"{hub.streams} browsers have this page open already: close one\n", 503)
        return StreamingResponse(hub.stream(), media_type="text/event-stream")

    async def command(request: Request) -> Response:
        try:
            asked = command_from(await request.body())
        except ClientDisconnect:
            return Response(status_code=400)
        if isinstance(asked, str):
            return PlainTextResponse(f"{asked}\n", 400)
        if not pass_on(asked):
            return PlainTextResponse("the logger does not take commands now\n", 503)
        return Response(status_code=202)

    page = files_in("wheelsoil.web") | files_in("wheelsoil.live")
    routes = [Route("/events", events, methods=["GET"]), Route("/command", command, methods=["POST"])]
    return Guard(Starlette(routes=[*routes_of(page), *routes]), rules, frozenset(page))


async def _serve(listening: socket.socket, pair: socket.socket, rules: Rules, vehicle: str) -> None:
    hub = Hub(vehicle)

    def pass_on(command: Command) -> bool:
        with suppress(OSError):
            return pair.send(packed_command(command)) > 0
        return False

    server = server_of(make_app(hub, pass_on, rules))
    follower = asyncio.create_task(_follow(pair, hub, server))
    await server.serve(sockets=[listening])
    follower.cancel()


async def _follow(pair: socket.socket, hub: Hub, server: Server) -> None:
    """Forward the logger's snapshots until it says goodbye or has ended."""
    loop = asyncio.get_running_loop()
    while datagram := await loop.sock_recv(pair, LARGEST_BYTES):
        message = unpacked(datagram)
        if "goodbye" in message:
            await hub.end()
            break
        try:
            await hub.take(message)
        except Exception as error:  # noqa: BLE001  # the next snapshot may be valid
            print(f"status page: a snapshot was skipped: {error!r}", file=sys.stderr)
    server.should_exit = True


if __name__ == "__main__":
    main()
