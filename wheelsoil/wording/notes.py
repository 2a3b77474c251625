"""A note as the sentence that a person reads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from daq import number, without_powers
from wheelsoil.wording import run_notes

if TYPE_CHECKING:
    from daq import Note
    from model.diagnosis import NextRun
    from processing import ProcessedRun


def note_text(note: Note) -> str:
    """Return the sentence of a note, without a capital letter and a full stop."""
    sentence = run_notes.SENTENCES.get(note.code) or _of_a_model(note.code)
    said = sentence.format(**note.values) if isinstance(sentence, str) else sentence(note.values)
    return without_powers(said)


def _of_a_model(code: str) -> run_notes.Sentence:
    """Return the sentence of a code of a model; those of a diagnosis need the effects, which take a while to import."""
    from wheelsoil.wording import model_notes

    if code in model_notes.SENTENCES:
        return model_notes.SENTENCES[code]
    from wheelsoil.wording import diagnosis_notes

    return diagnosis_notes.SENTENCES[code]


def step_text(run: NextRun) -> str:
    """Return what to drive or measure next, after the name of the campaign where there are several."""
    campaign = f"{run.campaign}: " if run.campaign else ""
    return campaign + note_text(run.step)


def worth_text(run: NextRun) -> str:
    """Return what it is expected to tell, and what it takes in time."""
    cost = f"costs {run.cost_runs:g} run{'' if run.cost_runs == 1 else 's'}"
    return f"expected ln Bayes factor {number(run.expected_log_bayes_factor, 3)}, {cost}"


def texts_of(notes: Iterable[Note]) -> list[str]:
    """Return the sentences of notes, each once."""
    return list(dict.fromkeys(map(note_text, notes)))


def runs_by_text(
    runs: Iterable[ProcessedRun], notes_of: Callable[[ProcessedRun], Iterable[Note]]
) -> dict[str, list[str]]:
    """Return each sentence with the names of the runs that it is about, in their order.

    Parameters
    ----------
    notes_of : callable
        What is noted of a run.

    Returns
    -------
    mapping text -> list of str
    """
    about: dict[str, list[str]] = {}
    for run in runs:
        for text in texts_of(notes_of(run)):
            about.setdefault(text, []).append(run.run.id)
    return about
