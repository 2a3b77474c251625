"""Readers that lean on C libraries, in a process of their own: a file on which one crashes or hangs is an error here.

``python -m daq.series.apart MODULE:FUNCTION FILE LAYOUT rows`` answers with pickles of our own making: the topics, then
the blocks, and the report with each.
"""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import IO, Any

import daq.errors
from daq.config import SeriesSection
from daq.errors import RecordingError, WheelsoilError, every_error_as
from daq.limits import MF4_BYTES_PER_S, SERIES_MEMORY_BYTES, SERIES_PATIENCE_S
from daq.series.blocks import Blocks, Series, SeriesReport


def apart(reader: str) -> Any:
    """Return a reader of series that works in a process of its own.

    Parameters
    ----------
    reader : str
        ``"module:function"``, of the signature that all readers share.
    """
    return partial(_read_apart, reader)


def _read_apart(reader: str, path: Path, layout: SeriesSection, report: SeriesReport) -> Series:
    topics, opened = next(_answers(reader, path, layout, "open"))
    _take_over(report, opened)

    def read() -> Iterator[Blocks]:
        answers = _answers(reader, path, layout, "rows")
        next(answers)
        for blocks, now in answers:
            _take_over(report, now)
            yield blocks

    return Series(topics, read, report)


def _take_over(report: SeriesReport, other: SeriesReport) -> None:
    vars(report).update(vars(other) | {"path": report.path, "format": report.format})


def _answers(reader: str, path: Path, layout: SeriesSection, what: str) -> Iterator[tuple[Any, SeriesReport]]:
    """Yield what the process answers: the topics, and the blocks, where `what` is "rows"."""
    patience_s = SERIES_PATIENCE_S + path.stat().st_size / MF4_BYTES_PER_S
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "daq.series.apart", reader, str(path), layout.model_dump_json(), what]
    nothing, pipe = subprocess.DEVNULL, subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=nothing, env=os.environ | paths) as process:
        try:
            while True:
                kind, value, report = _next(process, path, patience_s)
                if kind == "error":
                    name, faults = value
                    raise getattr(daq.errors, name, RecordingError)(*faults)
                if kind == "end":
                    return
                yield value, report
        finally:
            process.kill()


def _next(process: subprocess.Popen[bytes], path: Path, patience_s: float) -> tuple[str, Any, SeriesReport]:
    assert process.stdout is not None
    began_s = time.monotonic()
    watchdog = threading.Timer(patience_s, process.kill)
    watchdog.start()
    try:
        answer: tuple[str, Any, SeriesReport] = pickle.load(process.stdout)
        return answer
    except (EOFError, pickle.UnpicklingError):  # it ended, or was ended, in the middle
        pass
    finally:
        watchdog.cancel()
    code = process.wait()
    late = time.monotonic() - began_s >= patience_s
    found = f"it gave nothing for {patience_s:.0f} s" if late else f"its process ended with exit code {code}"
    step = "export it again, in another format"
    raise RecordingError.of("the library that reads this file broke down on it", path, found, next_step=step)


def _serve(reader: str, path: Path, layout: SeriesSection, what: str, out: IO[bytes]) -> None:
    report = SeriesReport(str(path), "")

    def say(kind: str, value: Any) -> None:
        pickle.dump((kind, value, report), out, protocol=5)
        out.flush()

    try:
        with every_error_as(RecordingError, "the file cannot be read", lambda: str(path)):
            module, _, function = reader.partition(":")
            series = getattr(importlib.import_module(module), function)(path, layout, report)
            say("open", series.topics)
            for blocks in series.blocks() if what == "rows" else ():
                say("blocks", blocks)
        say("end", None)
    except WheelsoilError as error:
        say("error", (type(error).__name__, error.faults))


def _limit_memory(path: Path) -> None:
    """Let this process have no more than its share of memory, where the system can do that."""
    try:
        import resource
    except ImportError:
        return
    most = SERIES_MEMORY_BYTES + 4 * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


if __name__ == "__main__":
    _reader, _path, _layout, _what = sys.argv[1:]
    _out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    _limit_memory(Path(_path))
    _serve(_reader, Path(_path), SeriesSection.model_validate_json(_layout), _what, _out)
