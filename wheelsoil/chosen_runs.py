"""Which runs of a campaign a choice means, and what of them is used."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from daq.errors import Fault, nearest
from daq.run import Run
from processing.by_hand import Interval
from wheelsoil.choice import Choice, ChosenRun
from wheelsoil.facts import sha256_of


@dataclass(frozen=True)
class RunInUse:
    """A run that is used.

    Attributes
    ----------
    run : Run
    keep : tuple of (from, to) or None
        See `wheelsoil.choice.ChosenRun`.
    warning : str
        What a person should know: it is another recording than the one that the choice was made of.
    """

    run: Run
    keep: tuple[Interval, ...] | None = None
    warning: str = ""


def runs_in_use(choice: Choice, opened: Sequence[Run]) -> tuple[list[RunInUse], list[Fault]]:
    """Return the runs that a choice leaves in use, in their order, and everything of it that does not fit.

    What does not fit: a run that is not there or is listed twice, several that a name could mean, none that is left.
    """
    faults: list[Fault] = []
    chosen: dict[int, ChosenRun] = {}
    for section in choice.runs:
        meant = _meant(section, opened)
        if len(meant) != 1:
            faults.append(_not_one(section, [opened[i] for i in meant], opened, choice.source))
        elif meant[0] in chosen:
            run = opened[meant[0]]
            faults.append(Fault(f"run {run.id!r} is there twice", choice.source, next_step="leave one [[run]] of it"))
        else:
            chosen[meant[0]] = section
    in_use = [
        RunInUse(run, chosen[i].keep, _warning(run, chosen[i], choice.source)) if i in chosen else RunInUse(run)
        for i, run in enumerate(opened)
        if i not in chosen or chosen[i].use
    ]
    if opened and not in_use:
        names = ", ".join(run.id for run in opened)
        faults.append(Fault("every run is switched off", choice.source, names, "one at least", "say use = true of one"))
    return in_use, faults


def _meant(section: ChosenRun, opened: Sequence[Run]) -> list[int]:
    """Return the runs that a section can mean; where campaigns share names, the hash tells them apart."""
    found = [i for i, run in enumerate(opened) if is_called(section, run)]
    if len(found) > 1 and section.sha256:
        return [i for i in found if sha256_of(*opened[i].files) == section.sha256] or found
    return found


def is_called(section: ChosenRun, run: Run) -> bool:
    """Return whether a run bears the section's name; its id may have got a number, see `daq.open.open_runs`."""
    if section.file not in ("", run.path.name):
        return False
    numbered = section.file and re.fullmatch(f"{re.escape(section.id)}-[0-9]+", run.id)
    return section.id in ("", run.id) or bool(numbered)


def _not_one(section: ChosenRun, meant: Sequence[Run], opened: Sequence[Run], where: str) -> Fault:
    name = ", ".join(filter(None, (section.id and f"id {section.id!r}", section.file and f"file {section.file!r}")))
    if meant:
        found = ", ".join(str(run.path) for run in meant)
        return Fault(f"{name} can be several runs", where, found, "one of them", "give its sha256, or one campaign")
    known = ", ".join(f"{run.id} ({run.path.name})" for run in opened)
    near = nearest(section.id or section.file, [run.id if section.id else run.path.name for run in opened])
    return Fault(f"there is no run with {name}", where, known, near, "mend the name, or take this [[run]] out")


def _warning(run: Run, section: ChosenRun, where: str) -> str:
    if not section.sha256 or sha256_of(*run.files) == section.sha256:
        return ""
    return f"{run.path.name} is another recording than the one that {where} was made of; look at it again"
