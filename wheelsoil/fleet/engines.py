"""What campaigns are worked on with: processes of this machine, or the workers of a Dask scheduler.

An engine yields what becomes of each item, in the order in which they end. A worker that is lost costs what it was
working on; that is tried again, and given up when it has taken several workers with it.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from ipaddress import ip_address
from itertools import islice
from typing import Any, TypeVar

from daq import ConfigError, HardwareError, limit_memory, not_installed
from wheelsoil import __version__

S = TypeVar("S")
T = TypeVar("T")

_TRIES = 3
_ITEMS_OF_A_WORKER = 50
"""After which a local worker is replaced, so that what it may have hoarded is free again."""
_AHEAD = 3
"""Items that wait for each local worker: enough that none idles."""
_AHEAD_ON_DASK = 10_000
_CONNECT_S = 5.0


@dataclass(frozen=True)
class Lost:
    """An item that took every worker with it that tried it."""

    why: str


def in_processes(
    task: Callable[[S], T], items: Sequence[S], jobs: int, memory_bytes: int
) -> Iterator[tuple[S, T | Lost]]:
    """Work in `jobs` processes of this machine, each with at most `memory_bytes` (0: all).

    The task, its items and what it returns are pickled.
    """
    tries = dict.fromkeys(range(len(items)), 0)
    while tries:
        suspects: list[int] = []
        alone = any(tries.values())  # the next loss then has one cause
        waiting = sorted(tries, key=lambda i: -tries[i])
        for i, result in _pooled(task, items, waiting, 1 if alone else jobs, memory_bytes, suspects):
            del tries[i]
            yield items[i], result
            if alone and not any(tries.values()):
                break  # with all processes again
        for i in suspects:
            tries[i] += 1
            if tries[i] == _TRIES:
                del tries[i]
                yield items[i], Lost("the process that worked on it ended, as the system does when memory is short")


def _pooled(
    task: Callable[[S], T], items: Sequence[S], waiting: Sequence[int], jobs: int, memory_bytes: int, lost: list[int]
) -> Iterator[tuple[int, T]]:
    """Yield what ends well; when a process ends, `lost` takes what may have been worked on."""
    context = multiprocessing.get_context("spawn")
    todo = iter(waiting)
    running: dict[Future[T], int] = {}
    with ProcessPoolExecutor(
        jobs, context, initializer=_begin, initargs=(memory_bytes,), max_tasks_per_child=_ITEMS_OF_A_WORKER
    ) as pool:
        try:
            while True:
                for i in islice(todo, jobs * _AHEAD - len(running)):
                    running[pool.submit(task, items[i])] = i
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    yield running.pop(future), result
        except BrokenProcessPool:
            lost += list(running.values())[:jobs]  # the executor begins them in their order
        except BaseException:
            for process in multiprocessing.active_children():
                process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin(memory_bytes: int) -> None:
    """Limit this process's memory, and let it end with the one that started it: killed, that closes no queue."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if memory_bytes:
        limit_memory(memory_bytes)


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def on_dask(
    task: Callable[[S], T], items: Sequence[S], keys: Sequence[str], scheduler: str, jobs: int, memory_bytes: int
) -> Iterator[tuple[S, T | Lost]]:
    """Work on the workers of a Dask scheduler.

    Without an address that is a cluster of this machine, of `jobs` processes with `memory_bytes` each. The keys are
    what the scheduler calls the items: one that it works on already is not begun again. `ConfigError` where
    dask.distributed is not installed, or a worker has another version of wheelsoil, or none; `HardwareError` where
    there is no scheduler at the address, or it has no workers.
    """
    try:
        import distributed
    except ImportError:
        raise not_installed("clusters", "dask.distributed", scheduler, "dask") from None
    logging.getLogger("distributed").setLevel(logging.ERROR)
    with ExitStack() as stack:
        if not scheduler:
            limit = memory_bytes or "auto"
            cluster = distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, memory_limit=limit, dashboard_address="127.0.0.1:0"
            )
            scheduler = stack.enter_context(cluster).scheduler_address
        client = stack.enter_context(_connected(scheduler))
        for start in range(0, len(items), _AHEAD_ON_DASK):
            some = range(start, min(start + _AHEAD_ON_DASK, len(items)))
            futures = {client.submit(task, items[i], key=keys[i]): i for i in some}
            for future in distributed.as_completed(list(futures)):
                i = futures.pop(future)
                if isinstance(future.exception(), distributed.KilledWorker):
                    yield items[i], Lost("every worker that worked on it was lost")
                else:
                    yield items[i], future.result()
                future.release()


def is_open_to_others(scheduler: str) -> bool:
    """Return whether a scheduler's address is of another machine and not encrypted: it knows no login, either."""
    kind, _, place = scheduler.rpartition("://")
    host = place.rpartition(":")[0].strip("[]") or place
    try:
        loopback = ip_address(host).is_loopback
    except ValueError:
        loopback = host in ("localhost", "")
    return bool(scheduler) and kind not in ("tls", "wss") and not loopback


def _connected(scheduler: str) -> Any:
    """Return a client of a scheduler whose workers have this version."""
    import distributed

    try:
        client: Any = distributed.Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        step = "start one (`dask scheduler`) or check the address; --engine local needs none"
        raise HardwareError.of("there is no Dask scheduler", scheduler, str(error), "tcp://HOST:8786", step) from None
    except (TypeError, RuntimeError) as error:  # of a configuration without certificates, or that refuses tcp://
        step = "state ca-file, key and cert of the client under distributed.comm.tls in Dask's configuration"
        what = "Dask's configuration does not fit the scheduler's address"
        raise ConfigError.of(what, scheduler, str(error), next_step=step) from None
    try:
        client.wait_for_workers(1, timeout=_CONNECT_S)
        versions = client.run(version)
    except TimeoutError:
        client.close()
        step = f"start some: `dask worker {scheduler} --nthreads 1`"
        raise HardwareError.of("the Dask scheduler has no workers", scheduler, next_step=step) from None
    except Exception as error:  # noqa: BLE001  # whatever its import raised there
        client.close()
        step = "install this version of wheelsoil where the workers run"
        raise ConfigError.of("a worker cannot run wheelsoil", scheduler, str(error), __version__, step) from None
    others = {address: found for address, found in versions.items() if found != __version__}
    if others:
        client.close()
        found = ", ".join(f"{found} at {address}" for address, found in others.items())
        step = "install the same version everywhere: rows of two versions cannot be compared"
        raise ConfigError.of("a worker has another version of wheelsoil", scheduler, found, __version__, step)
    return client


def version() -> str:
    """Return the version of wheelsoil that a worker runs."""
    return __version__
