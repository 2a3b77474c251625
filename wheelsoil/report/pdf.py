"""A report as PDF, printed by the Chromium or Chrome that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from daq.errors import ConfigError, Fault, WheelsoilError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
"""Names on the PATH, the first one that is there is taken."""
_OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--no-pdf-header-footer",
    "--virtual-time-budget=20000",
)
_PATIENCE_S = 180


class PrintError(WheelsoilError, RuntimeError):
    """A browser is there, but it made no PDF."""


def find_browser() -> str:
    """Return the path of a browser that can print.

    Raises
    ------
    ConfigError
        There is none.
    """
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise ConfigError(
            Fault(
                "no browser that could make a PDF",
                "PATH",
                expected=f"one of {', '.join(BROWSERS)}",
                next_step="apt-get install chromium; or write the page (-o report.html), open it and print it",
            )
        )
    return found


def print_page(page: Path, output: Path, browser: str | None = None) -> None:
    """Print an HTML file that needs no network to an A4 PDF with page numbers.

    Parameters
    ----------
    page, output : Path
    browser : str, optional
        As by `find_browser`.

    Raises
    ------
    ConfigError
        There is no browser.
    PrintError
        It failed.
    """
    chosen = browser or find_browser()
    with tempfile.TemporaryDirectory(prefix="wheelsoil-") as folder:
        made = Path(folder) / "page.pdf"
        places = [f"--user-data-dir={folder}/profile", f"--print-to-pdf={made}", page.resolve().as_uri()]
        said = _run([chosen, *_OPTIONS, *_sandbox(), *places])
        if not made.is_file() or not made.read_bytes().startswith(b"%PDF"):
            raise PrintError(
                Fault(
                    "the browser made no PDF",
                    chosen,
                    found=said.strip().splitlines()[-1][:200] if said.strip() else "it said nothing",
                    next_step="write the page (-o report.html), open it and print it",
                )
            )
        shutil.copyfile(made, output)


def _run(command: list[str]) -> str:
    """Run a browser to its end and return what it said."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return f"no answer within {_PATIENCE_S} s"
    except OSError as error:
        return str(error)
    return done.stderr


def _sandbox() -> list[str]:
    """Return what root needs: Chromium's sandbox does not work for it, and the page is our own file."""
    return ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
