"""Page of a vehicle with several instrumented wheels: a verdict of each with its report, and the vehicle in numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import isfinite
from urllib.parse import quote

import numpy as np

from daq import DataError, Fault, FloatArray, VehicleConfig
from model.diagnosis import Diagnosis
from model.effects import parted
from processing import SLIP_ROLES
from wheelsoil.report.build import Head, Report
from wheelsoil.report.cause_figure import driven_slips
from wheelsoil.report.content import MOST_STEPS, Block, Drawing, Links, Pair, Section, Steps, Table, Text, Tile, Tiles
from wheelsoil.report.drawing import Curve, Plane, beyond, drawn, reach
from wheelsoil.report.figures import Binning, by_slip, matched
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.wording.figures import figure_interval, figure_value
from wheelsoil.wording.grounds_text import unsure_words, want_words
from wheelsoil.wording.mending import Step, next_steps, step_of
from wheelsoil.wording.names import listed, plain_name, upper
from wheelsoil.wording.verdict import details_of, headline_of, not_corrected, sentence_of, several_terrains
from wheelsoil.workflows.key_figures import KeyFigure
from wheelsoil.workflows.report import WheelReport
from wheelsoil.workflows.vehicle import AT, Vehicle, figures_of_vehicle, place_of, vehicle_of

_NAMES = {
    f"pull_{AT}": "Sum of drawbar pulls, mean slip 0.2",
    f"drawbar_coefficient_{AT}": "Drawbar coefficient, mean slip 0.2",
    f"tractive_efficiency_{AT}": "Tractive efficiency, mean slip 0.2",
    "drawbar_coefficient": "Highest drawbar coefficient",
    "tractive_efficiency": "Highest tractive efficiency",
    "transfer_by_acceleration": "Load transfer to the rear, by acceleration",
    "transfer_by_pull": "Load transfer to the rear, by pull",
    "slip_left_right": "Slip, left − right",
    "slip_front_rear": "Slip, front − rear",
}
"""Titles of the vehicle's figures, in the order in which they are shown."""
_COLUMNS = {
    "slip": "slip",
    "pull": "drawbar pull (N)",
    "load": "load (N)",
    "drawbar_coefficient": "Dp/W",
    "tractive_efficiency": "efficiency",
}
_MADE_OF = {
    "pull": ("drawbar_pull", *SLIP_ROLES),
    "drawbar_coefficient": ("drawbar_pull", "vertical_load", *SLIP_ROLES),
    "tractive_efficiency": ("drawbar_pull", "driving_torque", *SLIP_ROLES),
}
"""What each is measured by, at a slip."""
_LOOKS = ("model", "base", "alt", "second")
_PAIRED, _HERO, _ALONE = (560, 320, 100), (720, 440, 40), (1060, 320, 40)
_BINS, _LEAST, _MIDDLE, _LEAST_SCALE = 16, 3, (0.5, 99.5), np.array([-0.02, 0.02])
_VERDICTS = ("named", "one_of", "unexplained", "nothing_detectable", "")
_POINTS = "Points: median and middle half."
_READING_SLIP = (
    "A difference that stays at all slips may be one of rolling radius: 1 % of it is 0.01 of slip at small slip. In a "
    "curve the outer wheel turns faster: compare straight driving."
)
_READING_TRANSFER = (
    "Means over 1 s, the mean of each run taken off, because added loads differ. The transfer by acceleration, below, "
    "is at one pull, that by pull at one acceleration. By acceleration a rigid vehicle has mass × height of the centre "
    "of gravity / wheelbase; of it this is the share of the instrumented wheels."
)


