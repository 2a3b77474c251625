"""The sentences of what a diagnosis notes and of what it lacks, one for each code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from daq import OUTPUTS, ROLES, Fault
from model import DiagnosisCode, LackCode, StepCode
from wheelsoil.wording.names import chance, effect_name, letter, listed, page_unit, plain_name, plain_names, stretches
from wheelsoil.wording.numbers import after_value, number
from wheelsoil.wording.run_notes import Sentence, Values

_PEAK_AHEAD = "if the stress peak usually lies ahead of the wheel's bottom, as on most soils"
_CONDITIONS = {
    "ground_speed_mps": "the ground speed",
    "wheel_speed_radps": "the wheel speed",
    "ground_acceleration_mps2": "the acceleration",
    "ground_jerk_mps3": "the change of the acceleration",
    "wheel_acceleration_radps2": "the wheel's acceleration",
    "line_position": "the place on the line",
    "campaign_time": "the campaign's clock",
    "direction": "the direction",
    "pass_number": "the number of the pass",
    "inflation_kpa": "the inflation pressure",
    "unit_weight_n_m3": "the soil's unit weight",
    "body_pitch_rad": "the pitch of the body",
    "outboard_mass_kg": "the outboard weight along a slope (an accelerometer takes it off)",
}


def _no_trace(v: Values) -> str:
    rows = "s < 0" if v["braked"] else "s > 0"
    return f"it changes nothing that was measured ({', '.join(v['channels'])}; rows with {rows} only)"


def _neutral(v: Values) -> str:
    between = f"{number(v['low'])} to {number(v['high'])}{after_value(v['unit'])}"
    return f"the {plain_name(v['family'])}'s {letter(v['parameter'])} may as well be {v['neutral']:g} ({between})"


def _at_limit(v: Values) -> str:
    ends = f"ends at the limit of what is plausible, {number(v['value'])}{after_value(v['unit'])}"
    return f"the {plain_name(v['family'])}'s {letter(v['parameter'])} {ends}"


def _nothing_usable(v: Values) -> str:
    texts = dict.fromkeys(f"{fault.what} ({fault.found})" if fault.found else fault.what for fault in v["faults"])
    return "; ".join(texts) or "no campaign"


def _excluded(v: Values) -> str:
    fault: Fault = v["fault"]
    return f"{fault.where}: {fault.what}{f', {fault.found}' if fault.found else ''}; excluded"


def _of_campaign(v: Values) -> str:
    return f"{v['campaign']}: " if "campaign" in v else ""


def _wheel_order(v: Values) -> str:
    channel = v["channel"]
    why = "a zero that turns with the wheel, or a wheel" if channel == "dp" else "a wheel"
    size = f"{v['size']:.0f} {OUTPUTS[channel].unit_text}"
    return (
        f"{_of_campaign(v)}{OUTPUTS[channel].name} swings by {size} once a turn of the wheel: {why} that is not round"
    )


def _zeros(v: Values) -> str:
    channel = v["channel"]
    size = f"{v['size']:.2g} {OUTPUTS[channel].unit_text}"
    return (
        f"{_of_campaign(v)}{OUTPUTS[channel].name}: zeros that differ by {size} from run to run are taken for noise, "
        f"where {v['usual']:.1g} are usual; if the standstills read one sign, or more with more load, it is a cause "
        "that was not considered"
    )


def _more_alike(v: Values) -> str:
    sets = [" with ".join(map(plain_name, each)) for each in v["instead"]]
    sets[3:] = [f"{len(sets) - 3} more sets"] if len(sets) > 4 else sets[3:]
    of = listed(plain_names(v["families"]), "or")
    return f"{listed(sets, 'or')} is confounded with {of}: fewer causes at once are more probable"


def _disagreement(v: Values) -> str:
    unit = after_value(v["unit"])
    own = ", ".join(f"{campaign} {value:.3g} ± {sigma:.3g}{unit}" for campaign, value, sigma in v["own"])
    test = f"Cochran's Q {v['q']:.1f} on {len(v['own']) - 1}, p {chance(v['chance'])}"
    return (
        f"the campaigns disagree about {v['parameter']}: {own} ({test}): a shared value is not theirs, diagnose each "
        "by itself"
    )


def _static_contradicts(v: Values) -> str:
    if radius := v.get("radius_m"):
        (rolls, own), (runs, of_runs) = (
            (radius * (1.0 - v[name]), radius * v[of]) for name, of in (("reading", "sigma"), ("runs", "runs_sigma"))
        )
        return (
            f"a coasting wheel rolls on {rolls:.3f} ± {own:.3f} m, but by the runs it would roll on {runs:.3f} ± "
            f"{of_runs:.3f} m ({v['sigmas']:.0f} sigma apart{_but_with(v)}): check both speeds, repeat the test"
        )
    channel = OUTPUTS[v["channel"]]
    (reading, sigma), (runs, own) = ((v[name], v[of]) for name, of in (("reading", "sigma"), ("runs", "runs_sigma")))
    known = f" under {v['applied']:.4g} {channel.unit_text}" if v["applied"] else ""
    less = ", less the zero of zero_file" if v["zeroed"] else ""
    return (
        f"the {channel.name} of a static test{known} reads {reading:.4g} ± {sigma:.2g} {channel.unit_text}{less}, but "
        f"by the runs it would read {runs:.4g} ± {own:.2g} ({v['sigmas']:.0f} sigma apart{_but_with(v)}): check the "
        "unit and sign of reading and applied force, repeat the test"
    )


def _but_with(v: Values) -> str:
    """Return with which causes the runs and a static test agree, though the runs alone ask for others."""
    return f"; with {listed([plain_name(family) for family in v['agree']])} they agree" if v.get("agree") else ""


def _other_form(v: Values) -> str:
    nats = f"{v['nats']:.1f} nats"
    return f"by itself, {v['campaign']} asks for {plain_name(v['family'])} as {v['form']} instead ({nats})"


def _scatter(v: Values, template: str) -> str:
    """Return what is known of a channel's scatter, by a template of it, beside the error of form of a right model."""
    factor, unit = page_unit(v["channel"])
    scatter, form = (f"{factor * v[name]:.2g} {unit}" for name in ("scatter", "form_scale"))
    known = f"{OUTPUTS[v['channel']].name}: {template.format(scatter)}"
    return f"{known}; a right model may have an error of form of {form}"


