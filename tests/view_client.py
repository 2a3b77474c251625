"""The analyst's page as a user starts it, and a plain HTTP client of it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

PATIENCE_S = 120.0
START = "from wheelsoil.cli.app import main; main()"
"""The program, as ``python -c`` takes it."""


@dataclass
class Answer:
    """What the page said."""

    status: int
    body: bytes
    headers: dict[str, str] = field(default_factory=dict)

    @property
    def json(self) -> Any:
        """The body as strict JSON."""
        return json.loads(self.body, parse_constant=_refuse)

    @property
    def faults(self) -> list[dict[str, str]]:
        """The faults of an answer that is an error; every one of them says what."""
        faults = self.json["faults"]
        assert faults and all(set(f) == {"what", "where", "found", "expected", "next_step"} for f in faults)
        assert all(fault["what"] for fault in faults)
        return list(faults)


@dataclass
class View:
    """A running page."""

    address: str
    said: list[str]

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(re.search(r":(\d+)/", self.address).group(1))  # type: ignore[union-attr]

    @property
    def token(self) -> str:
        """What its address carries."""
        return self.address.partition("#")[2]

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> Answer:
        """Make a request; ``_`` in a header's name is ``-``, and an empty header is left out."""
        usual = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        if body is not None:
            usual["Content-Type"] = "application/json"
        changed = usual | {name.replace("_", "-"): text for name, text in headers.items()}
        connection = HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request(method, path, body, {name: text for name, text in changed.items() if text})
        answer = connection.getresponse()
        found = Answer(answer.status, answer.read(), {k.lower(): v for k, v in answer.getheaders()})
        connection.close()
        return found

    def get(self, path: str) -> Any:
        """What a path answers, which must be well."""
        answer = self.ask("GET", path)
        assert answer.status == 200, answer.body
        return answer.json

    def post(self, path: str, **asked: Any) -> Any:
        """What a path answers to JSON, which must be well."""
        answer = self.tell(path, **asked)
        assert answer.status in (200, 202), answer.body
        return answer.json

    def tell(self, path: str, **asked: Any) -> Answer:
        """The answer to JSON, whatever it is."""
        return self.ask("POST", path, json.dumps(asked).encode())

    def campaigns(self) -> list[dict[str, Any]]:
        """The list's campaigns."""
        return list(self.get("/api/list")["campaigns"])

    def settled(self) -> list[dict[str, Any]]:
        """The list's campaigns once no run waits any more."""
        return self.until(
            lambda found: all(run["state"] in ("ready", "failed") for c in found for run in c["runs"]),
            "all runs processed",
        )

    def reset(self) -> None:
        """Take back every choice, and forget where it was saved."""
        for campaign in self.campaigns():
            if not campaign["saved_at"] and campaign["choice"].keys() == {"schema"}:
                continue
            for choice in ({"slip_threshold": 0.5}, {}):  # only a choice that changes is no longer the saved one
                self.post("/api/choose", campaign=campaign["key"], choice=choice)
        self.settled()

    def until(self, holds: Callable[[list[dict[str, Any]]], bool], what: str) -> list[dict[str, Any]]:
        """Ask for the list until something holds."""
        end = time.monotonic() + PATIENCE_S
        while not holds(found := self.campaigns()):
            assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what}"
            time.sleep(0.05)
        return found


@dataclass
class Program(View):
    """A page that is a process of its own."""

    process: subprocess.Popen[str]

    def end(self) -> None:
        """End it, as by Ctrl-C."""
        self.process.send_signal(2)
        self.process.wait(PATIENCE_S)


@contextmanager
def viewing(
    *args: object, port: int | None = 0, browser: bool = False, program: str = START, **env: str
) -> Iterator[Program]:
    """``wheelsoil view`` with some arguments; it must end by Ctrl-C, with 130 and without a traceback."""
    given = [*([] if port is None else ["--port", port]), *([] if browser else ["--no-browser"])]
    command = [sys.executable, "-c", program, "view", *given, *args]
    process = subprocess.Popen(
        [str(part) for part in command],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=os.environ | env,
    )
    assert process.stderr is not None
    try:
        said: list[str] = []
        while not said or not said[-1].startswith("Ctrl-C"):
            line = process.stderr.readline()
            assert line, f"it ended: {process.wait()}\n{''.join(said)}"
            said.append(line.rstrip("\n"))
        address = next(line for line in said if line.startswith("analyst's page: "))
        yield Program(address.removeprefix("analyst's page: "), said, process)
    finally:
        if process.poll() is None:
            process.send_signal(2)
        try:
            _, rest = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert process.returncode == 130, rest
    assert "Traceback" not in rest, rest


def taken_from(source: Path, folder: Path, runs: int) -> Path:
    """A campaign folder with the first runs of another."""
    folder.mkdir(parents=True)
    for path in [*source.glob("*.dbc"), source / "vehicle.toml", source / "terrain.toml"]:
        (folder / path.name).write_bytes(path.read_bytes())
    for number in range(1, runs + 1):
        name = f"run-{number}.mcap"
        (folder / name).write_bytes((source / name).read_bytes())
    return folder


def _refuse(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")
