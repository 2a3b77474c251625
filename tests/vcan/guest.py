"""Runs a shell script where there is a real vcan0: on this kernel, or in a guest of Debian's user-mode-linux.

In both cases the script sees the files of this machine, and what it writes can be read here afterwards. What must not
happen to this machine (a clock that is set, a disk that is full, a power cut) happens in a guest only: `run_in_guest`.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import pytest

HERE = Path(__file__).parent
_MODULES = ("net/can/can", "net/can/can-raw", "drivers/net/can/dev/can-dev", "drivers/net/can/vcan")
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_BUS_UP = "ip link set lo up; ip link add dev vcan0 type vcan && ip link set vcan0 up"
_CONSOLE_LINES = 15
_ONE_OF_SEVERAL = f"""
run_one() {{
  for bus in $(ip -o link show type vcan | cut -d: -f2); do ip link del $bus; done
  {_BUS_UP}
  sh $1.sh > $1.out 2>&1
  echo $? > $1.code
}}"""
TOOLS = {
    "ip": "iproute2",
    "insmod": "kmod",
    "mke2fs": "e2fsprogs",
    "e2fsck": "e2fsprogs",
    "debugfs": "e2fsprogs",
    "cansend": "can-utils",
    "curl": "curl",
}
"""Every program that a test uses and Debian does not always have, with its package."""


class NoGuestError(Exception):
    """No kernel with vcan can be had here, or not all that a script needs; says why."""


@dataclass(frozen=True)
class GuestResult:
    """How a script ended, and its output on stdout and stderr."""

    exit_code: int
    output: str


def run_with_vcan(script: str, *, timeout_s: float = 120.0, memory: str = "1G") -> GuestResult:
    """Run a script for ``sh`` as root beside an interface ``vcan0`` that is up.

    Parameters
    ----------
    script : str
        The files it names must not lie below /dev, /proc or /sys, of which a guest has its own.
    timeout_s : float
        After it everything that the script started is killed, and the exit code is 124.
    memory : str
        Of a guest.

    Raises
    ------
    NoGuestError
        If neither this kernel nor user-mode-linux offers vcan, or a tool is missing that the script names.
    """
    require("ip", *tools_of(script))
    with tempfile.TemporaryDirectory(prefix="vcan-", dir=_work_root()) as name:
        work = Path(name)
        (work / "script.sh").write_text(script, encoding="utf-8")
        if _in_own_namespace():
            return _run_here(work, timeout_s)
        return _run_guest(work, timeout_s, memory)


@dataclass(frozen=True)
class PowerCut:
    """When a guest's kernel is killed: so long after a file has appeared, which the script makes as a sign of life."""

    sign: Path
    after_s: float


def run_in_guest(
    script: str,
    *,
    timeout_s: float = 120.0,
    memory: str = "1G",
    disks: Sequence[Path] = (),
    power_cut: PowerCut | None = None,
) -> GuestResult:
    """Do as `run_with_vcan`, but in a guest even where this kernel has vcan.

    Parameters
    ----------
    script, timeout_s, memory
        See `run_with_vcan`.
    disks : sequence of Path
        Images of block devices: /dev/ubda, /dev/ubdb, ... in the guest.
    power_cut : PowerCut, optional
        The disks then keep what was written through to them; the exit code is -9.

    Raises
    ------
    NoGuestError
        If there is no user-mode-linux, or a tool is missing that the script names.
    """
    require("ip", *tools_of(script))
    with tempfile.TemporaryDirectory(prefix="vcan-", dir=_work_root()) as name:
        work = Path(name)
        (work / "script.sh").write_text(script, encoding="utf-8")
        return _run_guest(work, timeout_s, memory, disks, power_cut)


def run_or_skip(script: str, *, timeout_s: float = 120.0, memory: str = "1G") -> GuestResult:
    """Do as `run_with_vcan`; without a kernel skip the test, or fail it if WHEELSOIL_REQUIRE_VCAN is 1."""
    with or_skip():
        return run_with_vcan(script, timeout_s=timeout_s, memory=memory)


