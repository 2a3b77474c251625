"""The evidence for the cause: what is left without and with it, its signature, and its gain on held-out runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from daq import OUTPUTS, FloatArray
from model.diagnosis import Diagnosis, Gain, PlotData
from wheelsoil.report.content import Block, Contents, Figure, Panels, Table, Text, grouped, section
from wheelsoil.report.figures import (
    MEASURED,
    RECOMMENDED,
    STYLES,
    Bins,
    Style,
    Trace,
    axes,
    bars,
    by_slip_or_each,
    dots,
    form_name,
    line,
    marked_line,
    parted_at_zero,
    repeated,
    set_axis_range,
    thinned_rows,
)
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.diagnosis_text import NO_GAIN, gain_text, nothing_chosen, score_rows
from wheelsoil.wording.names import effect_name, family_of, listed
from wheelsoil.wording.numbers import number

_MEMBERS = 4
_LOOKS = ("vasilev", "wong", "lyasko", "ding")
_SOLID = Style("after", "#0072B2", "solid", "square-open")
_AFTER = (
    "both lines are measured − predicted, as medians in bins of slip: the broken one before the cause is added, the "
    "solid one after. A cause that is right takes the line to zero everywhere. Double-click shows braking."
)
_SHAPES = (
    "black is what is left without the cause; coloured is what each candidate changes at its estimated size, with the "
    "soil fitted anew. The right one follows the black line; candidates that lie on each other look alike."
)
_DIAGONAL = (
    "each dot is a sample, in sigmas of the noise (σ): across, what the cause says is missing there; up, what is "
    "missing. If the cause is right, the dots lie about the broken line; a level cloud says that it has nothing to do "
    "with it."
)

_GAIN_NOTE = (
    "Each run was held out once: the cause was chosen, and soil and cause fitted, on the others; the noise model "
    "knows all. The log likelihood is that of a held-out run, in nats; R₀ alone says nothing about whether a model "
    "knows how uncertain it is."
)
_GAIN_READING = (
    "R₀ of Wong's model with calibrated soil is 100 %; the blue bar is what is left of it with the causes, both on "
    "held-out runs. A bar that is not shorter than 100 % is no gain, however well the model fits what it has seen."
)


@dataclass(frozen=True)
class _Shown:
    """One channel of one campaign, N, N m or m: left before and after, noise sigma, the candidates' signatures."""

    campaign: str
    slip: FloatArray
    before: FloatArray
    after: FloatArray
    sigma: FloatArray
    signatures: dict[str, FloatArray]
    summary: Callable[[FloatArray, FloatArray], Bins]
    """Of samples in bins of slip, or of rows at each slip."""


@section("evidence", "Signatures of the causes")
def evidence(inputs: ReportInputs) -> Contents:
    """Build the section; without a named cause or a set there is nothing to show evidence for, and it says so."""
    found = inputs.diagnosis
    # The effects to show: the causes and what would fit almost as well, as far as signatures are known.
    known = dict.fromkeys(key for seen in found.plot_data for key in seen.signatures)
    causes = [key for key in dict.fromkeys(cause.key for cause in found.causes) if key in known]
    rivals = [key for key in known if family_of(key) in found.grounds.confounded and key not in causes]
    keys = [*causes, *(rivals if causes else [])][:_MEMBERS]
    if not keys:
        return [Text(_nothing(found))], {"members": []}
    kinds = [(_shapes, _SHAPES), (_diagonal, _DIAGONAL)]
    if found.verdict == "named":
        kinds.insert(0, (_pair, _AFTER))
    summary = repeated if inputs.tables else by_slip_or_each
    shown = {channel: _of_channel(found.plot_data, channel, keys, summary) for channel in OUTPUTS}
    shown = {channel: views for channel, views in shown.items() if views}
    blocks: list[Block] = [Text(f"Shown: {listed([form_name(effect_name(key)) for key in keys])}.")]
    for draw, reading in kinds:
        figures = [draw(channel, views) for channel, views in shown.items()]
        blocks.append(Panels(figures, reading, [seen.campaign for seen in found.plot_data]))
    numbers = {channel: {view.campaign: _numbers(view) for view in views} for channel, views in shown.items()}
    return blocks, {"members": keys, **numbers}


def _of_channel(
    everything: tuple[PlotData, ...], channel: str, keys: list[str], summary: Callable[[FloatArray, FloatArray], Bins]
) -> list[_Shown]:
    return [
        _Shown(
            seen.campaign,
            seen.slip,
            seen.measured[channel] - seen.base[channel],
            seen.measured[channel] - seen.extended[channel],
            seen.base_sigma[channel],
            {key: seen.signatures[key][channel] for key in keys if channel in seen.signatures.get(key, {})},
            summary,
        )
        for seen in everything
        if channel in seen.base
    ]


def _numbers(view: _Shown) -> dict[str, Bins]:
    curves = {"before": view.before, "after": view.after, **view.signatures}
    return {name: view.summary(view.slip, values) for name, values in curves.items()}


def _nothing(found: Diagnosis) -> str:
    if found.verdict == "nothing_detectable":
        return "No cause is sure, so that there is none to show evidence for; see the minimum detectable effect."
    if found.verdict == "unexplained":
        return "No cause of the library explains what is left; its shape is drawn under “What is wrong, and where”."
    return "The diagnosis gave no signatures to draw."


