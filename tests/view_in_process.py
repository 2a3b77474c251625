"""The analyst's page, served by a thread of this process: its helpers are forked from one that has imported all."""

from __future__ import annotations

import asyncio
import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from view_client import PATIENCE_S, View

from wheelsoil.console import printable_addresses
from wheelsoil.view import analysis_session, helper
from wheelsoil.view.analysis_session import AnalysisSession
from wheelsoil.view.server import _print_addresses, listening_on, make_app
from wheelsoil.web.listening import checked_token, page_addresses
from wheelsoil.web.serving import Rules, server_of
from wheelsoil.workflows import Files

Instead = Mapping[Callable[..., Any], Callable[..., Any]]
_IMPORTED = [
    "wheelsoil.view.jobs",
    "wheelsoil.wording.model_notes",
    "model.diagnosis.time_series.diagnosis",
    "processing.pipeline.pipeline",
    "cantools",
    "platformdirs",
    "scipy.ndimage",
    "zstandard",
]
"""What a helper imports in the end."""
_FORKING = multiprocessing.get_context("forkserver")
_FORKING.set_forkserver_preload(_IMPORTED)


class ForkedHelper(helper.Helper):
    """A helper whose process needs a moment to start, and does `instead` of some jobs others."""

    _lock_of_module = threading.Lock()

    def __init__(self, name: str, instead: Instead) -> None:
        self._instead = instead
        super().__init__(name)

    def ask(self, function: Callable[..., Any], *args: Any, **more: Any) -> Future[Any]:
        """See `Helper.ask`."""
        return super().ask(self._instead.get(function, function), *args, **more)

    def _started(self) -> Connection:
        forking = SimpleNamespace(get_context=lambda _: _FORKING)
        with self._lock_of_module, patch.object(helper, "multiprocessing", forking):
            return super()._started()


@dataclass
class ViewInProcess(View):
    """A page of this process."""

    session: AnalysisSession

    def helpers(self) -> list[int]:
        """The processes that work for it."""
        running = (one._process for one in (self.session._quick, self.session._slow))
        return [process.pid for process in running if process is not None and process.pid is not None]


@contextmanager
def viewing_here(
    *paths: Path,
    host: str = "127.0.0.1",
    port: int = 0,
    token: str | None = None,
    instead: Instead | None = None,
    **files: Any,
) -> Iterator[ViewInProcess]:
    """What ``wheelsoil view`` serves; `files` are fields of `Files`, `instead` see `ForkedHelper`."""
    said: list[str] = []
    with listening_on(host, port) as listening:
        bound = listening.getsockname()[0]
        asked = checked_token(token, bound)
        addresses = printable_addresses(page_addresses(listening, asked), token)
        with patch.object(analysis_session, "Helper", partial(ForkedHelper, instead=instead or {})):
            session = AnalysisSession(paths, Files(**files))
        _print_addresses(session.remarks, addresses, said.append)
        server = server_of(make_app(session, Rules.of(host, bound, asked)), session.close)
        thread = threading.Thread(target=lambda: asyncio.run(server.serve(sockets=[listening])))
        thread.start()
        try:
            _until(lambda: server.started or not thread.is_alive())
            yield ViewInProcess(addresses[0], said, session)
        finally:
            server.should_exit = True
            thread.join(PATIENCE_S)
            session.close()
    assert not thread.is_alive()


def _until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)
