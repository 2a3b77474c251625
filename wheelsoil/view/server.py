"""The page's server: its paths take and give JSON, and every error is a list of faults; it serves until Ctrl-C."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import threading
import webbrowser
from collections.abc import Callable, Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from daq import ConfigError, DataError, Fault, HardwareError, WheelsoilError
from wheelsoil.cli.console import printable_addresses
from wheelsoil.view.analysis_session import Desk, UnknownKeyError
from wheelsoil.view.campaigns import NotReadyError
from wheelsoil.view.entries import fault_of_ours, faults_as_json
from wheelsoil.view.opening import Files
from wheelsoil.view.requests import Asked, CampaignAsked, ChoiceAsked, CurveAsked, SaveAsked, SelectedAsked, asked_of
from wheelsoil.web.guard import POLICY, Guard, Rules, files_in, routes_of
from wheelsoil.web.listening import checked_token, listen, page_addresses
from wheelsoil.web.serving import server_of
from wheelsoil.wording.model_styles import styles_script
from wheelsoil.wording.to_json import to_json

LARGEST_BODY_BYTES = 1 << 18
"""A choice of many parts of many runs."""

_POLICY = POLICY.replace("img-src 'self'", "img-src 'self' data: blob:")
"""plotly.js makes an image of a drawing without a server; its style comes as a file, /plotly.css."""
_STATUS: tuple[tuple[type[WheelsoilError], int], ...] = (
    (UnknownKeyError, 404),
    (NotReadyError, 409),
    (ConfigError, 400),
    (DataError, 422),
    (WheelsoilError, 500),
)
_log = logging.getLogger(__name__)


def make_app(desk: Desk, rules: Rules) -> ASGIApp:
    """Return the page as an ASGI application.

    Parameters
    ----------
    desk : Desk
    rules : Rules
    """

    def choose(asked: ChoiceAsked) -> Any:
        return desk.choose(asked.campaign, asked.choice)

    def save(asked: SaveAsked) -> Any:
        return desk.save(asked.campaign, asked.name, replace_it=asked.replace)

    def fit(asked: CampaignAsked) -> Any:
        return desk.fit(asked.campaign)

    def diagnose(asked: CampaignAsked) -> Any:
        return desk.diagnose(asked.campaign)

    page = files_in("wheelsoil.web") | files_in("wheelsoil.view")
    page |= {"/plotly.js": _plotly(), "/styles.js": styles_script()}
    routes = [
        _get("/api/list", lambda _: desk.list()),
        _get("/api/run", lambda of: desk.run(of("campaign"), of("run"))),
        _get("/api/parameters", lambda of: desk.parameters(of("campaign"))),
        _get("/api/diagnosis", lambda of: desk.diagnosis(of("campaign"))),
        _post("/api/curve", CurveAsked, desk.curve),
        _post("/api/selected", SelectedAsked, desk.selected),
        _post("/api/choose", ChoiceAsked, choose),
        _post("/api/fit", CampaignAsked, fit),
        _post("/api/diagnose", CampaignAsked, diagnose, 202),
        _post("/api/save", SaveAsked, save),
    ]
    app = Starlette(routes=[*routes_of(page), *routes])
    return Guard(app, rules, frozenset(page), largest_body_bytes=LARGEST_BODY_BYTES, policy=_POLICY)


def _get(path: str, answer: Callable[[Callable[[str], str]], Any]) -> Route:
    async def handle(request: Request) -> Response:
        def of(name: str) -> str:
            given = request.query_params.getlist(name)
            if len(given) != 1:
                raise ConfigError(Fault(f"{name} is not given once", path, expected=f"?{name}=KEY"))
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
    """Return what is answered."""
    try:
        return _json(await run_in_threadpool(answer), status)
    except WheelsoilError as error:
        return _json(faults_as_json(error.faults), next(code for kind, code in _STATUS if isinstance(error, kind)))
    except Exception as error:  # noqa: BLE001  # the page's boundary: the next request may be answered
        _log.exception("the page")
        return _json(faults_as_json([fault_of_ours(error)]), 500)


def _json(value: Any, status: int) -> Response:
    body = to_json(value, indent=None).encode("utf-8", "replace")  # a file's name may be no UTF-8
    return Response(body, status, media_type="application/json")


def _plotly() -> bytes:
    return (files("plotly") / "package_data" / "plotly.min.js").read_bytes()


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
        See `daq.runs.open.open_runs`.
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
                _tell(desk.remarks, printable_addresses(addresses, token), say)
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
