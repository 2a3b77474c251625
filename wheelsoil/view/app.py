"""The page's paths: what is asked comes in as JSON, what is answered goes out as JSON, and every error as faults."""

from __future__ import annotations

import logging
from collections.abc import Callable
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from daq.errors import ConfigError, DataError, Fault, WheelsoilError
from wheelsoil.model_styles import styles_script
from wheelsoil.plain import to_json
from wheelsoil.view.campaigns import NotReadyError
from wheelsoil.view.desk import Desk, UnknownKeyError
from wheelsoil.view.entries import fault_of_ours, faults_as_json
from wheelsoil.view.requests import Asked, CampaignAsked, ChoiceAsked, CurveAsked, SaveAsked, SelectedAsked, asked_of
from wheelsoil.web.files import files_in, routes_of
from wheelsoil.web.guard import POLICY, Guard, Rules

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
