"""What `--help` promises of exit codes, and that a fault is a message on stderr."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from cli_support import invoke
from view_client import taken_from

from daq import ConfigError, DataError, HardwareError, RecordingError, WheelsoilError
from daq.errors import DatabaseError
from wheelsoil.cli.app import _from_system

CLAY = Path(__file__).parents[2] / "recordings" / "clay"


@pytest.mark.parametrize(
    ("error", "code"), [(DataError, 1), (ConfigError, 2), (DatabaseError, 2), (RecordingError, 3), (HardwareError, 4)]
)
def test_each_kind_of_error_has_its_code(error: type[WheelsoilError], code: int) -> None:
    assert error("x").exit_code == code


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.ENOENT, ConfigError),
        (errno.EACCES, ConfigError),
        (errno.EISDIR, ConfigError),
        (errno.ENOSPC, HardwareError),
        (errno.EIO, HardwareError),
    ],
)
def test_a_wrong_path_is_usage_and_a_full_disk_is_hardware(number: int, kind: type[WheelsoilError]) -> None:
    [fault] = (error := _from_system(OSError(number, "what", "where"))).faults
    assert type(error) is kind and (fault.what, fault.where) == ("what", "where")


def test_a_fault_is_a_message_on_stderr(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"no recording at all")
    found = invoke("info", tmp_path / "run.mcap")
    assert (found.code, found.out) == (3, "")
    assert found.err.startswith("wheelsoil: ")
    assert "Traceback" not in found.err
    files = [tmp_path / "a.toml", tmp_path / "b.toml"]
    wrong = invoke("info", tmp_path / "run.mcap", "--vehicle", files[0], "--terrain", files[1])
    assert wrong.code == 2 and all(str(path) in wrong.err for path in files)
    usage = invoke("info", tmp_path / "absent.mcap")
    assert (usage.code, usage.out) == (2, "") or usage.code == 3


@pytest.mark.parametrize("command", ["process", "fit", "sinkage", "diagnose", "info"])
def test_a_run_that_only_runs_toml_names_costs_no_other(command: str, tmp_path: Path) -> None:
    folder = taken_from(CLAY, tmp_path / "clay", 2)
    (folder / "runs.toml").write_text('[[run]]\nfile = "run-1.mcap"\n[[run]]\nfile = "run-2.mcap"\n')
    (folder / "run-2.mcap").unlink()
    options = ("--effects", "torque_zero") if command == "diagnose" else ()
    found = invoke(command, folder, *options, "--json")
    assert found.code == 0 and "run-2.mcap: skipped: no such file; next: copy it there" in found.err
    assert command == "info" or '"cause": "missing"' in found.out
    (folder / "run-1.mcap").unlink()
    assert invoke(command, folder).code == 3
