"""A note as the sentence that a person reads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import exp, isfinite, log
from typing import TYPE_CHECKING

from daq import without_powers
from wheelsoil.wording import run_notes
from wheelsoil.wording.numbers import number, percent_apart

if TYPE_CHECKING:
    from daq import Note
    from model.diagnosis import NextRun


_DECIDING_ODDS = 1000.0


def note_text(note: Note) -> str:
    """Return the sentence of a note, without a capital letter and a full stop."""
    sentence = run_notes.SENTENCES.get(note.code) or _of_a_model(note.code)
    text = sentence.format(**note.values) if isinstance(sentence, str) else sentence(note.values)
    return percent_apart(without_powers(text))


def _of_a_model(code: str) -> run_notes.Sentence:
    """Return the sentence of a code of a model; those of a diagnosis need the effects, which take a while to import."""
    from wheelsoil.wording import diagnosis_notes, model_notes

    if code in model_notes.SENTENCES:
        return model_notes.SENTENCES[code]

    return diagnosis_notes.SENTENCES[code]


def step_text(run: NextRun) -> str:
    """Return what to drive or measure next, after the name of the campaign where there are several."""
    return (f"{run.campaign}: " if run.campaign else "") + note_text(run.step)


def odds_text(nats: float) -> str:
    """Return a logarithm of odds as odds: "33 : 1"; beyond 1000 : 1, which decides, only that."""
    if not isfinite(nats):
        return "-"
    return "above 1000 : 1" if nats > log(_DECIDING_ODDS) else f"{number(exp(max(nats, 0.0)), 2)} : 1"


def key_text(run: NextRun) -> str:
    """Return the key of a file under which the result of a step is written; "" where there is none."""
    from wheelsoil.wording.diagnosis_notes import STEP_KEYS

    return STEP_KEYS.get(run.step.code, "")


def naming_text(run: NextRun) -> str:
    """Return the probability of the right name after a step, to 5 %, as few draws give it; "" where it is unknown."""
    if run.naming_chance is None:
        return ""
    percent = 5 * round(20 * run.naming_chance)
    return "below 5 %" if percent < 5 else "above 95 %" if percent > 95 else f"about {percent} %"


def worth_text(run: NextRun) -> str:
    """Return what a step gives (probability of the right name, expected odds) and what it costs."""
    name, nats = naming_text(run), run.expected_log_bayes_factor
    gives = (f"right name {name}" * bool(name), f"expected odds {odds_text(nats)}" * isfinite(nats))
    return ", ".join(filter(None, (*gives, f"costs {run.cost_runs:g} run{'' if run.cost_runs == 1 else 's'}")))


def texts_of(notes: Iterable[Note]) -> list[str]:
    """Return the sentences of notes, each once."""
    return list(dict.fromkeys(map(note_text, notes)))


def runs_by_text(runs: Iterable[tuple[str, Iterable[Note]]]) -> dict[str, list[str]]:
    """Return each sentence with the names of the runs that it is about, in their order."""
    about: dict[str, list[str]] = {}
    for name, notes in runs:
        for text in texts_of(notes):
            about.setdefault(text, []).append(name)
    return about


def noted_of_runs(runs: Sequence[tuple[str, Iterable[Note]]]) -> list[str]:
    """Return each sentence of runs (name, notes) behind the runs that it is about."""
    return [
        f"{'all runs' if len(names) == len(runs) > 1 else ', '.join(names)}: {text}"
        for text, names in runs_by_text(runs).items()
    ]
