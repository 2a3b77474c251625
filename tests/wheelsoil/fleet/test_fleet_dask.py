"""A Dask scheduler and two workers, processes of their own: they are killed, and the store is that of one machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pyarrow as pa
import pytest
from cli_support import invoke, ok
from doctor_support import free_port
from fleet_support import WHEELSOIL, Program, contents, differing, rows_of, running

from wheelsoil.fleet import is_open_to_others

_ENV = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s"}


@contextmanager
def cluster(workers: int = 2, tls: Mapping[str, str] | None = None) -> Iterator[tuple[str, list[Program]]]:
    """A scheduler's address, and its workers."""
    address = f"{'tls' if tls else 'tcp'}://127.0.0.1:{free_port()}"
    env = _ENV | dict(tls or {})
    dask = (sys.executable, "-m", "dask")
    with ExitStack() as stack:
        scheduler = stack.enter_context(
            running(*dask, "scheduler", "--port", address.rpartition(":")[2], "--no-dashboard", env=env)
        )
        scheduler.line_with("Scheduler at")
        options = ("--nthreads", 1, "--no-dashboard", "--no-nanny")
        found = [stack.enter_context(running(*dask, "worker", address, *options, env=env)) for _ in range(workers)]
        for worker in found:
            worker.line_with("Registered to")
        yield address, found


@pytest.mark.slow
@pytest.mark.usefixtures("warm")
def test_a_scheduler_works_on_a_fleet(fleet: Path, whole: dict[str, pa.Table], tmp_path: Path) -> None:
    with cluster(1) as (address, _):
        call = ("fleet", "run", fleet / "bench", "--store", tmp_path / "s", "--engine", "dask", "--scheduler", address)
        assert "1/1 wheel: done" in ok(*call).err
    found = rows_of(tmp_path / "s")
    for name in ("diagnoses", "causes", "fits"):
        rows = [row for row in whole[name].to_pylist() if row["campaign"] == "bench/wheel"]
        expected = [{**row, "campaign": "wheel", "content": ""} for row in rows]
        assert [{**row, "content": ""} for row in found[name].to_pylist()] == expected, name


@pytest.mark.slow
@pytest.mark.usefixtures("warm")
def test_a_killed_worker_and_a_killed_client_change_no_row(
    fleet: Path, store: Path, whole: dict[str, pa.Table], tmp_path: Path
) -> None:
    with cluster() as (address, workers):
        call = ("fleet", "run", fleet, "--store", tmp_path / "s", "--engine", "dask", "--scheduler", address)
        with running(*WHEELSOIL, *call) as client:
            client.line_with("1/")
            os.kill(workers[0].process.pid, signal.SIGKILL)
            client.line_with("3/")
        before = contents(tmp_path / "s")
        assert len(before) >= 3
        again = invoke(*call)
        assert again.code == 1 and "in the store already" in again.err  # one is broken
        assert before.items() <= contents(tmp_path / "s").items()
    assert contents(tmp_path / "s") == contents(store)
    assert not differing(tmp_path / "s", whole)
    for name in whole:
        assert len(list((tmp_path / "s" / name).rglob("*.parquet"))) == len(list((store / name).rglob("*.parquet")))


def _certificates(folder: Path) -> dict[str, str]:
    """Return the configuration of Dask's three parts by a certificate that signs itself."""
    key, cert = folder / "key.pem", folder / "cert.pem"
    made = ("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2")
    subprocess.run(
        ["openssl", *made, "-subj", "/CN=fleet", "-keyout", key, "-out", cert], check=True, capture_output=True
    )
    place = "DASK_DISTRIBUTED__COMM__"
    found = {f"{place}REQUIRE_ENCRYPTION": "true", f"{place}TLS__CA_FILE": str(cert)}
    for part in ("SCHEDULER", "WORKER", "CLIENT"):
        found |= {f"{place}TLS__{part}__KEY": str(key), f"{place}TLS__{part}__CERT": str(cert)}
    return found


@pytest.mark.slow
def test_a_scheduler_by_tls_works_for_those_with_a_certificate(fleet: Path, store: Path, tmp_path: Path) -> None:
    for name in ("own", "other"):
        (tmp_path / name).mkdir()
    own, other = (_certificates(tmp_path / name) for name in ("own", "other"))
    with cluster(1, own) as (address, _):
        call = ("fleet", "run", fleet / "bench", "--store", tmp_path / "s", "--engine", "dask", "--scheduler")
        plain = address.replace("tls", "tcp")
        none: dict[str, str] = {}
        cases = [(none, address, 2), (own, plain, 2), (other, address, 4), (none, plain, 4)]
        for env, to, code in cases:
            with running(*WHEELSOIL, *call, to, env=_ENV | env) as refused:
                refused.line_with("there is no Dask scheduler" if code == 4 else "Dask's configuration does not fit")
                assert refused.process.wait(60) == code and "Traceback" not in "".join(refused.read)
        assert not contents(tmp_path / "s")
        with running(*WHEELSOIL, *call, address, env=_ENV | own) as client:
            client.line_with("1/1 wheel: done")
            assert client.process.wait(60) == 0
    assert rows_of(tmp_path / "s")["diagnoses"]["sentence"] == rows_of(store)["diagnoses"]["sentence"][3:4]


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


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        ("tcp://10.0.0.7:8786", True),
        ("node7:8786", True),
        ("ucx://node7:8786", True),
        ("tls://node7:8786", False),
        ("tcp://127.0.0.1:8786", False),
        ("tcp://[::1]:8786", False),
        ("tcp://localhost:8786", False),
        ("", False),
    ],
)
def test_a_scheduler_that_others_reach_is_known(address: str, warned: bool) -> None:
    assert is_open_to_others(address) == warned


def _listening(pids: list[int]) -> set[str]:
    """Return the addresses, in the system's notation, on which some processes listen."""
    inodes = set()
    for pid in pids:
        with suppress(OSError):
            for link in Path(f"/proc/{pid}/fd").iterdir():
                inodes.add(str(link.readlink()).removeprefix("socket:[").removesuffix("]"))
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return {row[1].partition(":")[0] for row in rows if row[3] == "0A" and row[9] in inodes}


@pytest.mark.slow
def test_a_cluster_of_this_machine_listens_on_loopback_only(fleet: Path, tmp_path: Path) -> None:
    call = ("fleet", "run", fleet / "bench", "--store", tmp_path / "s", "--engine", "dask", "--jobs", 1)
    (tmp_path / "s").mkdir(mode=0o777)
    (tmp_path / "s").chmod(0o777)
    with running(*WHEELSOIL, *call) as client:
        client.line_with("in the store already")
        found: set[str] = set()
        while client.process.poll() is None:
            pids = [int(place.name) for place in Path("/proc").glob("[0-9]*") if _group(place) == client.process.pid]
            found |= _listening(pids)
            time.sleep(0.1)
    assert found == {"0100007F"}  # 127.0.0.1
    assert any("anyone on this machine may write into the store" in line for line in client.read)


def _group(place: Path) -> int:
    try:
        return os.getpgid(int(place.name))
    except OSError:
        return 0
