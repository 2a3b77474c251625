"""A connection of a browser, which has to say in good time what it wants: there is room for few."""

from __future__ import annotations

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

PATIENCE_S = 10.0


class Connection(H11Protocol):
    """HTTP/1.1 that closes a connection without a complete request for `PATIENCE_S`, unless it owes an answer."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        self._look_later()

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        self._next_look.cancel()
        super().connection_lost(exc)

    def _look_later(self) -> None:
        self._next_look = self.loop.call_later(PATIENCE_S, self._look, self.cycle)

    def _look(self, before: RequestResponseCycle | None) -> None:
        """Close it if it is where it was, and no whole request waits for the end of its answer."""
        cycle = self.cycle
        answering = cycle is not None and not cycle.more_body and not cycle.response_complete
        if cycle is before and not answering:
            self.transport.abort()
        else:
            self._look_later()