def run_all_or_skip(scripts: Mapping[str, str], folder: Path, *, timeout_s: float = 120.0) -> dict[str, GuestResult]:
    """Do as `run_or_skip` with several scripts, one after the other, each beside a new ``vcan0`` and no other bus.

    `folder` is for the scripts and what they say.
    """
    steps = [_ONE_OF_SEVERAL]
    for name, script in scripts.items():
        (folder / f"{name}.sh").write_text(script, encoding="utf-8")
        steps.append(f"run_one {shlex.quote(str(folder / name))}")
    with or_skip():
        require(*(tool for script in scripts.values() for tool in tools_of(script)))
    whole = run_or_skip("\n".join(steps), timeout_s=timeout_s)
    return {
        name: GuestResult(int(_text(folder / f"{name}.code") or whole.exit_code), _text(folder / f"{name}.out"))
        for name in scripts
    }


def guest_or_skip(
    script: str, *, timeout_s: float = 120.0, disks: Sequence[Path] = (), power_cut: PowerCut | None = None
) -> GuestResult:
    """Do as `run_in_guest`; skip or fail as `run_or_skip` does."""
    with or_skip():
        return run_in_guest(script, timeout_s=timeout_s, disks=disks, power_cut=power_cut)


def tool_or_skip(name: str) -> str:
    """Return the path of one of the `TOOLS`; skip or fail as `run_or_skip` does."""
    with or_skip():
        require(name)
    return str(shutil.which(name, path=_PATH))


def tools_of(script: str) -> list[str]:
    """Return those of the `TOOLS` that a script names."""
    return [name for name in TOOLS if re.search(rf"(?<![\w./-]){name}(?![\w-])", script)]


def require(*names: str) -> None:
    """See that tools are there.

    Raises
    ------
    NoGuestError
        If one is not; names it and its package.
    """
    missing = {name: TOOLS[name] for name in names if not shutil.which(name, path=_PATH)}
    if missing:
        packages = " ".join(dict.fromkeys(missing.values()))
        raise NoGuestError(f"not installed: {', '.join(missing)}; on Debian: apt-get install {packages}")


@contextlib.contextmanager
def or_skip() -> Iterator[None]:
    try:
        yield
    except NoGuestError as error:
        if os.environ.get("WHEELSOIL_REQUIRE_VCAN") == "1":
            pytest.fail(f"WHEELSOIL_REQUIRE_VCAN=1, but {error}")
        pytest.skip(str(error))


def _work_root() -> Path:
    """Return a folder that a guest sees too: it mounts a /dev of its own."""
    default = Path(tempfile.gettempdir())
    return Path("/var/tmp") if default.is_relative_to("/dev") else default


@lru_cache(maxsize=1)
def _in_own_namespace() -> tuple[str, ...]:
    """Return the command that makes a network of its own on this kernel; empty where it cannot have a vcan."""
    unshare = ("unshare", "--net") if os.geteuid() == 0 else ("unshare", "--net", "--map-root-user")
    if not shutil.which("unshare", path=_PATH):
        return ()
    tried = subprocess.run(
        [*unshare, "sh", "-c", f"PATH={_PATH}; {_BUS_UP}"], check=False, capture_output=True, timeout=20
    )
    return unshare if tried.returncode == 0 else ()


def _run_here(work: Path, timeout_s: float) -> GuestResult:
    script = f"PATH={_PATH}; {_BUS_UP} && exec sh {work}/script.sh > {work}/output 2>&1"
    code = _wait([*_in_own_namespace(), "sh", "-c", script], work, dict(os.environ), timeout_s)
    return GuestResult(code, _text(work / "output"))


