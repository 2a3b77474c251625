"""Runs a command with what a unit leaves it: no capabilities, its system calls, no memory both writable and executable.

``python service_sandbox.py UNIT COMMAND...``; what this kernel or machine lacks for it is left out.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

_PR_CAPBSET_DROP, _PR_SET_NO_NEW_PRIVS, _PR_SET_MDWE = 24, 38, 65
_CAPABILITIES = 64
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050001
"""libseccomp: SCMP_ACT_ALLOW, SCMP_ACT_ERRNO(EPERM)."""


def main() -> None:
    unit, *command = sys.argv[1:]
    text = Path(unit).read_text(encoding="utf-8")
    libc = ctypes.CDLL(None)
    if "CapabilityBoundingSet=\n" in text:
        for number in range(_CAPABILITIES):
            libc.prctl(_PR_CAPBSET_DROP, number, 0, 0, 0)
    if "NoNewPrivileges=yes" in text:
        libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    if shutil.which("systemd-analyze") and (library := ctypes.util.find_library("seccomp")):
        _filter(ctypes.CDLL(library), re.findall(r"^SystemCallFilter=(\S+)$", text, re.M))
    if "MemoryDenyWriteExecute=yes" in text:
        libc.prctl(_PR_SET_MDWE, 1, 0, 0, 0)
    os.execv(command[0], command)


def _filter(seccomp: ctypes.CDLL, sets: list[str]) -> None:
    """Allow the system calls of the sets, but those of sets that begin with ~."""
    allowed: set[str] = set()
    for name in sets:
        allowed = allowed - _calls(name[1:]) if name.startswith("~") else allowed | _calls(name)
    seccomp.seccomp_init.restype = ctypes.c_void_p
    context = ctypes.c_void_p(seccomp.seccomp_init(ctypes.c_uint32(_REFUSE)))
    for name in allowed | _calls("@default"):
        number = seccomp.seccomp_syscall_resolve_name(name.encode())
        if number >= 0:
            seccomp.seccomp_rule_add(context, ctypes.c_uint32(_ALLOW), number, 0)
    if seccomp.seccomp_load(context) != 0:
        sys.exit("the kernel takes no filter of system calls")


def _calls(name: str) -> set[str]:
    done = subprocess.run(["systemd-analyze", "syscall-filter", "--no-pager", name], capture_output=True, check=True)
    words = [line.strip() for line in done.stdout.decode().splitlines()[1:]]
    inner = [_calls(word) for word in words if word.startswith("@")]
    return {word for word in words if word and word[0] not in "@#"}.union(*inner)


if __name__ == "__main__":
    main()
