"""The command line in this process, and small campaigns for it."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from shared_results import made_once

from wheelsoil.cli.app import run

SHORT = ("--runs", 1, "--duration", 20)
"""Of a demo that is quickly made."""


@dataclass(frozen=True)
class Result:
    """What a command left."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """stdout as strict JSON."""
        return json.loads(self.out, parse_constant=_refuse)


def invoke(*args: object) -> Result:
    """Run a command line."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run([str(arg) for arg in args])
    return Result(code, out.getvalue(), err.getvalue())


def ok(*args: object) -> Result:
    """Run a command line that must end well."""
    result = invoke(*args)
    assert result.code == 0, f"exit code {result.code}\n{result.err}"
    return result


def small_campaign(folder: Path, *, runs: int = 2, duration_s: float = 20.0) -> Path:
    """Simulate a campaign on clay with Lyasko's slip sinkage."""
    ok("simulate", "-o", folder, "--runs", runs, "--duration", duration_s, "--effect", "lyasko:m1=0.1,m2=0.05")
    return folder


def kept_demo(factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a demo of one run of 20 s and, in `kept`, the results that another one takes from there."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("WHEELSOIL_CACHE", str(folder / "kept"))
            ok("demo", "-o", folder / "demo", *SHORT)

    return made_once(factory, "demo", make)


@contextmanager
def busy(channel: str) -> Iterator[None]:
    """Have a node send on a virtual bus, a frame each 5 ms."""
    import can

    with can.Bus(interface="virtual", channel=channel) as bus:
        task = bus.send_periodic(can.Message(arbitration_id=0x123, data=[1, 2, 3], is_extended_id=False), 0.005)
        yield
        task.stop()


def _refuse(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def silence(log: Path, bus: str) -> None:
    """Take the frames of a bus out of a candump log."""
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    log.write_text("".join(line for line in lines if f" {bus} " not in line), encoding="utf-8")
