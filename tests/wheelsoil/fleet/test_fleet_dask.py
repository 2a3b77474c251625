"""A Dask scheduler and two workers, processes of their own: they are killed, and the store is that of one machine."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from cli_support import invoke
from doctor_support import free_port
from fleet_support import WHEELSOIL, Program, contents, rows_of, running, small_fleet

_ENV = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s"}


@contextmanager
def cluster(workers: int = 2) -> Iterator[tuple[str, list[Program]]]:
    """A scheduler's address, and its workers."""
    address = f"tcp://127.0.0.1:{free_port()}"
    dask = (sys.executable, "-m", "dask")
    with ExitStack() as stack:
        scheduler = stack.enter_context(
            running(*dask, "scheduler", "--port", address.rpartition(":")[2], "--no-dashboard", env=_ENV)
        )
        scheduler.line_with("Scheduler at")
        options = ("--nthreads", 1, "--no-dashboard", "--no-nanny")
        found = [stack.enter_context(running(*dask, "worker", address, *options, env=_ENV)) for _ in range(workers)]
        for worker in found:
            worker.line_with("Registered to")
        yield address, found


def _survives(fleet: Path, whole: Path, folder: Path) -> None:
    """Kill a worker in the middle, then the client, and take it up again: the rows are those of `whole`."""
    with cluster() as (address, workers):
        call = ("fleet", "run", fleet, "--store", folder / "s", "--engine", "dask", "--scheduler", address)
        with running(*WHEELSOIL, *call) as client:
            client.line_with("1/")
            os.kill(workers[0].process.pid, signal.SIGKILL)
            client.line_with("3/")
        before = contents(folder / "s")
        assert len(before) >= 3
        again = invoke(*call)
        assert again.code == 1 and "in the store already" in again.err  # one is broken
        assert before.items() <= contents(folder / "s").items()
    assert contents(folder / "s") == contents(whole)
    for name, table in rows_of(whole).items():
        assert rows_of(folder / "s")[name].equals(table), name
        assert len(list((folder / "s" / name).rglob("*.parquet"))) == len(list((whole / name).rglob("*.parquet")))


def test_a_killed_worker_and_a_killed_client_change_no_row(fleet: Path, store: Path, tmp_path: Path) -> None:
    _survives(fleet, store, tmp_path)


@pytest.mark.slow
def test_twelve_campaigns_survive_too(tmp_path: Path) -> None:
    fleet = small_fleet(tmp_path / "field", 12)
    assert invoke("fleet", "run", fleet, "--store", tmp_path / "whole").code == 1
    _survives(fleet, tmp_path / "whole", tmp_path)


@pytest.mark.slow
def test_no_scheduler_no_workers_and_another_version_are_said(fleet: Path, tmp_path: Path) -> None:
    def said(address: str) -> tuple[int, str]:
        result = invoke(
            *("fleet", "run", fleet / "autumn", "--store", tmp_path / "s", "--engine", "dask", "--scheduler", address)
        )
        return result.code, result.err

    code, err = said("tcp://127.0.0.1:1")
    assert code == 4 and "there is no Dask scheduler" in err
    with cluster(0) as (address, _):
        code, err = said(address)
        assert code == 4 and "has no workers" in err
        start = "from distributed.cli.dask_worker import main; main()"
        other = f"import wheelsoil; wheelsoil.__version__ = '0.0.9'; {start}"
        with running(sys.executable, "-c", other, address, "--nthreads", 1, "--no-dashboard", "--no-nanny") as worker:
            worker.line_with("Registered to")
            code, err = said(address)
        assert code == 2 and "another version of wheelsoil" in err and "0.0.9" in err
    assert not contents(tmp_path / "s")
