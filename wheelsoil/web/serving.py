"""HTTP server of both pages, with limits on the number and duration of connections."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

PATIENCE_S = 10.0


class Connection(H11Protocol):
    """HTTP/1.1 that closes a connection without a complete request for `PATIENCE_S`, unless an answer is pending."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
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


_MOST_CONNECTIONS = 64
_FAREWELL_S = 1


class Server(uvicorn.Server):
    """A server that calls `on_end` when its shutdown begins, so that pending answers end soon."""

    def __init__(self, config: uvicorn.Config, on_end: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_end = on_end

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