def _form_decides(v: Values) -> str:
    verdicts = [
        f"with {how} the error of form the verdict would be {plain_name(v[how][0])}"
        + (f" ({' and '.join(map(plain_name, v[how][1]))})" if v[how][0] == "named" else "")
        for how in ("half", "twice")
        if how in v
    ]
    return ", ".join(verdicts)


def _form_adequate(v: Values) -> str:
    size = f"{100.0 * v['share']:.2g} % of load, load x radius and radius" if "share" in v else "this"
    times = f", {v['factor']:.2g} times the one here" if "share" in v else f" times {v['factor']:.2g}"
    names = listed([plain_name(family) for family in v["families"]]) or "no cause at all"
    return f"with an error of form of {size}{times}, {names} would be an adequate explanation, and the verdict one_of"


def _mixed_repeats(v: Values) -> str:
    share = f"{100.0 * v['share']:.0f} % of the load in {OUTPUTS[v['channel']].name}"
    return f"rows of one group scatter by {share}: they may be of different wheels or tests; choose them with --where"


def _unseen(v: Values) -> str:
    factor, unit = page_unit(v["channel"])
    errors: Mapping[str, Any] = v["errors"]
    words = ", ".join(f"{effect_name(key)} {factor * error:.2g}" for key, error in errors.items())
    return (
        f"{v['table']}: the {OUTPUTS[v['channel']].name} that each candidate implies misses the measured one, which it "
        f"has not seen, by (rms, {unit}): {words}"
    )


def _terrains(v: Values) -> str:
    sides = zip(v.get("groups", ()), v.get("drawbar_coefficients", ()), strict=True)
    between = [(" to ".join(dict.fromkeys(f"{end:.2f}" for end in ends)), names) for names, ends in sides]
    pulls = [f"{ends} on {stretches(names, v['runs'])}" for ends, names in between]
    runs = "runs" if v["campaign"] == "runs" else f"runs of {v['campaign']}"
    return (
        f"tan phi differs by {100 * v['share']:.0f} % between {runs}"
        + (f": pull over load at slip 0.2 is {' and '.join(pulls)}" if pulls else "")
        + ". Nothing is said of a cause that one part of these runs has and the other has not"
    )


