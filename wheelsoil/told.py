"""What is said of runs, each text once with the runs that it is about."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from processing.processed_run import ProcessedRun


def runs_by_text(
    runs: Iterable[ProcessedRun], texts_of: Callable[[ProcessedRun], Iterable[str]]
) -> dict[str, list[str]]:
    """Return each text with the names of the runs that say it, in their order.

    Parameters
    ----------
    runs : iterable of ProcessedRun
    texts_of : callable
        What is said of a run.

    Returns
    -------
    mapping text -> list of str
    """
    about: dict[str, list[str]] = {}
    for run in runs:
        for text in texts_of(run):
            about.setdefault(text, []).append(run.run.id)
    return about
