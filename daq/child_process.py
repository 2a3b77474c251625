"""Readers that lean on C libraries, in a process of their own: a file on which one crashes or hangs is an error here.

``python -m daq.child_process MODULE:FUNCTION FILE [ARGUMENT...]`` answers with a pickle of our own making for each
thing that the generator function yields.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import pickle
import pkgutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from daq import RecordingError, WheelsoilError, limit_memory
from daq.limits import LIBRARY_BYTES_PER_S, LIBRARY_MEMORY_BYTES, LIBRARY_PATIENCE_S


class _BrokenError(Exception):
    """The process ended without an end, or the library raised."""


def answers(task: str, path: Path, *arguments: str, what: str, next_step: str) -> Iterator[Any]:
    """Yield what a generator function yields in a process of its own.

    `task` is ``"module:function"``, which takes the path and the arguments. What it raises as `WheelsoilError` is
    raised here. `RecordingError`, with `what` and `next_step`, where it raised anything else, its process ended, or it
    gave nothing for `LIBRARY_PATIENCE_S`.
    """
    patience_s = LIBRARY_PATIENCE_S + path.stat().st_size / LIBRARY_BYTES_PER_S
    ours = {
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "OPENBLAS_NUM_THREADS": "1",
        # one heap of large pages: a process of one file spends much of its time on the first touch of each
        "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1:glibc.malloc.mmap_threshold=33554432",
    }
    command = [sys.executable, "-m", "daq.child_process", task, str(path), *arguments]
    with (
        tempfile.TemporaryFile() as complaints,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, env=os.environ | ours) as process,
    ):
        try:
            while (answer := _next(process, complaints, patience_s)) is not None:
                yield answer[0]
        except _BrokenError as error:
            raise RecordingError.of(what, path, str(error), next_step=next_step) from None
        finally:
            process.kill()


def _next(process: subprocess.Popen[bytes], complaints: IO[bytes], patience_s: float) -> tuple[Any] | None:
    """Return the next answer, None at the end; the process is killed if it takes longer than `patience_s`."""
    assert process.stdout is not None
    began_s = time.monotonic()
    watchdog = threading.Timer(patience_s, process.kill)
    watchdog.start()
    try:
        answer = _received(process.stdout)
    except (EOFError, pickle.UnpicklingError):  # it ended, or was ended, in the middle
        code = process.wait()
        if time.monotonic() - began_s >= patience_s:
            raise _BrokenError(f"it gave nothing for {patience_s:.0f} s") from None
        raise _BrokenError(f"its process ended with {_ending(code)}{_last_line(complaints)}") from None
    finally:
        watchdog.cancel()
    if isinstance(answer, Exception):
        raise answer
    return answer


def _received(pipe: IO[bytes]) -> tuple[Any] | Exception | None:
    """Return what `_send` sent; arrays lie in the memory that they were received into."""
    sizes, body = pickle.load(pipe)
    starts = np.cumsum([0, *(-(-size // 64) * 64 for size in sizes)])
    whole = np.empty(starts[-1], np.uint8)  # at once: that of the answer before is used again
    parts = [whole[start : start + size] for start, size in zip(starts, sizes, strict=False)]
    for part in parts:
        if pipe.readinto(part) < len(part):  # type: ignore[attr-defined]
            raise EOFError
    answer: tuple[Any] | Exception | None = pickle.loads(body, buffers=parts)
    return answer


def _send(answer: Any, pipe: IO[bytes]) -> None:
    """Send an answer: its arrays as they lie in memory, ahead of them their sizes and what else there is."""
    parts: list[pickle.PickleBuffer] = []
    body = pickle.dumps(answer, protocol=5, buffer_callback=parts.append)
    views = [part.raw() for part in parts]
    pickle.dump(([len(view) for view in views], body), pipe)
    for view in views:
        pipe.write(view)
    pipe.flush()


def _ending(code: int) -> str:
    """Return the exit code of a process in words."""
    with contextlib.suppress(ValueError):
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


def _last_line(complaints: IO[bytes]) -> str:
    complaints.seek(max(complaints.seek(0, os.SEEK_END) - 1000, 0))
    lines = complaints.read().decode(errors="replace").split("\n")
    return next((f": {line.strip()}" for line in reversed(lines) if line.strip()), "")


def _memory_bytes(path: str) -> int:
    return LIBRARY_MEMORY_BYTES + 4 * Path(path).stat().st_size


def _serve(task: str, path: str, arguments: list[str], out: IO[bytes]) -> None:
    say = partial(_send, pipe=out)
    try:
        for answer in pkgutil.resolve_name(task)(path, *arguments):
            say((answer,))
        say(None)
    except WheelsoilError as error:
        say(error)
    except MemoryError:
        say(_BrokenError(f"it takes more than {_memory_bytes(path) / 1e9:.1f} GB of memory"))
    except Exception as error:  # noqa: BLE001  a library raises what it likes; the other process says it
        say(_BrokenError(f"{type(error).__name__}: {str(error)[:500]}".rstrip(": ")))


def _main() -> None:
    _, task, path, *arguments = sys.argv
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    limit_memory(_memory_bytes(path), addresses=True)
    gc.set_threshold(100_000)  # the libraries' modules hold no cycles to look for
    _serve(task, path, arguments, out)


if __name__ == "__main__":
    importlib.import_module("daq.child_process")._main()  # by its name, under which the other process unpickles
