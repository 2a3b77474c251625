"""How many cores work: one thread for each piece of linear algebra, several processes for pieces that are independent.

Matrices here have a few hundred rows: threads that wait for each other are slower than one, on a busy machine by far.
Fits of sets of causes, held-out runs and the processing of runs do not need each other: `in_parallel` gives them to
processes. The numbers do not depend on how many there are.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from multiprocessing.connection import Connection
from typing import Any, ParamSpec, TypeVar

from daq import Fault, WheelsoilError

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

LEAST_ROWS = 4000
"""Of fewer, a copy of this process costs more than it takes off, 0.05 s: 12 runs of 40 s have about so many."""
_count: ContextVar[int] = ContextVar("processes", default=1)


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Have a function's linear algebra done in one thread; the caller's setting is restored."""

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return wrapped


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def can_copy_processes() -> bool:
    """Whether work can be given to copies of this process: only Linux copies one safely."""
    return sys.platform == "linux" and "fork" in multiprocessing.get_all_start_methods()


@contextmanager
def processes(count: int) -> Iterator[None]:
    """Let `in_parallel` use so many processes; without this it uses none but its own."""
    token = _count.set(count)
    try:
        yield
    finally:
        _count.reset(token)


def in_parallel(function: Callable[[T], R], items: Iterable[T], *, rows: int | None = None) -> Iterator[R]:
    """Yield what a function returns of each item, in their order, from as many processes as `processes` allows.

    This process is one of them; another is a copy of it, so that the function may be a closure over large data, and
    what it returns there is pickled. Where a system cannot safely copy a process (all but Linux), and within such a
    process, all is done here.

    Parameters
    ----------
    rows : int, optional
        Numbers that the items work on: of fewer than `LEAST_ROWS` all is done here.

    Raises
    ------
    WheelsoilError
        A process has ended, as the system does when memory is short.
    Exception
        What the function raises, at the first item that does.
    """
    listed = list(items)
    count = _copies(len(listed), rows)
    if count < 2:
        return map(function, listed)
    return _in_processes(function, listed, count)


Ask = Callable[..., list[Any]]
"""Calls a method, by its name and arguments, of each of several objects."""


@contextmanager
def spread(objects: Sequence[Any], *, rows: int | None = None) -> Iterator[Ask]:
    """Spread objects over as many processes as `processes` allows, and yield what calls a method of each of them.

    What an object keeps from one call to the next stays in its process. Results come in the order of the objects.
    `rows` is as of `in_parallel`. Errors are those of `in_parallel`, as of exceptions.
    """
    count = _copies(len(objects), rows)
    with _helpers([objects[i::count] for i in range(1, count)]) as lines:

        def ask(method: str, *args: Any) -> list[Any]:
            try:
                for line in lines:
                    line.send((method, args))
                answers = [_answer(objects[::count], method, args), *(line.recv() for line in lines)]
            except (EOFError, ConnectionError):
                raise _ended() from None
            found: list[Any] = [None] * len(objects)
            for i, answer in enumerate(answers):
                if isinstance(answer, Exception):
                    raise answer
                found[i::count] = answer
            return found

        yield ask


def _copies(items: int, rows: int | None) -> int:
    """Return how many processes, this one too, do so many items."""
    worth = can_copy_processes() and (rows is None or rows >= LEAST_ROWS)
    return max(min(_count.get(), items), 1) if worth else 1


@contextmanager
def _helpers(shares: Sequence[Sequence[Any]]) -> Iterator[list[Connection]]:
    """Start a process for each share of some objects, and yield the lines to them; they end with the context."""
    lines, helpers = [], []
    try:
        for share in shares:
            context = multiprocessing.get_context("fork")
            line, far = context.Pipe()
            helper = context.Process(target=_serve, args=(far, share), daemon=True)
            with _without_fork_warning():
                helper.start()
            far.close()
            lines.append(line)
            helpers.append(helper)
        yield lines
    finally:
        for helper in helpers:
            helper.terminate()
            helper.join()


def _serve(line: Connection, objects: Sequence[Any]) -> None:
    """Call methods of objects until nobody asks any more."""
    _begin()
    with contextlib.suppress(EOFError):
        while True:
            line.send(_answer(objects, *line.recv()))


def _answer(objects: Sequence[Any], method: str, args: tuple[Any, ...]) -> list[Any] | Exception:
    """Return what a method of each object returns, or what it raises."""
    try:
        return [getattr(obj, method)(*args) for obj in objects]
    except Exception as error:  # noqa: BLE001 - it is raised where the method was asked for
        return error


@contextmanager
def _without_fork_warning() -> Iterator[None]:
    with warnings.catch_warnings():  # Python 3.12 warns where there are threads; ours hold no lock here
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def _ended() -> WheelsoilError:
    return WheelsoilError(
        Fault(
            "a process that worked on a part of this ended, as the system does when memory is short",
            next_step="give --jobs 1, or close other programs",
        )
    )


def _in_processes(function: Callable[[T], R], items: Sequence[T], count: int) -> Iterator[R]:
    """Have each process, this one too, do one item after the other."""
    found: list[Future[list[R] | Exception]] = [Future() for _ in items]
    waiting = iter(range(len(items)))
    tasks = [lambda index: function(items[index])]

    def have_done(line: Connection) -> None:
        for i in waiting:
            try:
                line.send(("__call__", (i,)))
                found[i].set_result(line.recv())
            except Exception as error:  # noqa: BLE001 - it is raised where the result was asked for
                found[i].set_result(_ended() if isinstance(error, EOFError | OSError) else error)

    with _helpers([tasks] * (count - 1)) as lines:
        for line in lines:
            threading.Thread(target=have_done, args=(line,), daemon=True).start()
        for future in found:
            while not future.done() and (i := next(waiting, None)) is not None:
                with processes(1):
                    found[i].set_result(_answer(tasks, "__call__", (i,)))
            answer = future.result()
            if isinstance(answer, Exception):
                raise answer
            yield answer[0]


def _begin() -> None:
    """Prepare a process: it ends with Ctrl-C without a word, and when its parent ends."""
    _count.set(1)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
