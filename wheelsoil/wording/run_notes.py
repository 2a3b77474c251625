"""The sentences of what is noted of recordings, of processed runs and of the transducer's zero, one for each code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any

from daq import ROLES, RecordingCode
from processing import RunCode, ZeroCode
from wheelsoil.wording.plausibility_text import plausibility_sentence, size_sentence

Values = Mapping[str, Any]
Sentence = str | Callable[[Values], str]
"""A template of the values, or a function of them."""

_MOST_LEVELS = 4


def _clock_set(v: Values) -> str:
    by = f" by up to {v['within_s']:.3g} s" if isfinite(v["within_s"]) else ""
    return f"{v['count']:,} frames came while the host's clock was set; their times may be wrong{by}"


def _standing(v: Values) -> str:
    pairs = list(zip(v["levels"], v["sigmas"], strict=True))[:_MOST_LEVELS]
    values = ", ".join(f"{level:.1f} ± {sigma:.1f}" for level, sigma in pairs)
    of = ROLES[v["role"]]
    read = f"{of.name} at standstill reads {values} {of.unit_text}"
    if v["brakes"] == ("released",):
        what = "a zero, the ground's tilt or the rut" if v["role"] == "drawbar_pull" else "a zero"
        return f"{read}: {what}; not subtracted"
    if "unknown" in v["brakes"]:
        return f"{read}: not taken for a zero, brakes may hold it; say standstill_brakes in vehicle.toml"
    return f"{read} with held brakes: this is no zero"


def _missing(v: Values) -> str:
    role, lacking, signal = v["role"], v["lacking"], v["signal"]
    name = "it" if lacking == role else f"{lacking}, which turns it into vehicle axes,"
    fix = ", and with GNSS its fix" if role == "ground_speed" else ""
    step = {
        "no_signal": f"name {name} under [signals] of vehicle.toml",
        "no_sample": f"{signal} holds no sample: check that its frames were recorded (wheelsoil info)",
        "never_usable": f"{signal} never has a usable value: check the sensor{fix}",
    }[v["cause"]]
    return f"{role} is missing; {step}"


def _ends(v: Values) -> str:
    lost = [
        (v["begin_s"], f"the first {v['begin_s']:.1f} s, until {v['first']} begins"),
        (v["end_s"], f"the last {v['end_s']:.1f} s, after {v['last']} ends"),
    ]
    return f"not used: {' and '.join(text for length_s, text in lost if length_s >= 0.1)}"


def _cutoff(v: Values) -> str:
    asked = f" instead of {v['asked_hz']:g} Hz" if v["asked_hz"] else ""
    held = f", in bursts {v['held_s']:.2g} s apart" if v["held_s"] else ""
    return (
        f"{v['role']} comes at {v['rate_hz']:.3g} Hz{held}: every channel is filtered at {v['cutoff_hz']:.2g} Hz{asked}"
    )


def _little_used(v: Values) -> str:
    used = f"only {v['used']:.1%} of the samples are used"
    if v["max_gap_s"] is None:
        return f"{used}; {v['share']:.1%} are excluded as {v['reason'].lower().replace('_', ' ')}"
    gap = f"`process --max-gap {v['max_gap_s']:g}`, or max_gap_s = {v['max_gap_s']:g} in choice.toml"
    return f"{used}, for they come with holes; {v['used_then']:.1%} would be with {gap}"


_AT_A_RUT = {"STANDSTILL": "the wheel stands", "TOO_SLOW": "the wheel is too slow"}


def _rut_not_used(v: Values) -> str:
    why = _AT_A_RUT.get(v["reason"], f"that sample is excluded as {v['reason'].lower().replace('_', ' ')}")
    return f"rut reading {v['number']} at {v['time_s']:.1f} s is not used: {why}; give the place where the wheel drove"


def _overloaded(v: Values) -> str:
    of = f" of {v['load_n']:,.0f} N" if isfinite(v["load_n"]) else ""
    if v["load_n"] < v["weight_n"]:
        return (
            f"the load{of} on one wheel is less than half its share of the weight of the vehicle (mass_kg = "
            f"{v['mass_kg']:g}): give axles under [vehicle], or correct mass_kg; {v['mass_kg']:g} lb are "
            f"{v['mass_kg'] * 0.45359237:.4g} kg"
        )
    return (
        f"the load{of} on one wheel is more than the weight of the whole vehicle, {v['weight_n']:,.0f} N (mass_kg = "
        f"{v['mass_kg']:g}, added_load_kg = {v['added_kg']:g}): correct mass_kg, or the unit of vertical_load, in "
        "vehicle.toml"
    )


def _distrusted(v: Values) -> str:
    why = ", ".join(f"{word} {count:,}" for word, count in sorted(v["statuses"].items(), key=lambda item: -item[1]))
    return f"the transducer distrusts {v['count']:,} samples, which are excluded; its status: {why}"


def _sensor_fault(v: Values) -> str:
    unit = ROLES[v["role"]].unit_text
    kind = {
        "dropped": "falls to 0 and back faster than a vehicle can",
        "spike": "jumps and comes back at once, as no vehicle or wheel does",
        "frozen": "keeps one value, without its noise",
        "clipped": f"is clipped at {v['value']:.4g} {unit}",
        "mark": f"has the value {v['value']:.6g} {unit}, far from all others, which stands for none",
    }[v["kind"]]
    amount = f"{v['time_s']:.1f} s" if v["time_s"] >= 1 or "count" not in v else f"{v['count']:,} samples"
    return f"{v['role']} {kind}: {amount} ({v['share']:.1%}) excluded"


def _taken_off(v: Values) -> str:
    how = " and ".join(f"{m} {age_text(age)}" for m, age in zip(v["methods"], v["ages_s"], strict=True))
    return f"zero of {', '.join(v['roles'])} taken off, from {v['source']}: {how}"


def age_text(seconds: float) -> str:
    """Return how long before a run (negative: after it) something was."""
    if not seconds:
        return "during the run"
    size = abs(seconds)
    if size < 2 * 3600:
        length = f"{size / 60:.0f} min"
    else:
        length = f"{size / 3600:.1f} h" if size < 48 * 3600 else f"{size / 86_400:.0f} days"
    return f"{length} {'before' if seconds > 0 else 'after'} the run"


def _moved(v: Values) -> str:
    change = f"{v['change']:+.1f} ± {v['sigma']:.1f} {ROLES[v['role']].unit_text}"
    return f"the zero of {v['role']} moved by {change} from before the run to after it"


def _direction(v: Values) -> str:
    cure = "check the transducer's own angle offset, or the inclination of its frame"
    if v["better_deg"] is not None:
        cure = f"angle_offset_deg = {v['better_deg']:.2f} in place of {v['offset_deg']:g} would correct it"
    return f"the outboard weight points {v['angle_deg']:+.2f} ± {v['sigma_deg']:.2f} deg off the vertical: {cure}"


def _determination(values: Values) -> str:
    where = ", on the ground" if values["on_ground"] else ""
    axes = f"{values['method']}, {values['frame']} axes{where}, angle offset {values['angle_offset_deg']:g} deg"
    return f"{values['recording']} ({axes})"


def _steered(v: Values) -> str:
    places = "[sensors.ground_speed] x_m and y_m, and those of [wheel]"
    cure = f"declare {places}" if v["lacking"] == "places" else f"name yaw_rate, and declare {places}"
    return f"the vehicle is steered for {v['share']:.0%} of the run, which is excluded: {cure}, to use it"


def _doubted(v: Values) -> str:
    ratio, role = v["ratio"], v["role"]
    cure = "its sign: x is forward" if ratio < 0 else 'its unit: 9.81 says {signal = "...", unit = "g"}'
    return (
        f"the slope of the ground speed is {ratio:.2f} ± {v['sigma']:.2f} times {role}, where 1 is expected: correct "
        f"{cure}; until then it is not used"
    )


SENTENCES: dict[str, Sentence] = {
    RecordingCode.ANOTHER_FILE: (
        "{file} is another recording than the one that {choice} was made of; look at it again"
    ),
    RecordingCode.CLOCK_SET: _clock_set,
    RecordingCode.VALIDITY_UNUSED: (
        '{signal} is not used: add ground_speed_valid = "{signal}" to [signals], so that invalid fixes are excluded'
    ),
    RecordingCode.UNIT_REPLACED: "{role} is taken in {unit}, as vehicle.toml says; the DBC or the file says {written}",
    RecordingCode.PARTS_APART: "{length_s:.2f} s between part {before} and part {after} were not recorded",
    RecordingCode.PARTS_OVERLAP: "part {after} begins {length_s:.2f} s before the last frame of part {before}",
    RecordingCode.READ: "{text}",
    RunCode.LATE_STAMPS: "{role}: samples excluded because their stamps run backward: {count}",
    RunCode.NEVER_USABLE: "{role}: frames came, but never a usable value",
    RunCode.NOT_MEASURED: "{role}: never a usable value; treated as not measured",
    RunCode.NOISE_UNKNOWN: "{role}: too few samples to estimate its noise; declare [sensors.{role}] sigma",
    RunCode.GROUND_SPEED_LATE: (
        "ground speed is {latency_s:.3f} ± {sigma_s:.3f} s late against wheel speed beyond the declared delays: if "
        "the receiver's data sheet allows it, declare [sensors.ground_speed] latency_s = {whole_s:.3f} in place of "
        "{declared_s:g}"
    ),
    RunCode.GROUND_SPEED_EARLY: lambda v: (
        f"ground speed is {abs(v['latency_s']):.3f} ± {v['sigma_s']:.3f} s early against wheel speed: the declared "
        f"latency_s of ground speed ({v['declared_s']:g} s) may be too long, or that of wheel speed "
        f"({v['wheel_declared_s']:g} s) too short, as a toothed ring is late at low speed; check both data sheets "
        "before changing either"
    ),
    RunCode.NO_STANDSTILL: "no standstill: zeros could not be checked",
    RunCode.ZERO_AT_STANDSTILL: _standing,
    RunCode.CHANNEL_GAPS: "{role} is missing for {share:.0%} of the run, and those samples are excluded",
    RunCode.IMPLAUSIBLE: plausibility_sentence,
    RunCode.MOSTLY_STANDING: "the vehicle stands for {share:.0%} of the run",
    RunCode.SLOW_VEHICLE: "a slow vehicle: slip is formed from {least_mps:.2g} m/s on, not from 0.5 m/s",
    RunCode.STALLED: (
        "the wheel stands under torque for {time_s:.1f} s: immobilised, so that this shows neither zero nor noise"
    ),
    RunCode.ROLE_MISSING: _missing,
    RunCode.GNSS_CLOCK_UNKNOWN: "gnss_time: too few epochs to compare the clocks",
    RunCode.CUTOFF_LOWERED: _cutoff,
    RunCode.LITTLE_USED: _little_used,
    RunCode.INERTIA_LEFT: (
        "{role}: the inertia of the parts outboard of the transducer is left in it, for {speed} is missing"
    ),
    RunCode.SPEED_AT_WHEEL: lambda v: (
        f"the ground speed is carried from the antenna to the wheel by {' and '.join(v['roles'])}"
    ),
    RunCode.SPEED_BLENDED: (
        "the ground speed is blended with longitudinal_acceleration: sigma {sigma_mps:.3f} m/s in place of "
        "{before_mps:.3f}"
    ),
    RunCode.STEERED: _steered,
    RunCode.OUTBOARD_BY_ACCELEROMETER: "the outboard mass is compensated with {role}, slope included",
    RunCode.ACCELEROMETER_SLOW: (
        "{role} comes at {rate_hz:.3g} Hz, too slow for the common filter, and is not used: send it at {least_hz:.3g} "
        "Hz or more, or lower --cutoff"
    ),
    RunCode.ACCELEROMETER_DOUBTED: _doubted,
    RunCode.DISTRUSTED: _distrusted,
    RunCode.SENSOR_FAULT: _sensor_fault,
    RunCode.STATUS_NEVER_CAME: "the transducer's status never came: no sample is excluded by it",
    RunCode.STATUS_UNKNOWN: (
        "of {count:,} of {total:,} samples the transducer's status is not known, for it did not come: they are used"
    ),
    RunCode.ENDS_LOST: _ends,
    RunCode.DISTANCE_BRIDGED: "distance: {length_m:.1f} m were not seen and are bridged with the speeds around them",
    RunCode.RUT_NOT_USED: _rut_not_used,
    RunCode.OVERLOADED: _overloaded,
    RunCode.WRONG_SIZE: size_sentence,
    RunCode.ZERO_TAKEN_OFF: _taken_off,
    RunCode.ZERO_OLD: lambda v: f"the zero was taken {age_text(v['age_s'])}: take one before and after every run",
    RunCode.ZERO_TEMPERATURE: "the zero was taken at {zero_degc:.0f} degC, and the run began at {run_degc:.0f} degC",
    RunCode.ZERO_WEIGHT_DECLARED: (
        "the zero is of a standstill in wheel axes: the outboard weight is the declared one"
    ),
    RunCode.ZERO_NOT_TURNED: (
        "the zero is of a standstill: the transducer's rotating zero is not known, and its part at that wheel angle is "
        "taken off the mean of the forces"
    ),
    RunCode.ZERO_MOVED: _moved,
    RunCode.ZERO_LACKING: lambda v: f"{v['source']} has no zero of {', '.join(v['roles'])}",
    RunCode.ZERO_WITHOUT_ANGLE: (
        "of {count:,} of {total:,} transducer samples the wheel angle is not known: only the stationary zero is taken "
        "off"
    ),
    ZeroCode.ONE_WHEEL_ANGLE: (
        "a standstill shows the sum of the stationary and the rotating part at one wheel angle only"
    ),
    ZeroCode.STANDING_ASSUMED: "neither wheel angle nor wheel speed is known: the wheel is taken to stand",
    ZeroCode.ON_GROUND: (
        "on the ground: torque, and drawbar pull only as well as the ground is level and the rut keeps nothing: "
        "{load_share:.1%} of the load is in its sigma"
    ),
    ZeroCode.WEIGHT_TAKEN_OUT: (
        "wheel axes: the declared outboard mass of {mass_kg:g} kg is taken out of both forces, so that what is left is "
        "the bridges' zero; moments about x' and z' still hold the moment of that weight"
    ),
    ZeroCode.SPEED_CHANGED: (
        "the speed went from {from_radps:.2f} to {to_radps:.2f} rad/s: what that takes is out of the torque by the "
        "declared outboard inertia, {inertia_kgm2:g} kg m2"
    ),
    ZeroCode.OUTBOARD_MASS: (
        "the outboard weight is that of {mass_kg:.1f} ± {sigma_kg:.1f} kg, and outboard_mass_kg is {declared_kg:g}: "
        "weigh the parts, or check the transducer's zero and gain"
    ),
    ZeroCode.OUTBOARD_DIRECTION: _direction,
    ZeroCode.NOT_COMPARABLE: lambda v: (
        f"{_determination(v['before'])} and {_determination(v['after'])} cannot be compared"
    ),
    ZeroCode.STOOD_ELSEWHERE: "the wheel stood {apart_deg:.0f} deg further on: a rotating zero looks like drift",
    ZeroCode.NOT_IN_BOTH: "{channel}: not in both, or in another unit",
    ZeroCode.DISTRUSTED: "{count:,} samples excluded because the transducer's status is not 0",
    ZeroCode.WARMED_UP: (
        "the transducer went from {from_degc:.0f} to {to_degc:.0f} degC meanwhile: let it warm up first"
    ),
}
