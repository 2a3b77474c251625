"""A helper process that executes long jobs one after another, so that they do not block the page."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from itertools import count
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import PriorityQueue
from typing import Any

from daq import Fault, HardwareError, WheelsoilError
from model import watched

_NICENESS = 5
Watch = Callable[[float], None]
Job = tuple[Callable[..., Any], tuple[Any, ...], Watch | None]


class HelperEndedError(HardwareError):
    """The process ended before it answered."""


class Helper:
    """One process with a queue of jobs; it is started when first needed, and again after it ended."""

    def __init__(self, name: str) -> None:
        self._line: PriorityQueue[tuple[int, int, Future[Any], Job | None]] = PriorityQueue()
        self._number = count()
        self._lock = threading.Lock()
        self._closed = self._dropped = False
        self._current: Future[Any] | None = None
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._thread = threading.Thread(target=self._hand_over, name=name, daemon=True)
        self._thread.start()

    def ask(
        self, function: Callable[..., Any], *args: Any, urgent: bool = False, watch: Watch | None = None
    ) -> Future[Any]:
        """Return the future result of ``function(*args)`` in the process; all three are pickled.

        An urgent job precedes all jobs that are not, but does not interrupt one. `watch` is called with the share that
        is done; see `model.watched`.
        """
        future: Future[Any] = Future()
        with self._lock:
            if not self._closed:
                self._line.put((0 if urgent else 1, next(self._number), future, (function, args, watch)))
                return future
        future.set_exception(_ended())
        return future

    def drop(self, future: Future[Any]) -> None:
        """Cancel a job; if it is running, end its process: `HelperEndedError`. Other jobs are not affected."""
        if future.cancel():
            return
        with self._lock:
            if self._current is future:
                self._dropped = True
                if self._process is not None:
                    self._process.kill()

    def close(self) -> None:
        """End the process finally: running, waiting and later jobs raise `HelperEndedError`."""
        with self._lock:
            self._closed = True
            self._line.put((-1, next(self._number), Future(), None))
            current = self._current
        if current is not None:
            self.drop(current)
        self._thread.join()

    def _hand_over(self) -> None:
        while True:
            _, _, future, job = self._line.get()
            if job is None:
                break
            if not future.set_running_or_notify_cancel():
                continue
            with self._lock:
                self._current, closed = future, self._closed
            if closed:
                future.set_exception(_ended())
                break
            try:
                future.set_result(self._done(*job))
            except Exception as error:  # noqa: BLE001  # the caller gets every error
                future.set_exception(error)
            with self._lock:
                self._current, dropped, self._dropped = None, self._dropped, False
            if dropped:
                self._forget()
        self._forget()
        while not self._line.empty():
            future = self._line.get()[2]
            if future.set_running_or_notify_cancel():
                future.set_exception(_ended())

    def _done(self, function: Callable[..., Any], args: tuple[Any, ...], watch: Watch | None) -> Any:
        try:
            pipe = self._started()
            pipe.send((function, args))
            while (answer := pipe.recv())[0] == "share":
                if watch:
                    watch(answer[1])
            kind, value = answer
        except (EOFError, OSError):
            self._forget()
            raise _ended() from None
        if kind == "faults":
            error, faults = value
            raise error(*faults)
        if kind == "broken":
            raise RuntimeError(value)
        return value

    def _started(self) -> Connection:
        if self._pipe is not None:
            return self._pipe
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        with self._lock:
            self._process, self._pipe = process, ours
            if self._dropped:
                process.kill()
        return ours

    def _forget(self) -> None:
        with self._lock:
            process, self._process = self._process, None
            pipe, self._pipe = self._pipe, None
        if process is not None and pipe is not None:
            process.kill()
            process.join()
            pipe.close()


def _ended() -> HelperEndedError:
    what, step = "the helper process of the page ended", "try again; close programs if memory is short"
    return HelperEndedError.of(what, next_step=step)


def serve(pipe: Connection) -> None:
    """Execute the jobs that come through the pipe until it is closed; the main function of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page handles Ctrl-C
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(OSError, AttributeError):  # Windows has no such call
        os.nice(_NICENESS)
    while True:
        try:
            function, args = pipe.recv()
        except EOFError:
            return
        with watched(lambda share: pipe.send(("share", share))):
            outcome = _outcome(function, args)
        pipe.send_bytes(outcome)


def _outcome(function: Callable[..., Any], args: tuple[Any, ...]) -> bytes:
    try:
        return pickle.dumps(("done", function(*args)), pickle.HIGHEST_PROTOCOL)
    except WheelsoilError as error:
        return pickle.dumps(("faults", (type(error), error.faults)))
    except OSError as error:
        fault = Fault(error.strerror or str(error), str(error.filename or ""))
        return pickle.dumps(("faults", (HardwareError, (fault,))))
    except Exception:  # noqa: BLE001  # the page reports it as a fault of the program
        return pickle.dumps(("broken", traceback.format_exc()))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