def build_vehicle_report(
    wheels: Sequence[WheelReport], joint: Diagnosis | None = None, doubts: Sequence[Fault] = ()
) -> Report:
    """Build the page of a vehicle from the reports of its wheels, of which at least one was made.

    `joint` is of all wheels with one soil; `doubts` (`wheelsoil.workflows.vehicle.doubts_of_wheels`) come before all
    else.
    """
    there = [(wheel, report) for wheel in wheels if (report := wheel.report) is not None]
    given, first = [wheel for wheel, _ in there], there[0][1].head
    omitted: dict[str, str] = {}
    vehicle, figures = None, dict[str, KeyFigure]()
    try:
        vehicle = vehicle_of({wheel.wheel: wheel.processed for wheel in given})
        figures = figures_of_vehicle(vehicle)
    except DataError as error:
        omitted["vehicle"] = error.what
    glance = _summary(wheels, vehicle, figures, joint, doubts, omitted.get("vehicle", ""))
    found = [wheel for wheel in given if not wheel.diagnosed.why_not]
    wanting: list[Block] = [Text(of.text) for of in (want_words(joint) if joint else ())]
    level, sign = ("good", "✓") if len(found) == len(wheels) and not doubts else ("fair", "▲")
    return Report(
        head=Head(
            first.title,
            f"{given[0].processed[0][0].vehicle.vehicle.name}, wheels {listed([wheel.wheel for wheel in wheels])}",
            [fact for fact in first.facts if not fact[0]],
            (
                level,
                f"{sign} {len(found)} of {len(wheels)} wheels diagnosed{f', {len(doubts)} to check' if doubts else ''}",
            ),
        ),
        sections=(
            glance,
            _wheels(given, figures),
            *(build(vehicle, figures) for build in (_against_slip, _transfer, _sides) if vehicle),
            *([Section("not_identifiable", "Not identifiable", wanting)] if wanting else []),
        ),
        left_out=omitted,
        made_at=datetime.now(UTC),
        failed=tuple(dict.fromkeys(part for _, report in there for part in report.failed)),
        wheels=tuple(
            {
                "wheel": wheel.wheel,
                "report": wheel.page or None,
                "numbers": wheel.page.rpartition(".")[0] + ".json" if wheel.page else None,
                "verdict": wheel.diagnosed.diagnosis.verdict if wheel.diagnosed.diagnosis else None,
                "headline": line_of(wheel),
                "failed": wheel.report.failed if wheel.report else (),
            }
            for wheel in wheels
        ),
    )


def line_of(wheel: WheelReport) -> str:
    """Return the verdict of a wheel in one line, or why there is none."""
    if wheel.report is None:
        return f"No report: {wheel.why}."
    why_not, shown = wheel.diagnosed.why_not, wheel.report.sections[0].numbers
    without = f" Without {wheel.report.not_fitted}: a signal is missing." if wheel.report.not_fitted else ""
    return f"Not diagnosed: {why_not}." if why_not else f"{shown['headline']}{without}"


def vehicle_lines(report: Report) -> list[tuple[str, str]]:
    """Return the vehicle's numbers for a terminal: name and value with its 95 % interval."""
    figures: Mapping[str, KeyFigure] = report.sections[0].numbers["key_figures"]
    wheels = listed([entry["wheel"] for entry in report.wheels if entry["report"]])
    lines = [
        (name, _with_interval(figure))
        for key, name in _NAMES.items()
        if (figure := figures.get(f"vehicle.{key}")) is not None
    ]
    return [("Of the instrumented wheels", wheels), *lines]


def _with_interval(figure: KeyFigure) -> str:
    value = f"{figure_value(figure)} {figure.unit}".rstrip()
    return f"{value} ({figure_interval(figure)})" if isfinite(figure.interval95[0]) else value


def verdict_of_all(joint: Diagnosis | None, wheels: Sequence[WheelReport]) -> tuple[str, list[str]]:
    """Return the headline and further sentences.

    The joint diagnosis of all wheels gives them, where there is one; else the wheels' own findings side by side.
    """
    found = {wheel.wheel: wheel.diagnosed.diagnosis for wheel in wheels}
    if joint is not None:
        apart = [name for name, own in found.items() if own and _verdict_at(name, own) != _verdict_at(name, joint)]
        by_itself = f"Another verdict alone: {listed(apart)}; all together know more, so this page holds."
        return headline_of(joint), [
            "All wheels together, on one soil.",
            *details_of(joint),
            *([by_itself] if apart else []),
        ]
    findings = dict.fromkeys(
        map(_finding, sorted(found.values(), key=lambda each: _VERDICTS.index(each.verdict if each else "")))
    )
    parts = [
        f"{listed([name for name, each in found.items() if _finding(each) == finding])}: {finding}"
        for finding in findings
    ]
    return f"{'; '.join(parts)}.", []