def _curve(view: _Shown, values: FloatArray) -> Bins:
    return parted_at_zero(view.summary(view.slip, values))


def _pair(channel: str, views: list[_Shown]) -> Figure:
    """Draw what is left before and after."""
    groups = {}
    for view in views:
        before, after = _curve(view, view.before), _curve(view, view.after)
        groups[view.campaign] = [
            marked_line(before.centre, before.median, "before", STYLES["wong"]),
            marked_line(after.centre, after.median, "after", _SOLID),
        ]
    return _driven(_figure("after", channel, "before and after", groups))


def _shapes(channel: str, views: list[_Shown]) -> Figure:
    """Draw what is left and the signatures against slip."""
    groups = {}
    for view in views:
        left = _curve(view, view.before)
        traces = [line(left.centre, left.median, "what is left", MEASURED, "solid", 2.6)]
        for look, (key, values) in zip(_LOOKS, view.signatures.items(), strict=False):
            curve = _curve(view, values)
            traces.append(marked_line(curve.centre, curve.median, form_name(effect_name(key)), STYLES[look]))
        groups[view.campaign] = traces
    return _driven(_figure("shapes", channel, "signatures", groups))


def _diagonal(channel: str, views: list[_Shown]) -> Figure:
    """Draw what is left against the most probable cause's signature, and the line on which they are equal."""
    groups = {}
    for view in views:
        key, values = next(iter(view.signatures.items()), ("", np.zeros(0)))
        if not np.isfinite(values).any():
            continue
        across, up = values / view.sigma, view.before / view.sigma
        rows = thinned_rows(across, up, cells=40, per_cell=1)
        ends = np.array([np.nanmin(across), np.nanmax(across)])
        groups[view.campaign] = [
            dots(across[rows], up[rows], f"samples, {effect_name(key)}"),
            line(ends, ends, "equal", RECOMMENDED, "dash"),
        ]
    figure = _figure("diagonal", channel, "left-over against signature", groups)
    return replace(figure, layout=axes("what the cause changes (σ)", "measured − predicted (σ)", height=340))


def _driven(figure: Figure) -> Figure:
    """Let the axes hold what was driven; braking, which is steep in slip and so noisy, is a double-click away."""
    layout = dict(figure.layout)
    points = [(x, y) for trace in figure.data for x, y in zip(trace["x"], trace["y"], strict=True) if y is not None]
    seen = np.array([y for x, y in points if x > 0], float)
    set_axis_range(layout, "x", np.array([0.0, 1.0]), margin=0.02)
    set_axis_range(layout, "y", np.append(seen, 0.0) if len(seen) else seen, margin=0.12)
    return replace(figure, layout=layout)


def _figure(kind: str, channel: str, what: str, traces: dict[str, list[Trace]]) -> Figure:
    layout = axes("slip", f"measured − predicted ({OUTPUTS[channel].unit_text})", height=340)
    title = f"{OUTPUTS[channel].name.capitalize()}: {what}"
    return grouped(f"evidence-{kind}-{channel}", title, traces.items(), layout)


@section("gain", "Gain of the extension")
def gain(inputs: ReportInputs) -> Contents:
    """Build the section."""
    found = inputs.diagnosis
    if found.gain is None:
        why = (
            "nothing explains these runs: there is no extension whose gain could be measured."
            if found.verdict == "unexplained"
            else "it takes at least two runs, one of which is held out."
        )
        return [Text(f"No gain could be measured: {why}")], {"gain": None}
    gain = found.gain
    if nothing_chosen(gain):
        return [Text(NO_GAIN), _gain_table(gain, found.verdict)], {"gain": gain}
    blocks: list[Block] = [
        Text(gain_text(found).replace("R0", "R₀"), "good" if gain.log_likelihood_gain > 0 else "warning"),
        _gain_table(gain, found.verdict),
        Panels([_gain_figure(gain)], _GAIN_READING),
        *([Text(_choices(gain))] if gain.chosen else []),
    ]
    return blocks, {"gain": gain}


def _gain_table(gain: Gain, verdict: str) -> Table:
    head = ["model", "R₀", "unit", "M₀ (%)", "R²", "log likelihood of a run"]
    return Table("On held-out runs", head, score_rows(gain, number, verdict), _GAIN_NOTE, words=("unit",))


def _gain_figure(gain: Gain) -> Figure:
    channels = [c for c in gain.base if c in gain.extended and gain.base[c].R0 > 0]
    names = [OUTPUTS[c].name for c in channels]
    shares = [100 * gain.extended[c].R0 / gain.base[c].R0 for c in channels]

    data = [
        bars(names, [100.0] * len(names), "calibrated soil", "#bdbdbd", "/"),
        bars(names, [round(share, 2) for share in shares], "with the causes", "#0072B2", ""),
    ]
    layout = axes("held-out R₀ (% of calibrated soil's)", "", height=130 + 60 * len(names), grouped=True)
    layout["yaxis"] |= {"order": names}
    layout["xaxis"] |= {"zero": True}
    return Figure("gain", "What is left of the error", data, layout)


def _choices(gain: Gain) -> str:
    counts = Counter(gain.chosen)
    choices = [
        f"{listed([form_name(effect_name(key)) for key in keys]) if keys else 'no cause'} in {count}"
        for keys, count in counts.most_common()
    ]
    return f"Of {len(gain.chosen)} choices without the held-out run: {listed(choices)}."
