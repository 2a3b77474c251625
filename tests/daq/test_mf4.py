"""A module in place of asammdf crashes, hangs or takes all memory. What the real one reads is in test_logs.py."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import daq.child_process
from daq.errors import RecordingError
from daq.logs import read_log

CRASHES = {
    "os.kill(os.getpid(), signal.SIGSEGV)": "its process ended with signal SIGSEGV",
    "os._exit(3)": "its process ended with exit code 3",
    "print('at offset 12', file=sys.stderr); os.abort()": "signal SIGABRT: at offset 12",
    "time.sleep(1000)": "it gave nothing for 3 s",
    "while True: pass": "it gave nothing for 3 s",
    "[bytearray(1 << 30) for _ in range(64)]": "it takes more than 2.1 GB of memory",
    "raise ValueError('the block at 12 is none')": "ValueError: the block at 12 is none",
    "raise KeyError": "KeyError",
    "print('{}', flush=True); os._exit(0)": "its process ended with exit code 0: {}",
    "sys.exit('enough')": "its process ended with exit code 1: enough",
}


LIKE_ANOTHER = ("while True: pass", "raise KeyError", "print('{}', flush=True); os._exit(0)", "sys.exit('enough')")


@pytest.mark.parametrize(
    "crash", [pytest.param(crash, marks=[pytest.mark.slow] * (crash in LIKE_ANOTHER)) for crash in CRASHES]
)
def test_whatever_asammdf_does_is_an_error_with_the_file(
    crash: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = f"import os, signal, sys, time\nclass MDF:\n    def __init__(self, path):\n        {crash}\n"
    (tmp_path / "asammdf.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "asammdf", raising=False)
    monkeypatch.setattr(daq.child_process, "LIBRARY_PATIENCE_S", 3.0 if "gave nothing" in CRASHES[crash] else 60.0)
    path = tmp_path / "drive.mf4"
    path.write_bytes(b"MDF     4.11    CE      ".ljust(4096, b"\0"))
    with pytest.raises(RecordingError, match="asammdf cannot read this MF4 file") as caught:
        list(read_log(path))
    assert CRASHES[crash] in caught.value.faults[0].found
    assert caught.value.faults[0].where == str(path)