def _verdict_at(wheel: str, found: Diagnosis) -> tuple[str, frozenset[str]]:
    """Return the verdict at a wheel and the families that it is of; no cause is detected where they act elsewhere."""
    causes = frozenset(family for family, at in (parted(cause.name) for cause in found.causes) if at in ("", wheel))
    return found.verdict if causes or not found.causes else "nothing_detectable", causes


def _finding(found: Diagnosis | None) -> str:
    """Return the verdict of a wheel in a few words."""
    if found is None or found.grounds.undecided is not None:
        return "not diagnosed" if found is None else "nothing can be decided"
    if several_terrains(found) is not None:
        return "runs probably not of one soil"
    causes = [plain_name(cause.name) for cause in found.causes]
    return {
        "named": listed(causes),
        "one_of": listed(causes, "or") if len(causes) > 1 else f"most probably {listed(causes)}",
        "unexplained": "no known cause explains the data",
        "nothing_detectable": "no cause is sure" if unsure_words(found) else "no cause is detected",
    }[found.verdict]


def _summary(
    wheels: Sequence[WheelReport],
    vehicle: Vehicle | None,
    figures: Mapping[str, KeyFigure],
    joint: Diagnosis | None,
    doubts: Sequence[Fault],
    why: str,
) -> Section:
    """Return the first screen: verdict, three numbers, sum of pulls against slip, and a line for each wheel."""
    headline, details = verdict_of_all(joint, wheels)
    steps = _steps(joint, wheels, doubts)
    tiles = Tiles([_tile(f"{name}_{AT}", figures, not_corrected(joint, *of)) for name, of in _MADE_OF.items()])
    drawing: Block = Text(f"No sums: {why or 'the drawbar pull was not measured at every wheel'}.", "missing")
    if vehicle and np.isfinite(vehicle.pull_n).any():
        details = [
            *details,
            f"Sums are of the instrumented wheels {listed(list(vehicle.places))}, where the samples of all are used "
            f"({100 * vehicle.share:.1f} % of those used at any); loads as driven.",
        ]
        drawing = _against(
            "hero",
            "Sum of drawbar pulls against mean slip",
            vehicle.mean_slip,
            vehicle.pull_n,
            "Sum of drawbar pulls (N)",
            size=_HERO,
        )
    numbers = {
        "headline": headline,
        "sentence": sentence_of(joint) if joint else headline,
        "steps": steps,
        "doubts": doubts,
        "together": diagnosis_json(joint) if joint else None,
        "key_figures": figures,
        "share_used_at_all_wheels": vehicle.share if vehicle else None,
        "runs": vehicle.runs if vehicle else (),
    }
    return Section(
        "glance",
        "Summary",
        [
            Text(headline, "verdict"),
            Text(" ".join(details), "lead"),
            tiles,
            drawing,
            *([Steps(steps, _again(wheels))] if steps else []),
            Links("Each wheel by itself", [(each.wheel, line_of(each), quote(each.page)) for each in wheels]),
        ],
        numbers,
    )


def _steps(joint: Diagnosis | None, wheels: Sequence[WheelReport], doubts: Sequence[Fault]) -> list[Step]:
    """Return every doubt to remove, then the next steps of all wheels together, each with the lines of its wheel."""
    steps = [Step(f"{upper(doubt.next_step)}.", f"{upper(doubt.what)}; expected {doubt.expected}.") for doubt in doubts]
    if joint is not None:
        configs = {wheel.wheel: wheel.processed[0][0].vehicle for wheel in wheels if wheel.processed}
        steps += next_steps(joint, next(iter(configs.values()), VehicleConfig()), configs) or [step_of(joint)]
    return steps[: max(MOST_STEPS, len(doubts))]