def _more_than_noise(v: Values) -> str:
    factor, unit = page_unit(v["channel"])
    error, expected = (f"{factor * v[which]:.3g} {unit}" for which in ("error", "expected"))
    return (
        f"no cause is detected, but the held-out error of {OUTPUTS[v['channel']].name} is {error}, "
        f"where soil and noise give {expected}"
    )


def _cancel(v: Values) -> str:
    families = " and ".join(plain_name(f) for f in v["families"])
    return f"{families} cancel each other, and what remains is explained as well without {plain_name(v['without'])}"


def _load(v: Values) -> str:
    added = v["added_kg"]
    change = f"{float(f'{abs(added):.2g}'):g} kg {'more' if added > 0 else 'less'}"
    return f"about {v['load_n'] / 1e3:.1f} kN on the wheel, {change} there than so far"


def _loads(v: Values) -> str:
    apart, two = 100.0 * v["spread"], 100.0 * v["least"]
    return f" (loads differ by {apart:.2g} %, two by {two:g} % or more)" if apart else ""


def _tests(v: Values) -> str:
    loads, factor = {0.5: "half the load", 2.0: "twice the load"}, v["load_factor"]
    names = " and ".join(OUTPUTS[c].name for c in v["channels"])
    if factor == 1.0:
        return f"measure the {names} too"
    load = loads.get(factor, f"{factor:g} times the load")
    return f"{load}, with {names} measured" if names else load


STEP_KEYS: dict[str, str] = {
    StepCode.MORE_LOAD: "added_load_kg in runs.toml",
    StepCode.LESS_LOAD: "added_load_kg in runs.toml",
    StepCode.HALF_PRESSURE: "inflation_kpa in runs.toml",
    StepCode.OTHER_DIRECTION: "direction in runs.toml",
    StepCode.SECOND_PASS: "pass_number in runs.toml",
    StepCode.STANDSTILLS: 'standstill_brakes = "released" in the vehicle.toml of that run',
    StepCode.RUT: "[[run.rut]] in runs.toml",
    StepCode.SINKAGE: "the role sinkage in vehicle.toml",
    StepCode.TORQUE: "the role driving_torque in vehicle.toml",
    StepCode.KNOWN_PULL: "[[static]] in runs.toml",
    StepCode.KNOWN_TORQUE: "[[static]] in runs.toml",
    StepCode.LIFTED_ZERO: "zero_file in vehicle.toml, by the command zero",
    StepCode.REPEAT_STATIC: "[[static]] in runs.toml",
    StepCode.HARD_GROUND: 'ground = "firm" under its [[run]] in runs.toml',
}
"""Key of a file under which the result of a step is written."""

