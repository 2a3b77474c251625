"""What a narrow terminal shows, and what is left of a result when it cannot be written anew."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from daq.series import write_whole
from wheelsoil.console import printable_addresses

PRINTING = """
import sys
from wheelsoil.cli import app
app.run = lambda: print(sys.argv[1]) or 0
app.main()
"""


@pytest.mark.parametrize(
    ("encoding", "text", "shown"),
    [
        ("cp1252", "slip −0.10 to −0.05", "slip -0.10 to -0.05"),
        ("cp1252", "tan φ, k_Θ, n₁ ≤ 3 ± 1 °", "tan phi, k_theta, n1 <= 3 ± 1 °"),
        ("ascii", "± 2 µm → é 日 •", "+- 2 um -> e ? ?"),
        ("utf-8", "−φ₁", "−φ₁"),
    ],
)
def test_what_a_terminal_cannot_show_is_written_out(encoding: str, text: str, shown: str) -> None:
    command = [sys.executable, "-c", PRINTING, text]
    done = subprocess.run(command, capture_output=True, check=True, env=os.environ | {"PYTHONIOENCODING": encoding})
    assert done.stdout.decode(encoding).rstrip() == shown


def test_a_result_that_cannot_be_written_leaves_the_one_before(tmp_path: Path) -> None:
    path = tmp_path / "keep.html"
    path.write_text("as it was")
    with pytest.raises(UnicodeEncodeError):
        write_whole(path, "acker\udcfc", "strict")
    limited = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)); import signal; "
    limited += "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); from pathlib import Path; "
    limited += "from daq.series import write_whole; write_whole(Path(sys.argv[1]), 'x' * 5000)"
    command = [sys.executable, "-B", "-c", limited, str(path)]  # its bytecode would be cut off, too
    done = subprocess.run(command, capture_output=True, check=False)
    assert b"File too large" in done.stderr
    assert path.read_text() == "as it was"
    assert list(tmp_path.iterdir()) == [path]


def test_half_a_character_of_a_name_is_no_reason_to_fail(tmp_path: Path) -> None:
    """Names of files that are no UTF-8 carry surrogates."""
    name = os.fsdecode(b"acker\xfc")
    page, numbers = tmp_path / "page.html", tmp_path / "page.json"
    write_whole(page, f"<p>{name}</p>")
    write_whole(numbers, json.dumps({"folder": name}, ensure_ascii=False), "backslashreplace")
    assert page.read_text(encoding="utf-8") == "<p>acker?</p>"
    assert json.loads(numbers.read_text(encoding="utf-8")) == {"folder": name}


@pytest.mark.parametrize(
    ("token", "terminal", "shown"), [("t", True, True), ("t", False, False), (None, False, True), (None, True, True)]
)
def test_a_token_that_was_given_is_printed_on_a_terminal_only(
    monkeypatch: pytest.MonkeyPatch, token: str | None, terminal: bool, shown: bool
) -> None:
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(isatty=lambda: terminal))
    addresses = printable_addresses(["http://127.0.0.1:8000/#t"], token)
    assert addresses == ("http://127.0.0.1:8000/" + "#t" * shown,)
