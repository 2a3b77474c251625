"""What Windows withholds, withheld from our own packages; libraries keep it, since they have ways of their own.

Put the folder of this file on ``PYTHONPATH``: every process of a command is then under it, children too. Emulated are
modules, functions and constants that Windows lacks, ``fork``, names that no file may have there, folders that cannot
be opened as files, files that another program holds open (``WHEELSOIL_HELD``: their names, apart by ``|``), and those
that the process itself has open: they are neither moved nor deleted.
"""

import builtins
import multiprocessing
import os
import re
import signal
import socket
import sys
from pathlib import Path
from types import ModuleType

OURS = ("daq", "processing", "model", "wheelsoil")

MODULES = "crypt curses fcntl grp nis posix pty pwd readline resource spwd syslog termios tty"
MISSING = {
    os: "fork forkpty nice sysconf confstr pathconf statvfs fstatvfs getuid geteuid getgid getegid setsid killpg chown "
    "fchown lchown mkfifo mknod sched_getaffinity uname getloadavg getpgid pread pwrite sendfile sync fdatasync wait "
    "posix_fallocate posix_fadvise register_at_fork ctermid openpty ttyname O_DIRECTORY O_CLOEXEC O_NONBLOCK "
    "O_NOFOLLOW O_DIRECT O_SYNC O_TMPFILE ST_RDONLY",
    signal: "SIGHUP SIGKILL SIGUSR1 SIGUSR2 SIGALRM SIGPIPE SIGCHLD SIGQUIT SIGTSTP alarm setitimer pause "
    "pthread_sigmask pthread_kill sigwait siginterrupt",
    socket: "AF_UNIX AF_CAN CAN_RAW SO_REUSEPORT TCP_USER_TIMEOUT SCM_RIGHTS if_nametoindex sethostname",
}

FORBIDDEN = re.compile(r'[<>:"|?*\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE)
HELD = set(filter(None, os.environ.get("WHEELSOIL_HELD", "").split("|")))
OPEN = Path("/proc/self/fd")
OWN_FILES = ("/proc/", "/dev/", "/sys/")


def is_ours(name: object) -> bool:
    return str(name).partition(".")[0] in OURS


def withhold(module: ModuleType, names: str) -> None:
    """Take names from a module, for callers of our packages."""
    withheld = frozenset(names.split())

    class Windows(ModuleType):
        def __getattribute__(self, name: str) -> object:
            if name in withheld and is_ours(sys._getframe(1).f_globals.get("__name__")):
                raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
            return super().__getattribute__(name)

    module.__class__ = Windows


def importing(name: str, globals=None, locals=None, fromlist=(), level=0):
    if level == 0 and name in MODULES.split() and is_ours((globals or {}).get("__name__")):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return imported(name, globals, locals, fromlist, level)


def watch(event: str, args: tuple) -> None:
    """Refuse what Windows refuses of files."""
    if event == "open" and isinstance(args[0], str | bytes | os.PathLike):
        path, _, flags = args
        name = os.fsdecode(path)
        if name.startswith(OWN_FILES):
            return
        writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if writes:
            refuse(name)
        elif is_ours(sys._getframe(1).f_globals.get("__name__")) and Path(name).is_dir():
            raise PermissionError(13, "Permission denied", name)
    elif event == "os.rename":
        for name in map(os.fsdecode, args[:2]):
            refuse(name)
            refuse_open(name)
    elif event in ("os.mkdir", "os.remove"):
        refuse(os.fsdecode(args[0]))
        refuse_open(os.fsdecode(args[0]))


def refuse(path: str) -> None:
    name = Path(path).name
    if FORBIDDEN.search(name):
        raise OSError(22, "Invalid argument", path)
    if name in HELD:
        raise PermissionError(13, "Permission denied", path)


def refuse_open(path: str) -> None:
    """Refuse to move or delete a file that this process holds open itself."""
    if OPEN.is_dir() and os.path.realpath(path) in map(os.path.realpath, OPEN.iterdir()):
        raise PermissionError(13, "Permission denied", path)


imported, builtins.__import__ = builtins.__import__, importing
for module, names in MISSING.items():
    withhold(module, names)
for kind in ("fork", "forkserver"):
    multiprocessing.context._concrete_contexts.pop(kind, None)
multiprocessing.get_all_start_methods = lambda: ["spawn"]
multiprocessing.set_start_method("spawn")
sys.addaudithook(watch)