def _run_guest(
    work: Path, timeout_s: float, memory: str, disks: Sequence[Path] = (), power_cut: PowerCut | None = None
) -> GuestResult:
    kernel, modules, shim = _user_mode_linux()
    init = work / "init.sh"
    init.write_text(_init_script(work, modules), encoding="utf-8")
    init.chmod(0o755)
    command = [kernel, f"mem={memory}", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "rw", f"init={init}"]
    command += [f"ubd{number}={disk}" for number, disk in enumerate(disks)]
    environment = {"PATH": _PATH, "HOME": str(work)}
    if Path("/dev/shm").is_dir():
        environment["TMPDIR"] = "/dev/shm"  # the guest's memory is a file
    if shim is not None:
        environment["LD_PRELOAD"] = _built(shim, work / "shim.so")
    code = _wait([*command, "con=null", "con0=fd:0,fd:1", "quiet"], work, environment, timeout_s, power_cut)
    if not (work / "ready").exists():
        raise NoGuestError(f"user-mode-linux does not start: {_last_lines(work / 'console')}")
    code_text = _text(work / "code").strip()
    return GuestResult(int(code_text) if code_text else code or 125, _text(work / "output"))


def _init_script(work: Path, modules: Path) -> str:
    load = "\n".join(f"insmod {shlex.quote(str(modules / name))}.ko" for name in _MODULES)
    keep = " ".join(f"export {name}={shlex.quote(value)};" for name, value in os.environ.items() if _is_ours(name))
    return f"""#!/bin/sh
export PATH={_PATH} HOME={work}; {keep}
mount -t proc proc /proc
{load}
{_BUS_UP} && touch {work}/ready && sh {work}/script.sh > {work}/output 2>&1
echo $? > {work}/code
sync
halt -f || reboot -f
"""


def _is_ours(name: str) -> bool:
    return name.startswith(("WHEELSOIL_", "PYTHON"))


@lru_cache(maxsize=1)
def _user_mode_linux() -> tuple[str, Path, Path | None]:
    """Return the kernel, the folder of its modules, and the source of a shim where the processor needs one."""
    kernel = shutil.which("linux.uml", path=_PATH)
    if kernel is None:
        raise NoGuestError("this kernel has no vcan, and user-mode-linux (Debian's package) is not installed")
    folders = sorted(Path("/usr/lib/uml/modules").glob("*/kernel"))
    if not folders or not (folders[-1] / f"{_MODULES[-1]}.ko").exists():
        raise NoGuestError("user-mode-linux is installed without its vcan module")
    require("insmod")
    if " amx_tile" not in _text(Path("/proc/cpuinfo")):
        return kernel, folders[-1], None
    if not shutil.which("cc"):
        raise NoGuestError("this processor has AMX, for which user-mode-linux needs a shim, and there is no C compiler")
    return kernel, folders[-1], HERE / "xstate_shim.c"


def _built(source: Path, target: Path) -> str:
    subprocess.run(
        ["cc", "-O1", "-fno-builtin", "-shared", "-fPIC", "-nostdlib", "-o", str(target), str(source)],
        check=True,
        capture_output=True,
        timeout=60,
    )
    return str(target)


def _wait(
    command: list[str], work: Path, environment: dict[str, str], timeout_s: float, power_cut: PowerCut | None = None
) -> int:
    """Run a command with a hard end: every process of its session is killed by its id."""
    with (work / "console").open("wb") as console:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=console, stderr=console, env=environment, start_new_session=True
        )
        try:
            if power_cut is not None:
                _cut_power(process, power_cut, timeout_s)
            return process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return 124
        finally:
            _end_session(process.pid)
            process.wait()


def _cut_power(process: subprocess.Popen[bytes], power_cut: PowerCut, timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while not power_cut.sign.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    if power_cut.sign.exists():
        time.sleep(power_cut.after_s)
        process.kill()


def _end_session(session: int) -> None:
    for _ in range(50):
        members = _members(session)
        if not members:
            return
        for pid in members:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.05)


def _members(session: int) -> list[int]:
    """Return the processes of a session that still run; helpers of user-mode-linux outlive their kernel."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        with contextlib.suppress(OSError, IndexError):
            after_name = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(after_name[3]) == session and after_name[0] != "Z":
                found.append(int(entry.name))
    return found


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


def _last_lines(path: Path) -> str:
    return " | ".join(_text(path).split("\n")[-_CONSOLE_LINES:])