def _again(wheels: Sequence[WheelReport]) -> str:
    """Return which runs to drive again by the wheels' own reports; without names where all say the same."""
    cards = {
        wheel.wheel: block.again_elsewhere
        for wheel in wheels
        if wheel.report
        for block in wheel.report.sections[0].blocks
        if isinstance(block, Steps)
    }
    texts = list(dict.fromkeys(cards.values()))
    if len(texts) == 1:
        return texts[0]
    return " ".join(f"{listed([name for name, own in cards.items() if own == text])}: {text}" for text in texts)


def _tile(key: str, figures: Mapping[str, KeyFigure], caution: str = "") -> Tile:
    """Return the tile of one of `_NAMES`, with a caution below."""
    title, figure = _NAMES[key], figures.get(f"vehicle.{key}")
    if figure is None:
        return Tile(title, "–", "", "not measured at every wheel, or not known from these samples")
    value, unit = figure_value(figure).removesuffix(" %"), "%" if figure.digits == "percent" else figure.unit
    note = f"95 % interval {figure_interval(figure)}" if isfinite(figure.interval95[0]) else ""
    return Tile(title, value, unit, "; ".join(filter(None, (note, caution))), keys=(None, figure))


def _against(
    key: str,
    title: str,
    slip: FloatArray,
    values: FloatArray,
    y_title: str,
    *,
    x_title: str = "Mean slip ratio",
    scale: tuple[float, float] | None = None,
    beside: Sequence[Curve] = (),
    size: tuple[int, int, int] = _PAIRED,
    reading: str = "",
) -> Drawing:
    """Return values of the driven samples against slip: density, medians, and other curves."""
    driven = (slip > 0) & np.isfinite(values)
    samples = slip[driven], values[driven]
    found = by_slip(*samples)
    plane = Plane(driven_slips(slip), scale or reach(found.lower, found.upper), x_title, y_title)
    points = Curve("", found.centre, found.median, "measured", found.lower, found.upper, points=True)
    caption = f"Driving, loads as driven. Grey: samples{beyond(samples, plane)}. {_POINTS}"
    return drawn(key, title, caption, plane, [*beside, points], samples=samples, reading=reading, wide=size)


def _wheels(given: Sequence[WheelReport], figures: Mapping[str, KeyFigure]) -> Section:
    """Return the pull of each wheel against its slip, with one scale, and what each does at mean slip 0.2 of all."""
    runs = {wheel.wheel: [(run, run.used & (run.slip > 0)) for _, run in wheel.processed] for wheel in given}
    pooled = {
        wheel: [np.concatenate([run.column(name)[rows] for run, rows in each]) for name in ("slip", "drawbar_pull_n")]
        for wheel, each in runs.items()
    }
    slip, pull = (np.concatenate(values) for values in zip(*pooled.values(), strict=True))
    of_all, known = by_slip(slip, pull), pull[np.isfinite(pull)]
    scale = reach(np.percentile(known, _MIDDLE) if len(known) else known)
    drawings = [
        _against(
            f"pull-{wheel.wheel}",
            f"{wheel.wheel}, {place_of(wheel.processed[0][0].vehicle).name}: drawbar pull",
            pooled[wheel.wheel][0],
            pooled[wheel.wheel][1],
            "Drawbar pull (N)",
            x_title="Slip ratio of the wheel",
            scale=scale,
            beside=[Curve("all wheels", of_all.centre, of_all.median, "base", note="median")],
        )
        for wheel in given
    ]
    names = {wheel.wheel: f"wheel.{wheel.wheel}" for wheel in given} | {"all": "vehicle"}
    table = Table(
        "At mean slip 0.2",
        ["wheel", *_COLUMNS.values()],
        [[name, *(figures.get(f"{of}.{key}_{AT}", "–") for key in _COLUMNS)] for name, of in names.items()],
        "Of the same samples, as driven: pulls and loads add up. A wheel's pull in steady driving is in its report.",
        strong=len(given),
    )
    pairs = (Pair(drawings[i : i + 2]) for i in range(0, len(given), 2))
    return Section("wheels", "Wheels side by side", [*pairs, table])


