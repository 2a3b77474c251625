"""Whether the transducer can be trusted: a sentence for each of its channels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from daq import OUTPUTS, ROLES, TRANSDUCER_ROLES, Use, number
from model.diagnosis import Detectable, Diagnosis
from model.effects import EFFECTS, parted
from wheelsoil.wording.grounds_text import OPEN_AT, chances_of, detectable_by_family
from wheelsoil.wording.mending import PROBABLE, doubted_channel
from wheelsoil.wording.names import listed, page_unit, plain_name, upper, with_chance
from wheelsoil.wording.verdict import groups_of_runs, runs_apart, several_terrains, size_text


def transducer_words(found: Diagnosis, faults: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """Return for each channel of the transducer whether the runs show an error of it, and what they cannot show.

    `faults` are those of the sensor by role, in words: samples that are not used.
    """
    if groups_of_runs(found) or several_terrains(found) is not None or found.grounds.undecided is not None:
        return ["The transducer is not judged: nothing else is decided of these runs."]
    used = {OUTPUTS[channel].role for data in found.plot_data for channel in data.base}
    roles = [role for role in TRANSDUCER_ROLES if ROLES[role].use is Use.INPUT or role in used]
    texts_by_role = {role: [*_of_channel(found, role), *(faults or {}).get(role, ())] for role in roles}
    return [f"{upper(ROLES[role].name)}: {'; '.join(texts)}." for role, texts in texts_by_role.items()]


def _of_channel(found: Diagnosis, role: str) -> Iterator[str]:
    """Yield what a diagnosis finds of a channel, and then what it cannot see."""
    own = {effect.name for effect in EFFECTS.values() if effect.kind == "measurement" and effect.shows == (role,)}
    chances = {name: p for name, p in chances_of(found).items() if parted(name)[0] in own}
    stated = {cause.name: cause for cause in found.causes if cause.name in chances}
    if found.verdict == "unexplained":
        off = doubted_channel(found) == role
        yield "do not use it: nothing known explains what it reads" if off else "not judged: the runs are not explained"
        return
    for run, note in runs_apart(found).items():
        if OUTPUTS[note.values["channel"]].role == role:
            yield f"in {run} it is {number(note.values['size'], 3)} {page_unit(note.values['channel'])[1]} off"
    named = stated if found.verdict == "named" else {}
    if named:
        sizes = [f"{plain_name(name)}, {size_text(cause)}" for name, cause in named.items()]
        yield f"not as it is read: {listed(sizes)}"
    chances |= {name: cause.probability for name, cause in stated.items()}
    doubtful = {name: p for name, p in chances.items() if name not in named and (name in stated or p > PROBABLE)}
    if doubtful:
        yield f"not known: {listed([with_chance(name, p) for name, p in doubtful.items()], 'or')} may act"
    elif not named:
        yield "no error is found"
    shown = {name: size for name, size in detectable_by_family(found).items() if parted(name)[0] in own}
    weighed = [name for name in (*chances, *found.not_identifiable) if parted(name)[0] in own]
    hidden = [name for name in dict.fromkeys(weighed) if name in found.not_identifiable or name not in shown]
    suspected = {*named, *doubtful}
    hidden = [name for name in hidden if name not in suspected]
    seen = [f"{plain_name(n)} from {_size(d)} on" for n, d in shown.items() if n not in hidden and n not in suspected]
    if seen:
        yield f"{listed(seen)} would show"
    if hidden:
        rows = "rows" if found.grounds.table_channels else "runs"
        yield f"these {rows} do not show {listed([plain_name(name) for name in hidden])}"
    if open_ones := [with_chance(n, p) for n, p in chances.items() if p >= OPEN_AT and n not in (*suspected, *hidden)]:
        yield f"not excluded: {listed(open_ones)}"


def _size(least: Detectable) -> str:
    share = least.unit == "1"
    return f"{number(abs(least.value) * (100 if share else 1), 2)} {'%' if share else least.unit}"
