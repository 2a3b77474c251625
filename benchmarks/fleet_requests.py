"""Requests of a fleet in a bucket: those of each campaign, of a plan, of a question and of a compaction.

``PYTHONPATH=tests python -m benchmarks.fleet_requests STORE 1000``: the campaigns that ``wheelsoil fleet run`` put into
STORE are put into a bucket of moto again and again under other names, with the calls that a worker makes; nothing is
diagnosed. Prints the requests by kind.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any
from urllib.request import urlopen

import bucket_server
import pyarrow.compute as pc
from doctor_support import free_port

from wheelsoil.fleet import COLUMNS, ask, compact, holdings_of, open_store

URL = "s3://field/fleet"
SQL = "select verdict, count(*) from diagnoses group by verdict"


class Bucket:
    """An empty bucket on a server of its own."""

    def __init__(self) -> None:
        self.address = f"http://127.0.0.1:{(port := free_port())}"
        self.server = subprocess.Popen(
            [sys.executable, bucket_server.__file__, str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        keys = {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1"}
        os.environ |= {**keys, "AWS_ENDPOINT_URL": self.address}
        for _ in range(600):
            with suppress(OSError):
                self.requests()
                break
            time.sleep(0.2)
        import s3fs

        s3fs.S3FileSystem().mkdir("field")
        self.requests()

    def requests(self) -> dict[str, int]:
        """Return the requests by kind since the last question."""
        with urlopen(f"{self.address}/-/requests") as answer:
            return dict(json.loads(answer.read()))

    def of(self, call: Callable[[], Any]) -> dict[str, int]:
        """Return the requests of a call."""
        self.requests()
        call()
        return self.requests()


def put(origin: str, count: int) -> None:
    """Put so many campaigns as workers do: each opens the store, looks whether it is there, and writes it."""
    holdings = holdings_of(open_store(origin))
    tables = {name: holdings.table(name) for name in COLUMNS}
    own = []
    for one in holdings.manifests.values():
        rows = {name: table.filter(pc.field("campaign") == one.campaign) for name, table in tables.items()}
        own.append((one, {name: each.drop_columns(["campaign"]) for name, each in rows.items() if len(each)}))
    for i in range(count):
        one, rows = own[i % len(own)]
        store, name = open_store(URL), f"vehicle-{i % 100:02d}/day-{i:06d}"
        if not store.has(name, one.content):
            store.put(replace(one, campaign=name, rows={table: len(each) for table, each in rows.items()}), rows)


def main(origin: str, count: str) -> None:
    """Count, and print a line for each step."""
    bucket = Bucket()
    open_store(URL, create=True)
    steps: dict[str, Callable[[], Any]] = {
        "put": lambda: put(origin, int(count)),
        "holdings": lambda: holdings_of(open_store(URL)),
        "question": lambda: ask(open_store(URL), SQL),
        "compaction": lambda: compact(open_store(URL)),
        "holdings, compacted": lambda: holdings_of(open_store(URL)),
        "question, compacted": lambda: ask(open_store(URL), SQL),
    }
    try:
        for name, step in steps.items():
            found = bucket.of(step)
            print(f"{name}: {found}, {sum(found.values()) / int(count):.2f} a campaign", flush=True)
    finally:
        bucket.server.terminate()
        bucket.server.wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
