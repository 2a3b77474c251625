"""Routes of the status page."""

from __future__ import annotations

from collections.abc import Callable

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from daq.logger import Command
from wheelsoil.live.hub import MOST_STREAMS, Hub
from wheelsoil.live.wire import command_from
from wheelsoil.web.guard import Guard, Rules, files_in, routes_of


def make_app(hub: Hub, pass_on: Callable[[Command], bool], rules: Rules) -> ASGIApp:
    """Return the page as an ASGI application.

    Parameters
    ----------
    pass_on : callable
        Hands a command to the logger; returns False when the logger does not take it.
    """

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
