"""How many cores work: one thread for each piece of linear algebra, several processes for pieces that are independent.

Matrices here have a few hundred rows: threads that wait for each other are slower than one, on a busy machine by far.
Fits of sets of causes, held-out runs and the processing of runs do not need each other: `in_parallel` gives them to
processes. The numbers do not depend on how many there are.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from daq import Fault, WheelsoilError

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_count: ContextVar[int] = ContextVar("processes", default=1)
_task: Callable[[int], Any]


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


@contextmanager
def processes(count: int) -> Iterator[None]:
    """Let `in_parallel` use so many processes; without this it uses none but its own."""
    token = _count.set(count)
    try:
        yield
    finally:
        _count.reset(token)


def in_parallel(function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Yield what a function returns of each item, in their order, from as many processes as `processes` allows.

    A process is a copy of this one, so that the function may be a closure over large data; what it returns is pickled.
    Where a system cannot safely copy a process (all but Linux), and within such a process, it is called here.

    Raises
    ------
    WheelsoilError
        A process has ended, as the system does when memory is short.
    Exception
        What the function raises, at the first item that does.
    """
    listed = list(items)
    count = min(_count.get(), len(listed))
    if count < 2 or sys.platform != "linux":
        return map(function, listed)
    return _in_processes(function, listed, count)


def _in_processes(function: Callable[[T], R], items: Sequence[T], count: int) -> Iterator[R]:
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(count, context, initializer=_begin, initargs=(lambda index: function(items[index]),))
    try:
        with warnings.catch_warnings():  # Python 3.12 warns where there are threads; ours hold no lock here
            warnings.simplefilter("ignore", DeprecationWarning)
            found = pool.map(_call, range(len(items)))
        yield from found
    except BrokenProcessPool:
        raise WheelsoilError(
            Fault(
                "a process that worked on a part of this ended, as the system does when memory is short",
                next_step="give --jobs 1, or close other programs",
            )
        ) from None
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(task: Callable[[int], Any]) -> None:
    """Prepare a process: it ends with Ctrl-C without a word, and when its parent ends."""
    global _task
    _task = task
    _count.set(1)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(index: int) -> Any:
    return _task(index)
