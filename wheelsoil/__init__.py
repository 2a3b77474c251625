"""wheelsoil: from CAN frames to a wheel-soil model that says what it gets wrong."""

from __future__ import annotations

import importlib.util
import sys
from functools import partial
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_ROOMS = ("daq", "processing", "model")
_SHOWN = {
    ("daq.runs.run", "Run"): "run_html",
    ("processing.processed_run", "ProcessedRun"): "processed_run_html",
    ("model.fit.result", "CampaignFit"): "fit_html",
    ("model.diagnosis.core.result", "Diagnosis"): "diagnosis_html",
}
"""Module and name of a type, and the function of `wheelsoil.notebook` that shows it."""


def register() -> None:
    """Tell IPython, where this Python is one, how to show runs, fits and diagnoses."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if shell is None:
        return
    formatter = shell.display_formatter.formatters["text/html"]
    for (module, name), function in _SHOWN.items():
        formatter.for_type_by_name(module, name, partial(_html, function))


def _html(function: str, value: Any) -> Any:
    """Return the table that `wheelsoil.notebook` makes; it is imported when the first is shown."""
    return getattr(importlib.import_module("wheelsoil.notebook"), function)(value)


def _check_rooms() -> None:
    """Refuse to start when a user's own module hides one of our packages."""
    home = Path(__file__).resolve().parent.parent
    for room in _ROOMS:
        spec = importlib.util.find_spec(room)
        origin = Path(spec.origin).resolve() if spec and spec.origin else None
        if origin != home / room / "__init__.py":
            raise ImportError(
                f"wheelsoil's package {room!r} is hidden by {origin or 'nothing: it is not installed'}\n"
                f"  expected: {home / room / '__init__.py'}\n"
                f"  next: rename your file, start Python in another folder, or use the `wheelsoil` command"
            )


_check_rooms()
register()