SENTENCES: dict[str, Sentence] = {
    StepCode.LIKE_OTHERS: "one more run like the others",
    StepCode.MORE_LOAD: lambda v: f"a run with more load: {_load(v)}",
    StepCode.LESS_LOAD: lambda v: f"a run with less load: {_load(v)}",
    StepCode.HALF_PRESSURE: "a run at half the inflation pressure: {inflation_kpa:.0f} kPa",
    StepCode.OTHER_DIRECTION: lambda v: f"a run {'out' if v['outward'] else 'back'}, the other direction",
    StepCode.BRAKING: "a run with braking, down to a slip of {slip:.1f}",
    StepCode.SLOWER_RAMPS: "a run with slip ramps half as fast, twice as long",
    StepCode.HALF_SPEED: "a run at half the speed",
    StepCode.SECOND_PASS: "a second pass in the same rut",
    StepCode.STANDSTILLS: "a run with {count} standstills of {duration_s:.0f} s, brakes released",
    StepCode.RUT: "a run, and the depth of its rut by a ruler at {count} places",
    StepCode.SINKAGE: "a run with a sinkage sensor",
    StepCode.TORQUE: "a run with the torque channel",
    StepCode.LIFTED_ZERO: "the zero with the wheel lifted, at standstill",
    StepCode.KNOWN_PULL: lambda v: (
        f"a known pull on the lifted wheel: about {v['pull_n'] / 1e3:.2g} kN, by a load cell"
    ),
    StepCode.KNOWN_TORQUE: lambda v: (
        f"a known torque on the lifted wheel: about {v['torque_nm'] / 1e3:.2g} kN m, by lever and weight"
    ),
    StepCode.HARD_GROUND: "coasting on hard ground for {duration_s:.0f} s, speeding up and slowing down",
    StepCode.REPEAT_STATIC: "the static test that the runs contradict, once more",
    StepCode.TABLE: _tests,
    LackCode.INPUT_UNKNOWN: lambda v: (
        f"{' and '.join(_CONDITIONS.get(name, name) for name in v['conditions'])} is not known everywhere"
    ),
    LackCode.SMOOTH_TYRE: "the tyre is declared smooth",
    LackCode.SLIP_COMMANDED: "the slip is a commanded one: no measured speed is in it",
    LackCode.ONE_DIRECTION: "all runs go one way: drive some back",
    LackCode.SAME_PASS: "every run is on the same pass: drive a second one in the rut of the first",
    LackCode.PRESSURE_UNKNOWN: "the inflation pressure is not known: taken as the same in every run",
    LackCode.ONE_LOAD: lambda v: f"one load only{_loads(v)}: drive with another added mass",
    LackCode.ONE_RUN_NO_DRIFT: "one run only: a drift over the campaign does not show",
    LackCode.HARDLY_BRAKED: "the wheel was hardly ever braked",
    LackCode.HARDLY_DRIVEN: "the wheel was hardly ever driven",
    LackCode.LOW_SLIP: "the slip never was above {slip:g}",
    LackCode.CHANNEL_UNUSED: lambda v: f"{ROLES[v['role']].name} was measured and not looked at",
    LackCode.CHANNEL_MISSING: lambda v: f"{ROLES[v['role']].name} was not measured",
    LackCode.NOT_AT_STANDSTILL: (
        "no standstill is declared to be with released brakes, which would show the zeros "
        "(standstill_brakes in vehicle.toml, or a signal brake)"
    ),
    LackCode.NO_TRACE: _no_trace,
    LackCode.NOT_SETTLED: "the iterated linearisation of the model did not converge, so that no cause can be judged",
    LackCode.NOTHING_JUDGED: "the model has no answer for these samples, so that there is nothing to judge a cause by",
    LackCode.MORE_THAN_NOISE: _more_than_noise,
    LackCode.AGAINST_STATIC: lambda v: f"the runs contradict a static test by {v['sigmas']:.0f} sigma",
    LackCode.NOT_CHECKED: "with fewer than three runs or conditions no name can be checked against others",
    LackCode.NOT_SURE: lambda v: (
        f"by these runs as they are, not averaged over resampled ones, its probability is {chance(v['probability'])}, "
        f"below the {100 * v['least']:g} % that a name needs"
    ),
    LackCode.UNLISTED_MAY_ACT: lambda v: f"a cause that is not listed may act ({chance(v['probability'])})",
    LackCode.FORM_NOT_LISTED: lambda v: (
        f"{plain_name(v['family'])} acts by another formula than the listed ones, and this may only make up for it"
    ),
    LackCode.NO_BETTER: (
        "held-out runs or conditions are not predicted well enough: the log score rises by {nats:.2g} nats, less than "
        "{least:g}, and no error falls for certain"
    ),
    LackCode.CHANNEL_WORSE: lambda v: (
        f"it contradicts {OUTPUTS[v['channel']].name}, whose held-out error grows by {v['percent']:.0f} % "
        f"({v['low']:.0f} to {v['high']:.0f})"
    ),
    LackCode.PARTS_CANCEL: _cancel,
    LackCode.PEAK_MAY_SHIFT: lambda v: f"its probability is only {chance(v['probability'])} {_PEAK_AHEAD}",
    LackCode.VALUE_AT_LIMIT: _at_limit,
    LackCode.VALUE_MAY_BE_NEUTRAL: _neutral,
    LackCode.NOTHING_USABLE: _nothing_usable,
    LackCode.FORM_ADEQUATE: _form_adequate,
    LackCode.FORM_DECIDES: _form_decides,
    LackCode.NO_CHANNEL_MEASURED: "none of the channels that are looked at was measured in these rows",
    LackCode.FEW_ROWS: (
        "{rows} rows at {conditions} slip and load decide nothing: measure at three slips or more, three times each"
    ),
    DiagnosisCode.CAMPAIGN_EXCLUDED: _excluded,
    DiagnosisCode.NOTHING_TO_TEST: ("nothing explains these runs: there is no extension whose gain could be measured"),
    DiagnosisCode.FEW_RUNS: "fewer than three runs: probabilities could not be calibrated by drawing runs anew",
    DiagnosisCode.ONE_RUN: "one run only: there is no other to test the extension on",
    DiagnosisCode.TWO_RUNS: "two runs only: each was tested on what the other taught, and the gain has no interval",
    DiagnosisCode.NO_POSITIONS: ("no positions: where on the line a run lies is taken from its distance and direction"),
    DiagnosisCode.POSITIONS_STILL: (
        "the positions do not change: where on the line a run lies is taken from its distance"
    ),
    DiagnosisCode.RUN_APART: lambda v: (
        f"{v['run']} lies apart: its {plain_name(v['family'])} is {v['size']:+.3g} {page_unit(v['channel'])[1]} off "
        f"what the other runs agree on, {abs(v['size'] / v['sigma']):.0f} times their scatter"
    ),
    DiagnosisCode.LESS_BESIDE_USUAL: lambda v: f"{plain_name(v['family'])}: {chance(v['probability'])} {_PEAK_AHEAD}",
    DiagnosisCode.LIKE_RADIUS: lambda v: (
        (f"a wheel radius of {v['radius_m'] + v['larger_m']:.3g} m in place of" if v["larger_m"] else "a radius above")
        + f" {v['radius_m']:g} m looks the same as {plain_name(v['family'])}: these data do not decide which it is"
    ),
    DiagnosisCode.OUTLIERS: lambda v: (
        f"outliers: {v['samples']} samples of {', '.join(v['runs'])}, around residuals of more than {v['limit']:g} "
        "sigma, are excluded: check the ground speed and the forces there"
    ),
    DiagnosisCode.WHEEL_ORDER: _wheel_order,
    DiagnosisCode.ZEROS_DIFFER: _zeros,
    DiagnosisCode.DISAGREEMENT: _disagreement,
    DiagnosisCode.STATIC_CONTRADICTS: _static_contradicts,
    DiagnosisCode.STATIC_SMALL: lambda v: (
        f"a static test of the {OUTPUTS[v['channel']].name} applies {number(v['applied'])} "
        f"{OUTPUTS[v['channel']].unit_text}, {number(100 * v['share'], 2)} % of "
        f"{'the load' if v['channel'] == 'dp' else 'load x radius'}, and says next to nothing: check the unit"
    ),
    DiagnosisCode.OTHER_FORM: _other_form,
    DiagnosisCode.BRAKED_ROWS_EXCLUDED: (
        "{table}: {rows} rows with s < 0 excluded from the diagnosis of a driven wheel"
    ),
    DiagnosisCode.BRAKED_ROWS_ONLY: (
        "rows of a braked wheel alone are diagnosed by their sinkage: its forces are not those of Eq. 4"
    ),
    DiagnosisCode.PRIOR_SCALED: (
        "prior scales in N and N m are stated for a wheel under 10 kN; here {share:.3g} of them (median load "
        "{load_n:.3g} N)"
    ),
    DiagnosisCode.REPEATS_SCATTER: lambda v: _scatter(v, "repeats scatter by {}"),
    DiagnosisCode.SCATTER_STATED: lambda v: _scatter(v, "one-sigma {} by the table"),
    DiagnosisCode.REPEATS_MIXED: _mixed_repeats,
    DiagnosisCode.LIKELIEST_SET: lambda v: (
        f"most probable set: {' and '.join(map(effect_name, v['keys']))} ({chance(v['probability'])})"
    ),
    DiagnosisCode.WITHOUT_GATE: lambda v: (
        f"without the gate of adequacy: {', '.join(f'{plain_name(f)} {chance(p)}' for f, p in v['families'].items())}"
    ),
    DiagnosisCode.UNSEEN_CHANNEL: _unseen,
    DiagnosisCode.SKID_LAW: lambda v: (
        f"{v['table']}: {v['rows']} rows with s <= 0 have a law of their own, Z = {1e3 * v['static_sinkage_m']:.1f} mm "
        f"+ ({1e3 * v['H2_m']:.1f} ± {1e3 * v['H2_sigma_m']:.1f}) mm s^2, held-out rms "
        f"{1e3 * v['left_out_rms_m']:.2f} mm; laws of a driven wheel are not asked there"
    ),
    DiagnosisCode.MORE_ALIKE: _more_alike,
    DiagnosisCode.SOIL_SIGMA_ASSUMED: lambda v: (
        f"{', '.join(v['campaigns'])}: no uncertainty of the soil is stated, the usual laboratory's is taken"
    ),
    DiagnosisCode.SEVERAL_TERRAINS: _terrains,
}
