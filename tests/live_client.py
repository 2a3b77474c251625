"""A plain HTTP client of the status page, and waiting for what another process does."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPResponse
from typing import Any, TypeVar

from wheelsoil.live import PagePanel
from wheelsoil.live.panel import RESTART_S

T = TypeVar("T")
PATIENCE_S = 30.0


@contextmanager
def page(host: str = "127.0.0.1", token: str | None = None, restart_s: float = 0.0) -> Iterator[PagePanel]:
    """A page on a free port."""
    panel = PagePanel(host, 0, token, "a tractor", restart_s or RESTART_S)
    try:
        yield panel
    finally:
        panel.close()


def until(holds: Callable[[], T], what: str) -> T:
    """Wait until something holds and return it."""
    end = time.monotonic() + PATIENCE_S
    while not (found := holds()):
        assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what}"
        time.sleep(0.02)
    return found


def connect(panel: PagePanel) -> HTTPConnection:
    """A connection to the page."""
    return HTTPConnection("127.0.0.1", panel.port, timeout=PATIENCE_S)


def ask(
    panel: PagePanel, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
) -> HTTPResponse:
    """A request whose answer has been read; ``.status`` and ``.headers`` stay."""
    connection = connect(panel)
    connection.request(method, path, body, headers or {})
    answer = connection.getresponse()
    answer.text = answer.read().decode()  # type: ignore[attr-defined]
    connection.close()
    return answer


def command(panel: PagePanel, value: object, **headers: str) -> int:
    """The status of a POST as the page's own script would make it, with some headers changed (``_`` for ``-``)."""
    usual = {"Origin": f"http://127.0.0.1:{panel.port}", "Content-Type": "application/json"}
    if panel.token:
        usual["Authorization"] = f"Bearer {panel.token}"
    changed = {name.replace("_", "-"): text for name, text in headers.items()}
    body = value if isinstance(value, bytes) else json.dumps(value).encode()
    return ask(panel, "POST", "/command", body, {k: v for k, v in (usual | changed).items() if v}).status


@contextmanager
def events(panel: PagePanel) -> Iterator[Iterator[tuple[str, Any]]]:
    """The page's stream of (event, data), comments as ("", None)."""
    connection = connect(panel)
    connection.request("GET", "/events", headers={"Authorization": f"Bearer {panel.token}"} if panel.token else {})
    answer = connection.getresponse()
    assert answer.status == 200
    try:
        yield _events(answer)
    finally:
        answer.close()
        connection.close()


def next_event(stream: Iterator[tuple[str, Any]], name: str) -> Any:
    """The data of the next event of a name."""
    return next(data for event, data in stream if event == name)


def _events(answer: HTTPResponse) -> Iterator[tuple[str, Any]]:
    block: list[str] = []
    while line := answer.readline().decode():
        if line != "\n":
            block.append(line.rstrip("\n"))
            continue
        fields = dict(each.split(": ", 1) for each in block)
        yield fields.get("event", ""), json.loads(fields["data"]) if "data" in fields else None
        block = []
