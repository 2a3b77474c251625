"""The page's few paths."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from daq.panel import Command
from wheelsoil.live.guard import Guard, Rules
from wheelsoil.live.hub import MOST_STREAMS, Hub
from wheelsoil.live.wire import command_from

_FILES = {
    "/": ("page.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/page.js": ("page.js", "text/javascript"),
    "/connection.js": ("connection.js", "text/javascript"),
    "/commands.js": ("commands.js", "text/javascript"),
    "/parts.js": ("parts.js", "text/javascript"),
    "/plot.js": ("plot.js", "text/javascript"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
}
"""The empty page; it needs no token."""


def make_app(hub: Hub, pass_on: Callable[[Command], bool], rules: Rules) -> ASGIApp:
    """Return the page as an ASGI application.

    Parameters
    ----------
    hub : Hub
    pass_on : callable
        Hands a command to the logger; returns False when the logger does not take it.
    rules : Rules
    """

    async def events(_: Request) -> Response:
        if hub.streams >= MOST_STREAMS:
            return PlainTextResponse(f"{hub.streams} browsers look already: close one\n", 503)
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

    pages = [Route(path, _file(name, kind)) for path, (name, kind) in _FILES.items()]
    app = Starlette(
        routes=[*pages, Route("/events", events, methods=["GET"]), Route("/command", command, methods=["POST"])]
    )
    return Guard(app, rules, frozenset(_FILES))


def _file(name: str, kind: str) -> Callable[[Request], Response]:
    body = (files("wheelsoil.live") / "static" / name).read_bytes()

    def answer(_: Request) -> Response:
        return Response(body, media_type=kind)

    return answer
