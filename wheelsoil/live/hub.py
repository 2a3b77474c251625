"""The last snapshot and the curves of the last minute, streamed to every connected browser."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from typing import Any

from wheelsoil.live.slip import SPAN_S, LiveSlip

MOST_STREAMS = 12
KEEP_ALIVE_S = 1.0
_KEEP_ALIVE = b": alive\n\n"


class Hub:
    """Distribution of the snapshots to the browsers.

    A browser is sent the newest snapshot as soon as it has received the previous one, with all samples of the curves
    since then. A slow browser receives fewer snapshots and complete curves, and does not delay the others.

    Parameters
    ----------
    vehicle : str
        Name to show before the first snapshot.
    """

    def __init__(self, vehicle: str) -> None:
        self.streams = 0
        self._hello = _event("hello", {"vehicle": vehicle})
        self._live = LiveSlip()
        self._snapshot: dict[str, Any] | None = None
        self._taken_s = 0.0
        self._number = 0
        self._ended = False
        self._news = asyncio.Condition()

    async def take(self, snapshot: dict[str, Any]) -> None:
        """Store the newest snapshot of the logger and notify the streams."""
        self._live.take(snapshot)
        self._snapshot = {key: value for key, value in snapshot.items() if key != "traces"}
        self._taken_s = time.monotonic()
        self._number += 1
        await self._notify()

    async def end(self) -> None:
        """End the streams with the event that the logger has ended."""
        self._ended = True
        await self._notify()

    async def stream(self) -> AsyncIterator[bytes]:
        """Yield server-sent events: ``hello``, ``snapshot``, ``ended``, and a comment each second without either."""
        self.streams += 1
        try:
            number, sent_s = 0, (-float("inf"), -float("inf"))
            yield self._hello
            while not self._ended:
                if self._number == number and not await self._wait(number):
                    yield _KEEP_ALIVE
                    continue
                if self._number != number and self._snapshot is not None:
                    number, message = self._number, self._message(sent_s)
                    sent_s = (self._live.pull.end_s, self._live.slip.end_s)
                    yield message
            yield _event("ended", {})
        finally:
            self.streams -= 1

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    async def _wait(self, number: int) -> bool:
        """Return whether there is a new snapshot, or the end, within `KEEP_ALIVE_S`."""
        try:
            async with asyncio.timeout(KEEP_ALIVE_S), self._news:
                await self._news.wait_for(lambda: self._number != number or self._ended)
        except TimeoutError:
            return False
        return True

    def _message(self, sent_s: tuple[float, float]) -> bytes:
        pull, slip = self._live.pull.since(sent_s[0]), self._live.slip.since(sent_s[1])
        body = {
            "snapshot": self._snapshot,
            "age_s": round(time.monotonic() - self._taken_s, 3),
            "curves": {"fresh": sent_s[0] == sent_s[1] == -float("inf"), "span_s": SPAN_S, "pull": pull, "slip": slip},
        }
        return _event("snapshot", body)


def _event(name: str, body: dict[str, Any]) -> bytes:
    return f"event: {name}\ndata: {json.dumps(body, separators=(',', ':'))}\n\n".encode()
