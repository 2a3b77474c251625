"""The page's server: JSON requests and answers, every error as a list of faults; it runs until Ctrl-C."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from daq import ConfigError, DataError, WheelsoilError
from wheelsoil.console import printable_addresses
from wheelsoil.to_json import to_json
from wheelsoil.view.analysis_session import AnalysisSession, UnknownKeyError
from wheelsoil.view.campaigns import NotReadyError
from wheelsoil.view.messages import (
    Asked,
    CampaignAsked,
    ChoiceAsked,
    CurveAsked,
    PredictionAsked,
    SaveAsked,
    SelectedAsked,
    asked_of,
    fault_of_ours,
    faults_as_json,
)
from wheelsoil.web.listening import PortTakenError, checked_token, listen, page_addresses
from wheelsoil.web.serving import Guard, Rules, files_in, routes_of, server_of
from wheelsoil.workflows.runs import Files

LARGEST_BODY_BYTES = 1 << 18
"""Enough for a choice of many parts of many runs."""

_STATUS: tuple[tuple[type[WheelsoilError], int], ...] = (
    (UnknownKeyError, 404),
    (NotReadyError, 409),
    (ConfigError, 400),
    (DataError, 422),
    (WheelsoilError, 500),
)
_log = logging.getLogger(__name__)

PORT = 8200
_TRIED = 20
_PAGE = "analyst's page"
_OTHER = "another `wheelsoil view`"
_TERMINATED_EXIT = 143


def make_app(session: AnalysisSession, rules: Rules) -> ASGIApp:
    """Return the page as an ASGI application."""
    page = files_in("wheelsoil.web") | files_in("wheelsoil.view")
    routes = [
        _get("/api/list", lambda _: session.list()),
        _get("/api/run", lambda of: session.run(of("campaign"), of("run"))),
        _get("/api/signals", lambda of: session.signals(of("campaign"), of("run"))),
        _get("/api/signal", lambda of: session.signal(of("campaign"), of("run"), of("name"))),
        _get(
            "/api/compare",
            lambda of: session.compare([(of("campaign"), of("run")), (of("campaign_b"), of("run_b"))]),
        ),
        _get("/api/parameters", lambda of: session.parameters(of("campaign"))),
        _get("/api/diagnosis", lambda of: session.diagnosis(of("campaign"))),
        _post("/api/curve", CurveAsked, session.curve),
        _post("/api/prediction", PredictionAsked, session.prediction),
        _post("/api/selected", SelectedAsked, session.selected),
        _post("/api/choose", ChoiceAsked, lambda asked: session.choose(asked.campaign, asked.choice)),
        _post("/api/fit", CampaignAsked, lambda asked: session.fit(asked.campaign)),
        _post("/api/diagnose", CampaignAsked, lambda asked: session.diagnose(asked.campaign), 202),
        _post("/api/cancel", CampaignAsked, lambda asked: session.cancel(asked.campaign)),
        _post("/api/save", SaveAsked, lambda asked: session.save(asked.campaign, asked.name, replace_it=asked.replace)),
    ]
    app = Starlette(routes=[*routes_of(page), *routes])
    return Guard(app, rules, frozenset(page), largest_body_bytes=LARGEST_BODY_BYTES)


def _get(path: str, answer: Callable[[Callable[[str], str]], Any]) -> Route:
    async def handle(request: Request) -> Response:
        def of(name: str) -> str:
            given = request.query_params.getlist(name)
            if len(given) != 1:
                raise ConfigError.of(f"{name} is not given exactly once", path, expected=f"?{name}=KEY")
            return given[0]

        return await _answered(lambda: answer(of), 200)

    return Route(path, handle, methods=["GET"])


def _post(path: str, kind: type[Asked], answer: Callable[[Asked], Any], status: int = 200) -> Route:
    async def handle(request: Request) -> Response:
        try:
            body = await request.body()
        except ClientDisconnect:
            return Response(status_code=400)
        return await _answered(lambda: answer(asked_of(body, kind)), status)

    return Route(path, handle, methods=["POST"])


async def _answered(answer: Callable[[], Any], status: int) -> Response:
    """Return the response: the answer, or its faults."""
    try:
        return _json(await run_in_threadpool(answer), status)
    except WheelsoilError as error:
        return _json(faults_as_json(error.faults), next(code for kind, code in _STATUS if isinstance(error, kind)))
    except Exception as error:  # noqa: BLE001  # boundary of the page: the next request may succeed
        _log.exception("the page")
        return _json(faults_as_json([fault_of_ours(error)]), 500)


def _json(value: Any, status: int) -> Response:
    body = to_json(value, indent=None).encode("utf-8", "replace")  # a file's name may not be UTF-8
    return Response(body, status, media_type="application/json")


def serve(
    paths: Sequence[Path],
    files: Files,
    *,
    host: str,
    port: int | None,
    token: str | None,
    browser: bool,
    say: Callable[[str], None],
    against: str = "",
) -> None:
    """Open the recordings and serve the page until Ctrl-C or SIGTERM.

    Parameters
    ----------
    host : str
        Any address except this machine's loopback requires a token.
    port : int or None
        None: `PORT`, or the next free one.
    token : str or None
        None: no token on a loopback address, a new random one elsewhere.
    browser : bool
        Open a browser if there is a display.
    say : callable
        Prints the addresses and the skipped files.
    against : str
        See `AnalysisSession`.

    Raises
    ------
    HardwareError
        The address cannot be listened on, or the port is taken.
    WheelsoilError
        See `daq.runs.open_runs`.
    KeyboardInterrupt
        Ctrl-C.
    """
    with listening_on(host, port) as listening:
        bound = listening.getsockname()[0]
        token_asked = checked_token(token, bound)
        addresses = page_addresses(listening, token_asked)
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        signal.signal(signal.SIGTERM, _end)
        try:
            session = AnalysisSession(paths, files, against)
            try:
                _print_addresses(session.remarks, printable_addresses(addresses, token), say)
                if browser and _has_display():
                    threading.Thread(target=webbrowser.open, args=(addresses[0],), daemon=True).start()
                server = server_of(make_app(session, Rules.of(host, bound, token_asked)), session.close)
                for number in before:
                    signal.signal(number, server.handle_exit)  # an exception would break asyncio's start
                asyncio.run(server.serve(sockets=[listening]))
            finally:
                session.close()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        if server.ended_by == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(_TERMINATED_EXIT)


def _print_addresses(remarks: Iterable[str], addresses: Iterable[str], say: Callable[[str], None]) -> None:
    for remark in remarks:
        say(remark)
    for address in addresses:
        say(f"{_PAGE}: {address}")
    say("Ctrl-C ends")


def listening_on(host: str, port: int | None) -> socket.socket:
    """Return a listening socket; without a port on `PORT` or the next free one. See `listen` for errors."""
    if port is not None:
        return listen(host, port, page=_PAGE, other=_OTHER)
    for tried in range(PORT, PORT + _TRIED):
        try:
            return listen(host, tried, 0.0, page=_PAGE, other=_OTHER)
        except PortTakenError:
            if tried == PORT + _TRIED - 1:
                raise
    raise AssertionError("every port was tried")


def _has_display() -> bool:
    always = sys.platform in ("win32", "darwin")
    return always or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _end(_: int, __: FrameType | None) -> NoReturn:
    raise SystemExit(_TERMINATED_EXIT)
