"""How both pages are served."""

from __future__ import annotations

import uvicorn
from starlette.types import ASGIApp

from wheelsoil.web.connection import Connection

_MOST_CONNECTIONS = 64
_FAREWELL_S = 1


def server_of(app: ASGIApp) -> uvicorn.Server:
    """Return a server for a page; ``serve(sockets=[...])`` runs it."""
    return uvicorn.Server(
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
        )
    )
