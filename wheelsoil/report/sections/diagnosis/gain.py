"""What the extension is worth on runs that neither the choice of the cause nor the fit has seen."""

from __future__ import annotations

from collections import Counter

from daq import OUTPUTS
from model.diagnosis import Gain, Scores
from wheelsoil.report.content import Block, Figure, Panels, Section, Table, Text
from wheelsoil.report.figures import Trace, axes
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.words import form_name, interval, listed, number, signed
from wheelsoil.wording.diagnosis_text import NO_GAIN, nothing_chosen, reduction
from wheelsoil.wording.names import effect_name

KEY = "gain"
TITLE = "Gain of the extension"

_NOTE = (
    "Each run was left out once: the cause was chosen, and soil and cause fitted, on the others only. The log "
    "likelihood is that of a run that was left out, in nats; R₀ alone says nothing about whether a model knows how "
    "uncertain it is."
)
_READING = (
    "R₀ of the base simulation is 100 %; the blue bar is what is left of it with the cause in the model, both on runs "
    "left out. A bar that is not shorter than 100 % is no gain, however well the model fits what it has seen."
)


def build(material: ReportInputs) -> Section:
    """Build the section."""
    found = material.diagnosis
    if found.gain is None:
        why = (
            "nothing explains these runs: there is no extension whose gain could be measured."
            if found.verdict == "unexplained"
            else "it takes at least two runs, one of which is left out."
        )
        return Section(KEY, TITLE, [Text(f"No gain could be measured: {why}")], {"gain": None})
    gain = found.gain
    if nothing_chosen(gain):
        return Section(KEY, TITLE, [Text(NO_GAIN), _table(gain)], {"gain": gain})
    blocks: list[Block] = [Text(sentence(gain), "good" if gain.log_likelihood_gain > 0 else "warning"), _table(gain)]
    blocks.append(Panels([_figure(gain)], _READING))
    if gain.chosen:
        blocks.append(Text(_chosen(gain)))
    return Section(KEY, TITLE, blocks, {"gain": gain})


def sentence(gain: Gain) -> str:
    """Return the gain in words."""
    how, low, high = reduction(gain)
    within = interval(low, high)
    spread = "" if within == "–" else f" (95 %: {within} %)"
    nats = signed(gain.log_likelihood_gain, ".1f")
    return (
        f"On runs left out, R₀ of the {OUTPUTS[gain.channel].name} {how} by {abs(gain.reduction_percent):.1f} % with "
        f"the extension{spread}; the log likelihood of what was measured gains {nats} nats."
    )


def _table(gain: Gain) -> Table:
    rows = [
        _row(channel, which, scores[channel], first=i == 0)
        for i, channel in enumerate(gain.base)
        for which, scores in (("base", gain.base), ("extended", gain.extended))
        if channel in scores
    ]
    head = ["model", "R₀", "unit", "M₀ (%)", "R²", "log likelihood of a run"]
    return Table("On runs left out", head, rows, _NOTE)


def _row(channel: str, which: str, scores: Scores, *, first: bool) -> list[str]:
    return [
        f"{OUTPUTS[channel].name}, {which}",
        number(scores.R0, 4),
        OUTPUTS[channel].unit_text,
        number(scores.M0_percent),
        number(scores.R2, 4),
        number(scores.log_likelihood, 5) if first else "",  # of the run, all its channels together
    ]


def _figure(gain: Gain) -> Figure:
    channels = [c for c in gain.base if c in gain.extended and gain.base[c].R0 > 0]
    names = [OUTPUTS[c].name for c in channels]
    shares = [100 * gain.extended[c].R0 / gain.base[c].R0 for c in channels]

    def bar(name: str, values: list[float], colour: str, pattern: str) -> Trace:
        return {
            "type": "bar",
            "orientation": "h",
            "name": name,
            "y": names,
            "x": [round(value, 2) for value in values],
            "marker": {"color": colour, "pattern": {"shape": pattern, "solidity": 0.3}},
        }

    data = [bar("base", [100.0] * len(names), "#bdbdbd", "/"), bar("extended", shares, "#0072B2", "")]
    layout = axes("R₀ on runs left out (% of the base's)", "", height=130 + 60 * len(names), barmode="group")
    layout["yaxis"] |= {"autorange": "reversed", "type": "category"}
    layout["xaxis"] |= {"rangemode": "tozero"}
    return Figure("gain", "What is left of the error", data, layout)


def _chosen(gain: Gain) -> str:
    counts = Counter(gain.chosen)
    said = [
        f"{listed([form_name(effect_name(key)) for key in keys]) if keys else 'no cause'} in {count}"
        for keys, count in counts.most_common()
    ]
    return f"Of {len(gain.chosen)} choices without the run left out: {listed(said)}."
