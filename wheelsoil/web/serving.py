"""HTTP of both pages: files, checks of a request (host, origin, token, kind, size), limits on connections."""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import PurePosixPath
from types import FrameType

import uvicorn
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from wheelsoil.web.listening import is_loopback

_KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}

LARGEST_BODY_BYTES = 4096

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""A browser may load files of this page only: no inline script or style, and nothing from elsewhere."""

_HEADERS = {
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}

PATIENCE_S = 10.0

_MOST_CONNECTIONS = 64
_MOST_STRANGERS = 32
"""Connections on which no token was shown: browsers load the page itself on six each, in a moment."""
_FAREWELL_S = 1


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


@dataclass(frozen=True)
class Rules:
    """Access rules of a page: the IP address it listens on, accepted host names in lower case, and the token."""

    bound: str
    names: frozenset[str]
    token: str | None

    @classmethod
    def of(cls, host: str, bound: str, token: str | None) -> Rules:
        """Return the rules of a page that listens on `host`, bound to the IP address `bound`."""
        names = {"localhost", host.lower()}
        if not is_loopback(bound):
            names |= {socket.gethostname().lower()}
        return cls(bound, frozenset(names), token)

    def knows_host(self, header: str) -> bool:
        """Return whether a Host header names this machine.

        Another site can let its own name resolve to this machine (DNS rebinding), but not an IP address, and not a
        name under ``.local``, which belongs to this network.
        """
        name = _host_name(header)
        if name in self.names:
            return True
        open_to_others = not is_loopback(self.bound)
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return open_to_others and name.endswith(".local")
        return open_to_others or address.is_loopback

    def knows_token(self, header: str) -> bool:
        """Return whether an Authorization header carries the token; takes equally long for every wrong one."""
        if self.token is None:
            return True
        return hmac.compare_digest(header.encode(), f"Bearer {self.token}".encode())


class Guard:
    """An ASGI application around the page that rejects the requests that `Rules` do not allow.

    `open_paths` need no token; `policy` is the Content-Security-Policy.
    """

    def __init__(
        self,
        app: ASGIApp,
        rules: Rules,
        open_paths: frozenset[str],
        *,
        largest_body_bytes: int = LARGEST_BODY_BYTES,
        policy: str = POLICY,
    ) -> None:
        self._app = app
        self._rules = rules
        self._open_paths = open_paths
        self._largest_body_bytes = largest_body_bytes
        self._headers = {"content-security-policy": policy, **_HEADERS}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; see ASGI."""

        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self._headers)
            await send(message)

        refusal = self._refusal(scope["method"], scope["path"], Headers(scope=scope))
        if refusal is None and scope["path"] not in self._open_paths and "connection" in scope.get("state", {}):
            scope["state"]["connection"].is_known = True
        await (refusal or self._app)(scope, receive, send_safely)

    def _refusal(self, method: str, path: str, headers: Headers) -> PlainTextResponse | None:
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or not self._rules.knows_host(hosts[0]):
            return PlainTextResponse("unknown host name: open the page by this machine's IP address\n", 421)
        if origins and list(origins) not in (
            [f"http://{hosts[0]}"],
            [f"https://{hosts[0]}"],
        ):  # browsers send it with every POST, programs need not
            return PlainTextResponse("requested by a page of another site\n", 403)
        if path not in self._open_paths and headers.get("sec-fetch-site", "same-origin") != "same-origin":
            return PlainTextResponse("requested by a page of another site\n", 403)
        if path not in self._open_paths and not self._rules.knows_token(headers.get("authorization", "")):
            return PlainTextResponse("the token is missing or wrong\n", 401, {"www-authenticate": "Bearer"})
        if method == "POST":
            return _unfit_body(headers, self._largest_body_bytes)
        return None


def _unfit_body(headers: Headers, largest_bytes: int) -> PlainTextResponse | None:
    if headers.get("content-type", "").split(";")[0].strip().lower() != "application/json":
        return PlainTextResponse("the body must be application/json\n", 415)
    size = headers.get("content-length", "")
    if not size.isdecimal() or "transfer-encoding" in headers:  # it would take precedence over the stated size
        return PlainTextResponse("the body's length is not stated\n", 411)
    if int(size) > largest_bytes:
        return PlainTextResponse(f"more than {largest_bytes} bytes\n", 413)
    return None


def _host_name(header: str) -> str:
    """Return the name in a Host header: lower case, without port, brackets and closing dot."""
    name = header.strip().lower()
    if name.startswith("["):
        return name[1:].partition("]")[0]
    return name.partition(":")[0].removesuffix(".")


class Connection(H11Protocol):
    """HTTP/1.1 that closes a connection without a complete request for `PATIENCE_S`, unless an answer is pending.

    Where there are more than `_MOST_STRANGERS`, the oldest one is closed for a new one, so that connections without a
    token cannot hold all places.

    Attributes
    ----------
    is_known : bool
        Whether a request for data or a command has been accepted on it; `Guard` sets it.
    """

    is_known = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """See `asyncio.Protocol`."""
        self.app_state = {**self.app_state, "connection": self}
        self._made_at_s = self.loop.time()
        super().connection_made(transport)
        strangers = [
            connection
            for connection in self.connections
            if isinstance(connection, Connection) and not connection.is_known
        ]
        if len(strangers) > _MOST_STRANGERS:
            oldest = min(strangers, key=lambda connection: connection._made_at_s)
            oldest.transport.abort()
            self.connections.discard(oldest)  # its end comes later: it must not be counted, nor chosen again
        self._schedule_check()

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        self._next_check.cancel()
        super().connection_lost(exc)

    def _schedule_check(self) -> None:
        self._next_check = self.loop.call_later(PATIENCE_S, self._check, self.cycle)

    def _check(self, before: RequestResponseCycle | None) -> None:
        """Close the connection if no request has arrived since `before` and no answer is pending."""
        cycle = self.cycle
        answering = cycle is not None and not cycle.more_body and not cycle.response_complete
        if cycle is before and not answering:
            self.transport.abort()
        else:
            self._schedule_check()


class Server(uvicorn.Server):
    """A server that calls `on_end` when its shutdown begins, so that pending answers end soon.

    Attributes
    ----------
    ended_by : int or None
        The signal that ended it.
    """

    def __init__(self, config: uvicorn.Config, on_end: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_end = on_end
        self.ended_by: int | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End soon; see `uvicorn.Server`."""
        self.ended_by = sig
        super().handle_exit(sig, frame)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End; see `uvicorn.Server`."""
        self._on_end()
        await super().shutdown(sockets)


def server_of(app: ASGIApp, on_end: Callable[[], None] = lambda: None) -> Server:
    """Return a server for a page; ``serve(sockets=[...])`` runs it, and calls `on_end` when its shutdown begins."""
    return Server(
        uvicorn.Config(
            app,
            loop="asyncio",
            http=Connection,
            ws="none",
            lifespan="off",
            interface="asgi3",
            log_level="error",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            limit_concurrency=_MOST_CONNECTIONS,
            timeout_graceful_shutdown=_FAREWELL_S,
        ),
        on_end,
    )
