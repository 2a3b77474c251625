"""A verdict in a sentence or a few, for people: what it is, how large, how sure, and what to do next.

What a shape of the catch-all is in words that a person can read on their own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import isfinite

from daq import OUTPUTS, ROLES
from model.diagnosis.core.coverage import USUAL
from model.diagnosis.core.naming import Judgement
from model.diagnosis.core.result import (
    Adequacy,
    Cause,
    CauseSet,
    Detectable,
    Finding,
    Gain,
    NextRun,
    ParameterEstimate,
)
from model.diagnosis.findings.agreement import Disagreement
from model.effects.catalogue import EFFECTS

_FIXED = {
    "load, driving": "growing with load, driving",
    "load, braking": "growing with load, braking",
    "load squared": "at loads far from the mean",
    "zero, growing with load": "as a zero that grows with the load, at standstill too",
    "all alike, driving": "the same wherever it drives",
    "all alike, braking": "the same wherever it brakes",
    "direction, driving": "with the sign of the direction (out +, back -), driving",
    "direction, braking": "with the sign of the direction (out +, back -), braking",
    "speeding up, driving": "speeding up (slowing down: the other sign), driving",
    "speeding up, braking": "speeding up (slowing down: the other sign), braking",
    "rising slip, driving": "rising slip (falling: the other sign), driving",
    "rising slip, braking": "rising slip (falling: the other sign), braking",
    "large drawbar pull": "growing with the square of the simulated drawbar pull",
    "large torque": "growing with the square of the simulated torque",
    "drawbar pull over the campaign": "as a share of drawbar pull that grows over the campaign",
    "torque over the campaign": "as a share of torque that grows over the campaign",
}
_RANGES = (
    (re.compile(r"^braking, slip - (\S+) to (\S+)$"), r"braking, slip -\1 to -\2"),
    (re.compile(r"^ground speed (\S+) to (\S+)$"), r"ground speed \1 to \2 m/s"),
    (re.compile(r"^as if misread, ground speed (\S+) to (\S+)$"), r"as if misread, at \1 to \2 m/s"),
    (re.compile(r"^place on the line (\S+) to (\S+)$"), r"place on the line \1 to \2 (of -1 to 1)"),
    (re.compile(r"^(drawbar pull|torque) (\S+ to \S+ kN.*)$"), r"simulated \1 \2"),
)


def shape_words(where: str) -> str:
    """Return the place or the growth that a shape stands for.

    Parameters
    ----------
    where : str
        Label of `model.diagnosis.time_series.basis` behind its channel.
    """
    for pattern, said in _RANGES:
        where = pattern.sub(said, where)
    return _FIXED.get(where, where)


_MOST_EXAMPLES = 3
_WORTH_SAYING = 0.2
_NO_CHANGE = 0.5
"""Percent by which an error may fall or grow and still be said to stay."""
_TOGETHER_AT = 0.1
"""Probability from which on a set of several causes is said."""


def named_words(
    judged: Judgement,
    causes: Sequence[Cause],
    chances: Mapping[str, float],
    gain: Gain | None,
    alike: Sequence[str],
    runs: Sequence[NextRun] = (),
) -> str:
    """Return the sentence of "named".

    Parameters
    ----------
    judged : Judgement
    causes : sequence of Cause
        The named ones.
    chances : mapping family -> probability
    gain : Gain or None
    alike : sequence of str
        Families whose signatures are almost those of the named ones.
    runs : sequence of NextRun
        What would part these from the named ones, best first.
    """
    said = [" and ".join(_cause(cause) for cause in causes)]
    if worth := gain_words(gain):
        said.append(f"On runs left out {worth}")
    if judged.beside:
        said.append(f"Something more is at work: {_one_of(judged.beside, chances)}")
    if alike:
        said.append(
            f"{_listed([plain(f) for f in alike]).capitalize()} would look almost the same in these runs; "
            "that it is not has been weighed, and rests on differences that are small, but beyond the noise"
        )
    if alike and runs:
        said.append(f"To be surer of the name, drive next: {runs[0].change}")
    return _sentences(said)


def one_of_words(
    judged: Judgement,
    chances: Mapping[str, float],
    none: float,
    alike: Sequence[str],
    runs: Sequence[NextRun],
    sets: Sequence[CauseSet] = (),
) -> str:
    """Return the sentence of "one_of"."""
    likely = f"with probability {probability(1.0 - none)}"
    if len(judged.families) == 1:
        family = judged.families[0]
        said = [f"Something is at work ({likely}), most likely {plain(family)} ({probability(chances[family])})"]
        if not judged.barred:
            said.append("That is not sure enough for a name")
    else:
        said = [f"Something is at work ({likely}): {_one_of(judged.families, chances)}"]
    together = [one for one in sets if len(one.causes) > 1 and one.probability >= _TOGETHER_AT]
    if together:
        pairs = [f"{_listed([plain(f) for f in one.causes])} ({probability(one.probability)})" for one in together]
        said.append(f"Several may act together: {'; '.join(pairs)}")
    if judged.barred:
        said.append(f"{plain(judged.families[0]).capitalize()} is not named: {judged.barred}")
    others = [family for family in alike if family not in judged.families]
    if others:
        said.append(f"{_listed([plain(f) for f in others]).capitalize()} would look almost the same")
    if runs:
        said.append(f"Next: {runs[0].change}")
    return _sentences(said)


def unexplained_words(
    judged: Adequacy, left: Sequence[Finding], best: Sequence[str], soils: tuple[Sequence[str], Sequence[str]] | None
) -> str:
    """Return the sentence of "unexplained".

    Parameters
    ----------
    judged : Adequacy
    left : sequence of Finding
        Where the likeliest set leaves something.
    best : sequence of str
        Families of that set.
    soils : two sequences of str, optional
        Runs that ask for one soil, and those that ask for another.
    """
    tried = f", not even {_listed([plain(f) for f in best])}," if best else ""
    said = [
        f"Neither the soil nor any set of causes in the library{tried} explains these runs: the lack of fit "
        f"is {judged.statistic:.2f}, where noise leaves up to {judged.threshold:.2f}"
    ]
    if left:
        said.append(f"It shows in {_findings(left)}")
    if soils:
        one, other = (_listed(runs) for runs in soils)
        said.append(
            f"Runs {one} ask for another soil than {other}: if these are two terrains, diagnose them as two campaigns"
        )
    return _sentences(said)


def nothing_words(
    chances: Mapping[str, float], none: float, sizes: Mapping[str, Detectable], wrong: Sequence[Finding]
) -> str:
    """Return the sentence of "nothing_detectable"; `sizes` by family."""
    said = [f"No cause is seen (none: {probability(none)}): soil and noise explain these runs"]
    likeliest = max(chances, key=lambda family: chances[family], default="")
    if likeliest and chances[likeliest] > _WORTH_SAYING:
        said = [
            f"Nothing is sure enough to be told from chance (none: {probability(none)})",
            f"Most suspicious is {plain(likeliest)} ({probability(chances[likeliest])}): another run would tell",
        ]
    shown = [f"{plain(name)} from {d.parameter} = {_number(d.value)}{_unit(d.unit)} on" for name, d in sizes.items()]
    if shown:
        examples = _listed(shown[:_MOST_EXAMPLES])
        said.append(f"That does not mean there is none: {examples} would be seen in half of such campaigns")
    if wrong:
        said.append(f"What stands out most is {_findings(wrong[:1])}")
    return _sentences(said)


def want_words(cannot_tell: Mapping[str, str]) -> str:
    """Return what cannot be named, for want of what; empty where everything can, but for what is usually wanting."""
    by_reason: dict[str, list[str]] = {}
    for family, why in cannot_tell.items():
        if why not in USUAL:
            by_reason.setdefault(why, []).append(plain(family))
    said = [f"{_listed(families)} ({why})" for why, families in by_reason.items()]
    return f" Cannot be named from these runs: {'; '.join(said)}." if said else ""


def disagreement_words(
    found: Sequence[Disagreement], forms: Mapping[tuple[str, str], tuple[str, float]]
) -> tuple[str, ...]:
    """Return what joint campaigns disagree about, a sentence each; empty where they agree.

    Parameters
    ----------
    found : sequence of Disagreement
    forms : mapping (family, campaign) -> (form, nats)
        Campaigns that prefer another form than all together do.
    """
    said = []
    for one in found:
        own = [f"{o.campaign} {_number(o.value)} +- {_number(o.sigma)}{_unit(one.unit)}" for o in one.own]
        said.append(
            f"The campaigns disagree about {one.parameter}: {', '.join(own)} (Cochran's Q {one.q:.1f} on "
            f"{len(own) - 1}, p {probability(one.chance)}): a shared value is not theirs, diagnose each by itself."
        )
    for (family, campaign), (form, nats) in forms.items():
        said.append(f"{campaign} by itself asks for {plain(family)} as {form} instead ({nats:.1f} nats).")
    return tuple(said)


def plain(name: str) -> str:
    """Return a name as people write it."""
    return name.replace("_", " ")


def probability(p: float) -> str:
    """Return a probability; never 1 or 0, which no data give."""
    return "> .999" if p > 0.9995 else "< .001" if p < 0.0005 else f"{p:.3f}".lstrip("0")


def _cause(cause: Cause) -> str:
    form = f", likeliest as {cause.form} ({probability(cause.form_probability)})" if cause.form else ""
    known = [p for p in cause.parameters if all(map(isfinite, p.interval95))]
    sizes = ", ".join(_estimate(p, EFFECTS[cause.key].spelled(p.name)) for p in known or cause.parameters)
    return f"{plain(cause.name)} is at work (probability {probability(cause.probability)}{form}): {sizes}"


def _estimate(p: ParameterEstimate, name: str) -> str:
    low, high = p.interval95
    known = isfinite(low) and isfinite(high)
    band = f" ({_number(low)} to {_number(high)})" if known else ""
    return f"{name} = {_number(p.value)}{band}{_unit(p.unit)}"


def gain_words(gain: Gain | None) -> str:
    """Return by how much the errors of what was left out fall, without an end; nothing where that is not known."""
    if gain is None or not isfinite(gain.reduction_percent):
        return ""
    low, high = gain.interval95
    first, others = gain.channel, [channel for channel in gain.base if channel != gain.channel]
    falls, size = ("falls", 1.0) if gain.reduction_percent >= 0 else ("grows", -1.0)
    low, high = sorted((size * low, size * high))
    between = f"{low:.0f} to {high:.0f}" if isfinite(low) and isfinite(high) else ""
    stays = abs(gain.reduction_percent) < _NO_CHANGE
    if stays:
        change = f"stays as it is ({between} %)" if between else "stays as it is"
    else:
        change = f"{falls} by {size * gain.reduction_percent:.0f}{f' ({between})' if between else ''} %"
    said = [f"the error of {OUTPUTS[first].name} {change}"]
    for channel in others:
        before, after = gain.base[channel].R0, gain.extended[channel].R0
        if before > 0:
            fell = 100 * (1 - after / before)
            verb = "falls " if fell >= 0 else "grows "
            verb = "" if not stays and (fell >= 0) == (size > 0) else verb
            said.append(f"{'that ' if verb else ''}of {OUTPUTS[channel].name} {verb}by {abs(fell):.0f} %")
    return _listed(said)


def _one_of(families: Sequence[str], chances: Mapping[str, float]) -> str:
    each = [f"{plain(family)} ({probability(chances[family])})" for family in families]
    return each[0] if len(each) == 1 else f"one of {', '.join(each)}"


def _findings(found: Sequence[Finding]) -> str:
    return "; ".join(
        f"{ROLES[f.channel].name}, {f.where}: {f.size:+.3g} {ROLES[f.channel].unit_text} ({abs(f.statistic):.1f} sigma)"
        for f in found[:_MOST_EXAMPLES]
    )


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""


def _number(x: float) -> str:
    return f"{x:.3g}"


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _sentences(said: Sequence[str]) -> str:
    return " ".join(f"{text[0].upper()}{text[1:]}." for text in said if text)
