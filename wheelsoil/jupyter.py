"""Small HTML tables for what people hold in a notebook, made only when IPython shows them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

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


def html_of(value: Any) -> str:
    """Return the HTML of a run, a processed run, a fit or a diagnosis.

    Raises
    ------
    KeyError
        It is of another type.
    """
    return _html(_SHOWN[type(value).__module__, type(value).__qualname__], value)


def _html(function: str, value: Any) -> str:
    show: Callable[[Any], str] = getattr(import_module("wheelsoil.notebook"), function)
    return show(value)
