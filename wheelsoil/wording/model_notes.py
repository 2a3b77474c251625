"""The sentences of what fits, soil tests and the sinkage from forces note, one for each code."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

import numpy as np

from daq import OUTPUTS, number
from model import BevameterCode, FitCode, SinkageCode
from wheelsoil.wording.names import chance, effect_name, listed, page_unit
from wheelsoil.wording.run_notes import Sentence, Values

_MOST_PLACES = 8
"""Rows that a sentence names."""
_MOST_SETS = 3
"""Sets of causes that a sentence names."""


def _near_one(rho: float) -> str:
    """Write a correlation with two digits of its distance from 1 (-0.9997, 0.99)."""
    gap = 1.0 - abs(rho)
    digits = 2 if gap <= 0 else int(np.clip(np.ceil(-np.log10(gap)), 2, 12))
    return f"{rho:.{digits}f}"


def _worse(v: Values) -> str:
    channel = OUTPUTS[v["channel"]]
    return (
        f"{channel.name}, which was not fitted, is followed worse than by Wong's model: R0 {number(v['R0'])} against "
        f"{number(v['R0_wong'])} {channel.unit_text}; the coefficients may stand for another cause (--channels dp,t)"
    )


def _pair(v: Values) -> str:
    (first, second), rho, ratio, singly = v["names"], v["correlation"], v["ratio"], v["singly"]
    if ratio == 1.0:
        combination = "their sum" if rho < 0 else "their difference"
    else:
        digits = int(np.clip(3 - np.log10(max(1 - abs(rho), 1e-12)) / 2, 3, 9))
        combination = f"{first} {'+' if rho < 0 else '-'} {ratio:.{digits}g} {second}"
    return (
        f"{first} and {second}: correlation {_near_one(rho)}; only {combination} is determined "
        f"(sd {v['sigma']:.2g}; singly {singly[0]:.2g} and {singly[1]:.2g})"
    )


def _chain(v: Values) -> str:
    pairs = ", ".join(f"{first}/{second} {_near_one(rho)}" for first, second, rho in v["pairs"])
    return f"{listed(v['names'])}: not determined singly, only together (correlations {pairs})"


def _combination(v: Values) -> str:
    numbers = ", ".join(map(_near_one, v["correlations"]))
    each = "each nearly" if len(v["names"]) > 1 else "nearly"
    return (
        f"{listed(v['names'])}: {each} a combination of the others (multiple correlation {numbers}; condition number "
        f"{v['condition_number']:.2g})"
    )


def _without_signals(v: Values) -> str:
    lacking = ", ".join(f"{run} ({', '.join(roles)})" for run, roles in v["signals"])
    return f"excluded from the fit, for want of a signal: {lacking}"


def _no_repeats(v: Values) -> str:
    first, second = v["scatter"]
    return (
        f"{v['tests']} test{'s' * (v['tests'] > 1)} without repeats cannot show how much tests scatter: a one-sigma of "
        f"{first:.0%} and {second:.2g} between tests is assumed; repeat each test at least three times to measure it"
    )


def _tested(v: Values) -> str:
    return "the tested widths ({:.4g} to {:.4g} m)".format(*v["widths_m"])


def _k_c(v: Values) -> str:
    low, high = (end / 1e3 for end in v["interval95"])
    sure = "" if high < 0 else "; the interval contains 0, so that these plates show no cohesive part"
    return (
        f"k_c = {v['k_c'] / 1e3:.4g} kN/m^(n+1), 95 % interval {low:.4g} to {high:.4g}, is negative: at the same "
        f"sinkage larger plates carry more pressure, which contradicts k = k_c/b + k_phi{sure}. It is reported as "
        f"it is; k is positive only for b > {-v['k_c'] / v['k_phi']:.3g} m. Use it within {_tested(v)}, or take k of "
        "the plate nearest to the wheel"
    )


def _cohesion(v: Values) -> str:
    low, high = (end / 1e3 for end in v["interval95"])
    return (
        f"the tests alone give a cohesion of {v['cohesion_pa'] / 1e3:.3g} kPa (95 % interval {low:.3g} to "
        f"{high:.3g}); it is set to 0, with that uncertainty, and the friction angle fitted again"
    )


def _places(v: Values) -> str:
    """Return which rows, in brackets; empty where nothing says it."""
    lines, slips = v.get("lines", ()), v.get("slips", ())
    if lines:
        named = [f"line {line}, slip {slip:.3g}" for line, slip in zip(lines, slips, strict=True)]
    elif len(slips) == v["broken"]:
        named = [f"slip {slip:.3g}" for slip in slips]
    else:
        named = [f"slips {slips[0]:.2g} to {slips[-1]:.2g}"] if slips else []
    more = f"; and {len(named) - _MOST_PLACES} more" if len(named) > _MOST_PLACES else ""
    return f" ({'; '.join(named[:_MOST_PLACES])}{more})" if named else ""


def _bound(v: Values, because: str) -> str:
    radius = v["larger_radius"]
    size = f"{100 * abs(radius):.2g} % {'larger' if radius > 0 else 'smaller'}"
    wheel = f"a wheel {size}" if isfinite(radius) else "no other radius"
    before = f"{v['campaign']}: " if v["campaign"] else ""
    return (
        f"{before}T/r - Dp is above W tan(theta_1), which no soil can do, in {v['broken']} of {v['rows']} driven rows"
        f"{_places(v)}, by up to {v['excess_n']:.3g} N ({v['sigmas']:.3g} sigma); {because}. What would mend it: "
        f"{v['less_torque_nm']:.3g} N m less torque, {1e3 * v['more_sinkage_m']:.3g} mm more sinkage, {wheel}, "
        f"or {v['more_pull_n']:.3g} N more drawbar pull"
    )


def _asked(v: Values) -> str:
    return f"the forces ask for a shear stress of {v['friction']:.2g} times the normal one"


def _average(v: Values) -> str:
    """Return what is averaged, the most probable sets by name, and how sure the prediction is."""
    sets = v["sets"]
    named = [f"{' and '.join(map(effect_name, keys)) or 'no cause'} ({chance(p)})" for keys, p in sets[:_MOST_SETS]]
    more = f" and {len(sets) - _MOST_SETS} more" if len(sets) > _MOST_SETS else ""
    rest = f"; sets with {chance(v['rest'])} of the probability are not in it" if v["rest"] > 0 else ""
    sigma = ", ".join(
        f"{factor * x:.3g} {unit} of {OUTPUTS[channel].name}"
        for channel, x in v["sigma"].items()
        for factor, unit in [page_unit(channel)]
    )
    return (
        f"the average of {len(sets)} sets of causes as they are in the file, not fitted: {', '.join(named)}{more}{rest}"
        + (f". One-sigma of the prediction, without noise: {sigma}" if sigma else "")
    )


def _taken(whom: str, values: Mapping[str, float | str]) -> str:
    pairs = (f'{key} = "{x}"' if isinstance(x, str) else f"{key} = {x:g}" for key, x in values.items())
    return f"{whom and f'of {whom} '}{', '.join(pairs)}"


SENTENCES: dict[str, Sentence] = {
    FitCode.AVERAGE_OF_SETS: _average,
    FitCode.OTHER_SOIL: "the model file is of soil {model}, and this is soil {soil}: extended predicts {model}",
    FitCode.MODEL_NOT_USED: "the model file is not used: {why}",
    FitCode.NO_INFLUENCE: "{names[0]}: has no influence on the residual; any value fits as well",
    FitCode.ONLY_TOGETHER: lambda v: (
        f"{listed(v['names'])}: not determined singly; moving them together leaves the residual as it is"
    ),
    FitCode.CORRELATED_PAIR: _pair,
    FitCode.CORRELATED_CHAIN: _chain,
    FitCode.COMBINATION: _combination,
    FitCode.AT_BOUND: "{names[0]}: ended at its bound {value:.6g}",
    FitCode.NOISE_UNKNOWN: "{residuals} residuals for {parameters} parameters: their noise cannot be estimated",
    FitCode.NOT_FINITE: "the residual or its sensitivities are not finite at the start",
    FitCode.NOT_CONVERGED: "not converged ({stop_reason}): the intervals are not to be relied on",
    FitCode.HELD_BY_BOUND: "{names[0]}: held by its bound {value:g}; the intervals of the others take it as known",
    FitCode.SUM_NEGATIVE: "p = {value:.3g} is below 0: the wheel would rise with slip, so that another cause acts",
    FitCode.SEVERAL_PASSAGES: lambda v: (
        f"the wheels are at passages {', '.join(map(str, v['passages']))} over the soil, for which no law has a term: "
        "compare what each wheel gives"
    ),
    FitCode.LOAD_NOT_CARRIED: "{samples} driven samples excluded: the soil does not carry their load above the axle",
    FitCode.DEFAULTS_TAKEN: lambda v: (
        f"taken by default, because no file states it: "
        f"{'; '.join(_taken(whom, values) for whom, values in v['values'].items())}; state each, even if it is the same"
    ),
    FitCode.RUNS_LACK_SIGNALS: _without_signals,
    FitCode.ROWS_NOT_DRIVEN: (
        "{used} of {rows} rows used: {excluded} with slip <= 0 excluded, the models are of a driven wheel"
    ),
    FitCode.NO_SAMPLE: "no sample has slip, measured and predicted value",
    FitCode.NO_SLIP: "no slip at or above the threshold {threshold:g}: the largest is {largest:.3g}",
    FitCode.ONE_SAMPLE: "R2 needs at least two samples",
    FitCode.MEASURED_CONSTANT: "R2 is not defined: the measured values are all the same",
    FitCode.FOLLOWED_WORSE: _worse,
    FitCode.PREDICTED_CONSTANT: "R2 is not defined: the predicted values are all the same",
    BevameterCode.MISFIT: "misfit {share:.0%} of the largest value: the curve is not {law}; check zero and window",
    BevameterCode.CONTACT_TOO_EARLY: "too few samples before the contact: zero as given",
    BevameterCode.NO_BASELINE: "the pressure rises from the first sample on: zero as given",
    BevameterCode.ZERO_NOT_FIXED: (
        "the fitted zero ended at the limit of its range: the curve does not fix it; prefer the contact"
    ),
    BevameterCode.HUMP: "the stress falls to {share:.0%} of its peak at {peak_m:.3g} m: Janosi-Hanamoto has no hump",
    BevameterCode.MODULUS_UNRESOLVED: (
        "K {modulus_m:.3g} m is finer than the samples, {spacing_m:.3g} m apart: K is not resolved"
    ),
    BevameterCode.SHORT_SHEAR: (
        "sheared only to {reach_m:.3g} m with K {modulus_m:.3g} m: strength and K are hardly separated"
    ),
    BevameterCode.NO_REPEATS: _no_repeats,
    BevameterCode.FEW_REPEATS: lambda v: (
        f"{v['tests']} tests leave {v['freedom']:.0f} degree{'s' * (v['freedom'] > 1)} of freedom for the scatter "
        f"between tests: intervals are {v['widening']:.1f} times as wide as with many; repeat the tests"
    ),
    BevameterCode.ONE_WIDTH: lambda v: (
        f"one plate width (b = {v['width_m']:.4g} m) fixes k = k_c/b + k_phi = {v['stiffness'] / 1e3:.4g} kPa/m^n at "
        "that width, not k_c and k_phi singly; test a second plate, at least 1.5 times as wide"
    ),
    BevameterCode.WIDTHS_ALIKE: (
        "k_c and k_phi: correlation -{correlation:.4f} at a given n; the plate widths are too alike to part them: "
        "test one at least 1.5 times as wide"
    ),
    BevameterCode.K_C_NEGATIVE: _k_c,
    BevameterCode.K_PHI_NEGATIVE: lambda v: (
        f"k_phi = {v['k_phi'] / 1e3:.4g} kN/m^(n+2) is negative: k is positive only for b < "
        f"{-v['k_c'] / v['k_phi']:.3g} m. Use it within {_tested(v)}, or test wider plates"
    ),
    BevameterCode.ONE_STRESS: lambda v: (
        f"one normal stress ({v['stress_pa'] / 1e3:.4g} kPa) fixes the strength c + sigma tan phi = "
        f"{v['strength_pa'] / 1e3:.4g} kPa there, not c and phi singly; test at a second normal stress, at least "
        "twice as large"
    ),
    BevameterCode.STRESSES_TINY: (
        "no strength is above {strength_pa:.3g} Pa, which is rare: if the stresses are in kPa, --rename "
        "shear_stress_pa=shear_stress_pa*1000,normal_stress_pa=normal_stress_pa*1000"
    ),
    BevameterCode.COHESION_NEGATIVE: _cohesion,
    SinkageCode.GROWTH_UNKNOWN: "it takes three points over at least {slip_span:g} of slip to see a growth",
    SinkageCode.TORQUE_AT_REST: lambda v: _bound(
        v, f"suspect the torque: it reads {v['rest_nm']:.3g} N m at standstill"
    ),
    SinkageCode.SINKAGE_SUSPECT: lambda v: _bound(
        v, "suspect the sinkage: load, drawbar pull and torque agree with each other, but not with it"
    ),
    SinkageCode.RADIUS_SUSPECT: lambda v: _bound(
        v, f"suspect the radius: {_asked(v)}, and ground over rim speed is {v['speed_scale']:.3g}"
    ),
    SinkageCode.TORQUE_SUSPECT: lambda v: _bound(v, f"suspect the torque: {_asked(v)}"),
}