def _against_slip(vehicle: Vehicle, figures: Mapping[str, KeyFigure]) -> Section:
    """Return drawbar coefficient and tractive efficiency of the vehicle against its mean slip."""
    drawings = [
        _against(key, f"{name}: {how}", vehicle.mean_slip, values, name)
        for key, name, how, values in (
            ("coefficient", "Drawbar coefficient", "sum of pulls / sum of loads", vehicle.coefficient),
            ("efficiency", "Tractive efficiency", "sum of D V / sum of T ω", vehicle.efficiency),
        )
        if np.isfinite(values).any()
    ]
    tiles = [
        _tile("drawbar_coefficient", figures),
        _tile("tractive_efficiency", figures, "where the mean slip exceeds twice its error"),
    ]
    return Section("vehicle", "Drawbar coefficient and efficiency", [Pair(drawings), Tiles(tiles, small=True)])


def _transfer(vehicle: Vehicle, figures: Mapping[str, KeyFigure]) -> Section:
    """Return the load of each axle against acceleration and sum of pulls."""
    title, loads = "Load transfer", vehicle.axle_loads_n
    if len(loads) < 2:
        return Section("transfer", title, [Text("Omitted: one axle has instrumented wheels.", "missing")])
    level = {f"axle {axle}": vehicle.second_means(load) / 1e3 for axle, load in loads.items()}
    drawings = [
        _of_axles(key, name, vehicle.second_means(values, level=False), unit, level)
        for key, name, values, unit in (
            ("acceleration", "acceleration", vehicle.acceleration_mps2, "m/s²"),
            ("pull", "sum of drawbar pulls", vehicle.pull_n / 1e3, "kN"),
        )
        if np.isfinite(values).any()
    ]
    tiles = Tiles([_tile(f"transfer_by_{key}", figures) for key in ("acceleration", "pull")], small=True)
    return Section("transfer", title, [Pair(drawings), tiles], {"transfer": vehicle.transfer})


def _of_axles(key: str, name: str, means: FloatArray, unit: str, level: Mapping[str, FloatArray]) -> Drawing:
    """Return the load of each axle against something, of means over 1 s."""
    edges = np.linspace(*reach(np.nanpercentile(means, _MIDDLE), zero=False), _BINS + 1)
    binning, centres = Binning(means, edges), (edges[:-1] + edges[1:]) / 2
    curves = []
    for (axle, load), look in zip(level.items(), _LOOKS * len(level), strict=False):
        found = binning.of(load, least=_LEAST)
        curves.append(Curve(axle, centres, matched(centres, found), look))
        curves.append(Curve("", found.centre, found.median, look, found.lower, found.upper, points=True))
    scale = reach(*(curve.y for curve in curves), zero=False)
    return drawn(
        f"axles-{key}",
        f"Load of each axle against {name}",
        f"Means over 1 s, the runs at one mean load. {_POINTS}",
        Plane((edges[0], edges[-1]), scale, f"{upper(name)} ({unit})", "Load of the axle (kN)"),
        curves,
        reading=_READING_TRANSFER,
        wide=_PAIRED,
    )


def _sides(vehicle: Vehicle, figures: Mapping[str, KeyFigure]) -> Section:
    """Return the slip of the left less the right, and of the front less the rear wheels, with one scale."""
    title, slip, found = "Slip left against right, front against rear", vehicle.mean_slip, vehicle.slip_differences
    if not found:
        return Section(
            "sides", title, [Text("Omitted: no two instrumented wheels are side by side or in line.", "missing")]
        )
    scale = reach(_LEAST_SCALE, *(np.percentile(off[slip > 0], (5, 95)) for off in found.values() if (slip > 0).any()))
    drawings = [
        _against(
            f"slip-{name.replace('_', '-')}",
            _NAMES[f"slip_{name}"],
            slip,
            off,
            _NAMES[f"slip_{name}"],
            scale=scale,
            size=_PAIRED if len(found) > 1 else _ALONE,
            reading=_READING_SLIP,
        )
        for name, off in found.items()
    ]
    return Section(
        "sides", title, [Pair(drawings), Tiles([_tile(f"slip_{name}", figures) for name in found], small=True)]
    )
