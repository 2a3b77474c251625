"""A store in a bucket: an S3 server as a process of its own."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import bucket_server
import pytest
from cli_support import invoke, ok
from doctor_support import free_port
from fleet_support import WHEELSOIL, contents, rows_of, running

from wheelsoil.fleet import open_store

_SECRETS = {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1"}


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An empty bucket's address."""
    import s3fs

    port = free_port()
    with running(sys.executable, bucket_server.__file__, port) as server:
        server.line_with("Running on")
        for name, value in (_SECRETS | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}"}).items():
            monkeypatch.setenv(name, value)
        s3fs.S3FileSystem.clear_instance_cache()
        s3fs.S3FileSystem().mkdir("field")
        yield "s3://field/fleet"
        s3fs.S3FileSystem.clear_instance_cache()


def test_a_bucket_holds_what_a_folder_does(fleet: Path, store: Path, bucket: str) -> None:
    with running(*WHEELSOIL, "fleet", "run", fleet, "--store", bucket, "--jobs", 1) as first:
        first.line_with("2/")
    again = invoke("fleet", "run", fleet, "--store", bucket, "--jobs", 1)
    assert again.code == 1 and "0 in the store" not in again.err  # one is broken
    assert contents(bucket) == contents(store)
    for name in ("runs", "samples", "evidence"):
        assert rows_of(bucket)[name].equals(rows_of(store)[name]), name
    assert ok("fleet", "compact", bucket).out == "8 campaigns put together; 1 pack in the store\n"
    assert "8 in the store already" in invoke("fleet", "run", fleet, "--store", bucket).err
    for name, table in rows_of(store).items():
        assert rows_of(bucket)[name].equals(table), name
    assert not open_store(bucket).older_than("done", -1.0) and not open_store(bucket).older_than("runs", -1.0)
    ok("fleet", "check", bucket)
    sql = "select campaign, verdict, sentence from diagnoses order by campaign"
    assert ok("fleet", "sql", bucket, sql, "--json").json == ok("fleet", "sql", store, sql, "--json").json


def test_a_bucket_that_is_not_there_or_not_ours_is_said(
    fleet: Path, bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = ("fleet", "run", fleet / "autumn", "--store")
    missing = invoke(*call, "s3://nowhere/fleet")
    assert missing.code == 2 and "the store cannot be" in missing.err and "does not exist" in missing.err
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:1")
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    away = invoke(*call, bucket)
    assert away.code == 2 and "the store cannot be reached" in away.err and "AWS_ENDPOINT_URL" in away.err


def _refuse(share: float, status: int = 503, method: str = "") -> None:
    with urlopen(f"{os.environ['AWS_ENDPOINT_URL']}/-/faults?share={share}&status={status}&method={method}"):
        pass


def test_requests_that_are_refused_change_no_row(fleet: Path, bucket: str, tmp_path: Path) -> None:
    for i in range(4):
        shutil.copytree(fleet / "bench", tmp_path / "field" / f"wheel-{i}")
    ok("fleet", "run", tmp_path / "field", "--store", tmp_path / "s", "--jobs", 1)
    call = ("fleet", "run", tmp_path / "field", "--store", bucket, "--jobs", 1)
    _refuse(0.05, 403, "PUT")
    denied = invoke(*call)
    assert denied.code == 2 and "the store cannot be" in denied.err and "Traceback" not in denied.err
    _refuse(0.1)
    ok(*call)
    _refuse(0.0)
    assert contents(bucket) == contents(tmp_path / "s")
    for name, table in rows_of(tmp_path / "s").items():
        assert rows_of(bucket)[name].equals(table), name
    store = open_store(bucket)
    named = {file.path for part in store.listing().parts for file in part.files.values()}
    named |= {"store.json", *(part.name for part in store.listing().parts)}
    assert {path.removeprefix(f"{store.root}/") for path in store.files.find(store.root)} == named
