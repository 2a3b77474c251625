"""The figure in which a person sees a cause: the residual against what the cause acts through, with its correction.

And that of data which no cause explains: the residual that is largest, against what it hangs on.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from daq import OUTPUTS, ROLES, DataError, FloatArray
from model.diagnosis import Cause, Diagnosis, Kind
from model.effects import EFFECTS, Effect
from model.wheel_soil import speed_ratio
from wheelsoil.report.content import Drawing
from wheelsoil.report.drawing import Curve, Plane, beyond, drawn, reach
from wheelsoil.report.figures import EDGES, Bins, binned, matched, repeated
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import Recommendation, recommended_causes, slips_of_rows
from wheelsoil.wording.error_text import error_text
from wheelsoil.wording.names import CALIBRATED, page_unit, plain_name, upper
from wheelsoil.wording.numbers import number, signed
from wheelsoil.wording.verdict import several_terrains
from wheelsoil.workflows.key_figures import Z95

_BINS = 16
_LONGEST_STEP_S = 0.5


@dataclass(frozen=True)
class _Samples:
    """What causes act through, at the samples of a recommendation; arrays of shape (n,)."""

    slip: FloatArray
    load_n: FloatArray
    speed_mps: FloatArray
    day_min: FloatArray
    clock: FloatArray
    acceleration_mps2: FloatArray
    rim_acceleration_mps2: FloatArray


Own = Callable[[float, _Samples, FloatArray], FloatArray]


class _View(NamedTuple):
    """How a cause is shown: the abscissa's title, and the abscissa of samples.

    `own` is what a cause in the reading of pull or torque itself adds to it, of its value, the samples, and what the
    recommended model predicts; without it the models say it. `braked`: braked samples show it, too.
    """

    axis: str
    across: Callable[[_Samples], FloatArray]
    own: Own | None = None
    braked: bool = False


_VIEWS: Mapping[str, _View] = {
    "slip": _View("Slip ratio", lambda s: s.slip, lambda x, s, _: x + 0.0 * s.slip),
    "load": _View("Vertical load (kN)", lambda s: s.load_n / 1e3, lambda x, s, _: x * s.load_n),
    "speed": _View("Ground speed (m/s)", lambda s: s.speed_mps),
    "time": _View("Time since the first run (min)", lambda s: s.day_min, lambda x, s, _: x * s.clock),
    # of what is predicted, which takes the place of the slip
    "prediction": _View("Predicted {}", lambda s: s.slip, lambda x, _, model: x / (1.0 + x) * model, braked=True),
    "acceleration": _View("Acceleration of the vehicle (m/s²)", lambda s: s.acceleration_mps2),
    "rim acceleration": _View("Acceleration of the rim (m/s²)", lambda s: s.rim_acceleration_mps2, braked=True),
}
"""By the abscissa that an effect states."""
_HANGS_ON: Mapping[object, str] = {
    **dict.fromkeys((Kind.TORQUE, Kind.TORQUE_SQUARED, Kind.TORQUE_DRIFT), "t"),
    **dict.fromkeys((Kind.DRAWBAR_PULL, Kind.DRAWBAR_PULL_SQUARED, Kind.DRAWBAR_PULL_DRIFT), "dp"),
}
"""Channel whose prediction a finding of a kind hangs on; the others are shown against slip."""


def cause_figure(inputs: ReportInputs, recommendation: Recommendation, channel: str) -> Drawing | None:
    """Return the figure of the cause that changes most; None where slip shows it best, or there is none.

    A cause that acts in one channel itself is shown in that one, whichever `channel` is given.
    """
    found = inputs.diagnosed
    if found is None or not found.plot_data or not recommended_causes(found) or several_terrains(found) is not None:
        return None
    shares = {each: shares_of(found, each, recommendation.measured) for each in recommended_causes(found)}
    cause = max(shares, key=lambda each: max(shares[each].values(), default=0.0))
    effect = EFFECTS.get(cause.key, Effect)
    if not effect.abscissa or not cause.parameters:
        return None
    view, samples = _VIEWS[effect.abscissa], _samples_of(recommendation, found)
    in_reading = effect.kind == "measurement" and {"drawbar_pull", "driving_torque"}.issuperset(effect.shows)
    if view.own is None or not in_reading:
        left = recommendation.residual(channel, base=True)
        line = recommendation.recommended[channel] - recommendation.base[channel]
        against = f"{CALIBRATED}, without the cause"
    else:
        shown = [c for c in shares[cause] if OUTPUTS[c].role in effect.shows]
        channel = max(shown or shares[cause], key=shares[cause].__getitem__, default=channel)
        line = view.own(cause.parameters[0].value, samples, recommendation.recommended[channel])
        model = f"the {recommendation.title.lower()} model"
        left, against = recommendation.residual(channel) + line, f"{model} without its correction"
    of_gain = effect.abscissa == "prediction"
    across = recommendation.recommended[channel] - line if of_gain else view.across(samples)
    factor, unit = page_unit(channel)
    title = error_text(cause, OUTPUTS[channel].name) or upper(plain_name(cause.name))
    if found.verdict != "named":  # one of several: no fact
        title = f"If {plain_name(cause.name)} acts: {title[0].lower()}{title[1:]}"
    over_slip = effect.abscissa == "slip"
    if not view.braked:  # braking is so steep that the driven part would look flat
        left, across = (np.where(recommendation.slip > 0, values, np.nan) for values in (left, across))
    line = np.where(np.isfinite(left), line, np.nan)  # of the same samples as the points
    edges = EDGES if over_slip else np.linspace(*_span(across), _BINS + 1)
    points, correction = binned(across, factor * left, edges), binned(across, factor * line, edges)
    curves = [
        Curve("Correction", correction.centre, correction.median, "model", note=plain_name(cause.name)),
        Curve("", points.centre, points.median, "measured", points.lower, points.upper, points=True),
    ]
    span = driven_slips(recommendation.slip) if over_slip else _span(across)
    cloud = _known(across, factor * left)
    inner = cloud[1][(cloud[0] >= span[0]) & (cloud[0] <= span[1])]
    bulk = np.percentile(inner, [0.5, 99.5]) if len(inner) else inner
    axis = view.axis.format(f"{OUTPUTS[channel].name} ({unit})")
    plane = Plane(span, _height(points, correction, also=bulk), axis, f"Measured − predicted ({unit})")
    side = "Driving and braking" if view.braked else "Driving"
    caption = (
        f"{side}. Measured − predicted by {against}. Grey: samples{beyond(cloud, plane)}. "
        "Points: median and middle half. Line: the correction."
    )
    return drawn("hero", title, caption, plane, curves, samples=cloud)


def residual_figure(
    recommendation: Recommendation, found: Diagnosis, key: str, wide: tuple[int, int, int], *, of_rows: bool = False
) -> Drawing:
    """Return the residual of the channel that leads the list of findings, or else is off most.

    It is of the driven samples, or of rows of tables, and against what the first finding of the channel hangs on.
    `DataError` where the noise of no channel is known.
    """
    first = {ROLES[finding.channel].key: finding for finding in reversed(found.what_is_wrong)}
    of = {channel: _HANGS_ON.get(getattr(finding.place, "kind", None), "") for channel, finding in first.items()}
    slip, base = recommendation.slip, recommendation.base
    side = slip >= 0 if (slip > 0).any() else slip < 0

    def summary(channel: str, values: FloatArray) -> Bins:
        x, y = base.get(of.get(channel, ""), slip)[side], page_unit(channel)[0] * values[side]
        edges = np.linspace(*_span(x), _BINS + 1) if of.get(channel) in base else EDGES
        return repeated(x, y) if of_rows else binned(x, y, edges)

    known = {}
    for channel in recommendation.measured:
        left, noise = (summary(channel, x) for x in (recommendation.residual(channel), recommendation.noise[channel]))
        sigmas = np.abs(left.median) / matched(left.centre, noise)
        if np.isfinite(sigmas).any():
            known[channel] = (float(np.nanmax(sigmas)), int(np.nanargmax(sigmas)), left, noise)
    if not known:
        raise DataError("the noise of the samples is not known")
    leading = [ROLES[finding.channel].key for finding in found.what_is_wrong]
    channel = next((c for c in leading if c in known), max(known, key=lambda c: known[c][0]))
    _, worst, left, noise = known[channel]
    (factor, unit), where, half = page_unit(channel), float(left.centre[worst]), Z95 * noise.median
    axis, at, x = "Slip ratio", f"slip {signed(where, '.2f')}", slip[side]
    if (predicted := of.get(channel, "")) in base:
        axis = f"Predicted {OUTPUTS[predicted].name} ({page_unit(predicted)[1]})"
        at, x = f"a predicted {number(where)} {page_unit(predicted)[1]}", base[predicted][side]
    cloud = _known(x, factor * recommendation.residual(channel)[side])
    medians = Curve("", left.centre, left.median, "measured", left.lower, left.upper, points=True)
    curves = [
        Curve("", noise.centre, 0 * half, "noise", -half, half),
        Curve("", *cloud, "measured", points=True) if of_rows else medians,
    ]
    plane = Plane(
        slips_of_rows(recommendation) if of_rows else _span(x),
        _height(left, also=np.concatenate([half, -half, cloud[1] if of_rows else half])),
        axis,
        f"Measured − predicted ({unit})",
    )
    title = f"{OUTPUTS[channel].name.capitalize()}: median residual {number(float(left.median[worst]))} {unit} at {at}"
    grey = "scatter and error of form" if of_rows else f"the noise, samples{beyond(cloud, plane)}"
    points = "rows" if of_rows else "median and middle half"
    caption = f"{'Driving' if (slip > 0).any() else 'Braking'}, {CALIBRATED}. Grey: 95 % of {grey}. Points: {points}."
    if channel in first and not of_rows:
        size = f"{number(first[channel].size)} {ROLES[first[channel].channel].unit_text}"
        caption += f" {size} in the appendix is that shape alone, with the soil fitted anew."
    return drawn(key, title, caption, plane, curves, samples=None if of_rows else cloud, wide=wide)


def shares_of(found: Diagnosis, cause: Cause, channels: Container[str]) -> dict[str, float]:
    """Return the root mean square of what a cause changes in each of some channels, in sigmas of a sample."""
    squares: dict[str, list[FloatArray]] = {}
    for seen in found.plot_data:
        for channel, changed in seen.signatures.get(cause.key, {}).items():
            if channel not in channels:
                continue
            sigmas = (changed / seen.base_sigma[channel])[np.isfinite(changed)]
            squares.setdefault(channel, []).append(sigmas**2)
    known = {channel: np.concatenate(parts) for channel, parts in squares.items()}
    return {channel: float(np.sqrt(np.mean(of))) for channel, of in known.items() if len(of)}


def _samples_of(recommendation: Recommendation, found: Diagnosis) -> _Samples:
    speed = np.concatenate([seen.ground_speed_mps for seen in found.plot_data])
    rim = speed / np.maximum(np.asarray(speed_ratio(recommendation.slip), np.float64), 1e-3)
    return _Samples(
        slip=recommendation.slip,
        load_n=recommendation.vertical_load_n,
        speed_mps=speed,
        day_min=np.concatenate([seen.since_first_run_s for seen in found.plot_data]) / 60.0,
        clock=np.concatenate([seen.campaign_time for seen in found.plot_data]),
        acceleration_mps2=_rate(speed, recommendation),
        rim_acceleration_mps2=_rate(rim, recommendation),
    )


def _rate(values: FloatArray, recommendation: Recommendation) -> FloatArray:
    """Return the change in time within each stretch of a run; NaN at its ends."""
    step = recommendation.time_s[2:] - recommendation.time_s[:-2]
    within = (recommendation.run[2:] == recommendation.run[:-2]) & (step > 0) & (step <= 2 * _LONGEST_STEP_S)
    inner = np.where(within, (values[2:] - values[:-2]) / np.where(step > 0, step, 1.0), np.nan)
    return np.concatenate([[np.nan], inner, [np.nan]]) if len(values) > 1 else np.full(len(values), np.nan)


def driven_slips(slip: FloatArray) -> tuple[float, float]:
    """Return the axis of driven slips."""
    return 0.0, max(0.05 * float(np.ceil(np.nanmax(slip) / 0.05)), 0.2)


def _span(across: FloatArray) -> tuple[float, float]:
    known = across[np.isfinite(across)]
    if not len(known):
        return 0.0, 1.0
    low, high = np.percentile(known, [0.5, 99.5]).tolist()
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _height(*all_bins: Bins, also: FloatArray) -> tuple[float, float]:
    return reach(also, *(edge for bins in all_bins for edge in (bins.lower, bins.upper, bins.median)))


def _known(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    rows = np.isfinite(x) & np.isfinite(y)
    return x[rows], y[rows]
