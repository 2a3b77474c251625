"""The files that make an empty page: read once, and served without a token."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import PurePosixPath

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

_KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def files_in(package: str) -> dict[str, bytes]:
    """Return the files in a package's folder ``static`` by their path on the page; ``page.html`` is ``/``."""
    folder = files(package) / "static"
    found = [each for each in folder.iterdir() if PurePosixPath(each.name).suffix in _KINDS]
    return {"/" if each.name == "page.html" else f"/{each.name}": each.read_bytes() for each in found}


def routes_of(page: Mapping[str, bytes]) -> list[Route]:
    """Return a route for each file."""
    return [Route(path, _answer(path, body), methods=["GET"]) for path, body in page.items()]


def _answer(path: str, body: bytes) -> Callable[[Request], Response]:
    kind = _KINDS[PurePosixPath(path).suffix or ".html"]

    def answer(_: Request) -> Response:
        return Response(body, media_type=kind)

    return answer
