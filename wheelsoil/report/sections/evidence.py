"""The evidence: what is left before and after the cause is added, and the cause's signature against what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.diagnosis.result import Diagnosis, Seen
from wheelsoil.diagnosis_words import CHANNEL_NAMES, CHANNEL_UNITS, effect_name
from wheelsoil.report.content import Block, Figure, Panels, Section, Text
from wheelsoil.report.figures import MEASURED, STYLES, Style, Trace, axes, dots, line, marked_line
from wheelsoil.report.material import FloatArray, Material
from wheelsoil.report.sections.against_slip import EDGES
from wheelsoil.report.thinning import Bins, binned, thinned_rows
from wheelsoil.report.words import listed

KEY = "evidence"
TITLE = "Evidence"

_MEMBERS = 4
_LOOKS = ("vasilev", "wong", "lyasko", "ding")
_SOLID = Style("after", "#0072B2", "solid", "square-open")
_AFTER = (
    "both lines are measured less simulated, as medians in bins of slip: the broken one before the cause is added, the "
    "solid one after. A cause that is right takes the line to zero everywhere, not only on average."
)
_SHAPES = (
    "black is what is left without the cause; coloured is what each candidate changes at its estimated size, less what "
    "the soil can imitate. The right one follows the black line; candidates that lie on each other look alike."
)
_DIAGONAL = (
    "each dot is a sample: across, what the cause says is missing there; up, what is missing. If the cause is right, "
    "the dots lie about the line at 45 degrees; a level cloud says that the cause has nothing to do with it."
)


@dataclass(frozen=True)
class _Shown:
    """One channel of one campaign: what is left before and after, and the candidates' signatures, N, N m or m."""

    campaign: str
    slip: FloatArray
    before: FloatArray
    after: FloatArray
    signatures: dict[str, FloatArray]


def build(material: Material) -> Section:
    """Build the section; without a named cause or a set there is nothing to show evidence for, and it says so."""
    found = material.diagnosis
    keys = _members(found)
    if not keys:
        return Section(KEY, TITLE, [Text(_nothing(found))], {"members": []})
    kinds = [(_shapes, _SHAPES), (_diagonal, _DIAGONAL)]
    if found.verdict == "named":
        kinds.insert(0, (_pair, _AFTER))
    shown = {channel: _of_channel(found.seen, channel, keys) for channel in CHANNEL_NAMES}
    shown = {channel: views for channel, views in shown.items() if views}
    blocks: list[Block] = [Text(f"Shown: {listed([effect_name(key) for key in keys])}.")]
    for draw, reading in kinds:
        figures = [draw(channel, views) for channel, views in shown.items()]
        blocks.append(Panels(figures, reading, [seen.campaign for seen in found.seen]))
    numbers = {channel: {view.campaign: _numbers(view) for view in views} for channel, views in shown.items()}
    return Section(KEY, TITLE, blocks, {"members": keys, **numbers})


def _of_channel(everything: tuple[Seen, ...], channel: str, keys: list[str]) -> list[_Shown]:
    return [
        _Shown(
            seen.campaign,
            seen.slip,
            seen.measured[channel] - seen.base[channel],
            seen.measured[channel] - seen.extended[channel],
            {key: seen.signatures[key][channel] for key in keys if channel in seen.signatures.get(key, {})},
        )
        for seen in everything
        if channel in seen.base
    ]


def _numbers(view: _Shown) -> dict[str, Bins]:
    curves = {"before": view.before, "after": view.after, **view.signatures}
    return {name: binned(view.slip, values, EDGES) for name, values in curves.items()}


def _members(found: Diagnosis) -> list[str]:
    """Return the effects to show: the causes, as far as their signatures are known."""
    known = {key for seen in found.seen for key in seen.signatures}
    return [key for key in dict.fromkeys(cause.key for cause in found.causes) if key in known][:_MEMBERS]


def _nothing(found: Diagnosis) -> str:
    if found.verdict == "nothing_detectable":
        return "No cause can be seen, so there is nothing to show evidence for; see what could have been seen."
    if found.verdict == "unexplained":
        return "No cause of the library explains what is left; its shape is drawn under “What is wrong, and where”."
    return "The diagnosis gave no signatures to draw."


def _pair(channel: str, views: list[_Shown]) -> Figure:
    """Draw what is left before and after."""
    groups = {}
    for view in views:
        before, after = binned(view.slip, view.before, EDGES), binned(view.slip, view.after, EDGES)
        groups[view.campaign] = [
            marked_line(before.centre, before.median, "before", STYLES["wong"]),
            marked_line(after.centre, after.median, "after", _SOLID),
        ]
    return _figure("after", channel, "before and after", "slip", groups)


def _shapes(channel: str, views: list[_Shown]) -> Figure:
    """Draw what is left and the signatures against slip."""
    groups = {}
    for view in views:
        left = binned(view.slip, view.before, EDGES)
        traces = [line(left.centre, left.median, "what is left", MEASURED, "solid", 2.6)]
        for look, (key, values) in zip(_LOOKS, view.signatures.items(), strict=False):
            curve = binned(view.slip, values, EDGES)
            traces.append(marked_line(curve.centre, curve.median, effect_name(key), STYLES[look]))
        groups[view.campaign] = traces
    return _figure("shapes", channel, "signatures", "slip", groups)


def _diagonal(channel: str, views: list[_Shown]) -> Figure:
    """Draw what is left against the likeliest cause's signature, and the line on which they are equal."""
    groups = {}
    for view in views:
        key, values = next(iter(view.signatures.items()), ("", np.zeros(0)))
        if not np.isfinite(values).any():
            continue
        rows = thinned_rows(values, view.before, cells=40, per_cell=1)
        ends = np.array([np.nanmin(values), np.nanmax(values)])
        groups[view.campaign] = [
            dots(values[rows], view.before[rows], f"samples, {effect_name(key)}"),
            line(ends, ends, "equal", STYLES["vasilev"].colour, "dash"),
        ]
    across = f"what the cause changes ({CHANNEL_UNITS[channel]})"
    return _figure("diagonal", channel, "left-over against signature", across, groups)


def _figure(kind: str, channel: str, what: str, across: str, traces: dict[str, list[Trace]]) -> Figure:
    layout = axes(across, f"measured − simulated ({CHANNEL_UNITS[channel]})", height=340)
    return Figure(
        f"evidence-{kind}-{channel}",
        f"{CHANNEL_NAMES[channel].capitalize()}: {what}",
        [trace for group in traces.values() for trace in group],
        layout,
        [campaign for campaign, group in traces.items() for _ in group],
    )
