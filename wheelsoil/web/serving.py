"""How both pages are served."""

from __future__ import annotations

import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp

from wheelsoil.web.connection import Connection

_MOST_CONNECTIONS = 64
_FAREWELL_S = 1


class Server(uvicorn.Server):
    """A server that says when it begins to end, so that nobody's answer takes long any more."""

    def __init__(self, config: uvicorn.Config, on_end: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_end = on_end

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End; see `uvicorn.Server`."""
        self._on_end()
        await super().shutdown(sockets)


def server_of(app: ASGIApp, on_end: Callable[[], None] = lambda: None) -> Server:
    """Return a server for a page; ``serve(sockets=[...])`` runs it, and calls `on_end` when it is told to end."""
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
