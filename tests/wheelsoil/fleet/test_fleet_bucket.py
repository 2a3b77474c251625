"""A store in a bucket: an S3 server as a process of its own."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from urllib.request import urlopen

import bucket_server
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from cli_support import invoke, ok
from doctor_support import free_port
from fleet_support import contents, differing, killed_at, rows_of, running

from wheelsoil.fleet import Shard, open_store, plan_fleet

_SECRETS = {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1"}


_numbers = count()


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """Return the server's address."""
    port = free_port()
    with running(sys.executable, bucket_server.__file__, port) as program:
        program.line_with("Running on")
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def bucket(server: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An empty bucket's address."""
    import s3fs

    for name, value in (_SECRETS | {"AWS_ENDPOINT_URL": server}).items():
        monkeypatch.setenv(name, value)
    name = f"field-{next(_numbers)}"
    s3fs.S3FileSystem.clear_instance_cache()
    s3fs.S3FileSystem().mkdir(name)
    yield f"s3://{name}/fleet"
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.mark.slow
@pytest.mark.usefixtures("warm")
def test_a_bucket_holds_what_a_folder_does(fleet: Path, store: Path, whole: dict[str, pa.Table], bucket: str) -> None:
    call = ("fleet", "run", fleet, "--store", bucket, "--shard", "1/3")
    names = {source.name for source in plan_fleet([fleet], str(store), shard=Shard(1, 3)).found}
    assert len(names) == 3 and "broken" in names
    expected = {name: table.filter(pc.field("campaign").isin(names)) for name, table in whole.items()}
    killed_at(20, *call)
    assert 1 <= len(contents(bucket)) < 3
    again = invoke(*call, "--jobs", 1)
    assert again.code == 1 and "0 in the store" not in again.err
    assert contents(bucket) == {name: content for name, content in contents(store).items() if name in names}
    assert not differing(bucket, {name: expected[name] for name in ("runs", "samples", "evidence")})
    assert ok("fleet", "compact", bucket).out == "3 campaigns put together; 1 pack in the store\n"
    assert "3 in the store already" in invoke(*call).err
    assert not differing(bucket, expected)
    assert not open_store(bucket).older_than("done", -1.0) and not open_store(bucket).older_than("runs", -1.0)
    ok("fleet", "check", bucket)
    sql = "select campaign, verdict, sentence from diagnoses order by campaign"
    answer = ok("fleet", "sql", store, sql, "--json").json
    assert ok("fleet", "sql", bucket, sql, "--json").json == [row for row in answer if row["campaign"] in names]


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


@pytest.mark.slow
@pytest.mark.usefixtures("warm", "one_process")
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
    assert not differing(bucket, rows_of(tmp_path / "s"))
    store = open_store(bucket)
    named = {file.path for part in store.listing().parts for file in part.files.values()}
    named |= {"store.json", *(part.name for part in store.listing().parts)}
    assert {path.removeprefix(f"{store.root}/") for path in store.files.find(store.root)} == named
