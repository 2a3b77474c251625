"""What is impossible about a run, which mistake would explain it, and the line of vehicle.toml that mends it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, nan
from typing import Any

from daq import ROLES, Fault, Note, number
from processing import RunCode
from processing.referee import BY_KEY, Kind, Mend

Values = Mapping[str, Any]
ANYWAY = "--accept-implausible"
_EXPECTED = (
    "torque and slip of one sign, ground speed near rim speed where there is little torque, no more power out than in"
)
_WHY = {
    "turned": 'sinkage is above the ground: write {role} = "-{signal}" under [signals] of vehicle.toml',
    "radians": "the positions move a 57th as far as the vehicle: "
    'write unit = "rad" for latitude and longitude under [signals] of vehicle.toml',
    "time": "the vehicle drives {size:.3g} times as far as the positions move, so that time seems to be in {units[0]} "
    'and taken for seconds: write time_unit = "{units[0]}" under [series] of vehicle.toml',
    "changed": "{role} changes to or from {units[0]} after {size:.1f} s, at once, and the other speed goes on: "
    "export the run anew, or leave that part out by keep in choice.toml and go on",
    "sigma": "sigma = {size:g} under [sensors.{role}] of vehicle.toml, where one sample differs from the next by "
    "{least:.3g}, and the largest are {most:.3g}: give it in {units[0]}",
}
_UNIT_NAMES = {"in": "inches", "kt": "knots", "kNm": "kN m"}


def plausibility_sentence(v: Values) -> str:
    """Return what is noted of a run that is implausible or impossible as declared."""
    found = f"{_found(v)}; expected {_EXPECTED}; " if isfinite(v["slip"]) else ""
    return f"{_what(v)}: {found}{_next_step(v)}"


def without_numbers(note: Note) -> Note:
    """Return a note that is the same for runs with the same mistake."""
    without = {key: nan for key in ("slip", "load_n", "size") if key in note.values}
    return replace(note, values={**note.values, **without})


def size_sentence(v: Values) -> str:
    """Return what is noted of a channel whose values are beyond what is possible."""
    if v["why"]:
        return _WHY[v["why"]].format(**v)
    role, units = ROLES[v["role"]], " or ".join(f'unit = "{unit}"' for unit in v["units"])
    reached = f" {number(v['size'], 3)} {role.unit_text}" if isfinite(v["size"]) else " what is impossible"
    return (
        f"{role.name} reaches{reached}, where {v['least']:g} to {v['most']:g} {role.unit_text} is possible: "
        f"write {units or 'its unit'} for {v['role']} under [signals] of vehicle.toml"
    )


def refusal(note: Note, where: str) -> Fault:
    """Return the fault of a run that is refused; `where` names the run and its vehicle.toml."""
    v = note.values
    if note.code == RunCode.WRONG_SIZE:
        return Fault(f"the run is impossible as it is declared: {size_sentence(v)}", where, next_step=ANYWAY)
    return Fault(_what(v), where, _found(v), _EXPECTED, f"{_next_step(v)}. To go on as it is: {ANYWAY}")


def _what(v: Values) -> str:
    return (
        "the run is impossible as it is declared (sound with less than 0.1 %)"
        if v["sound"] < 1e-3
        else f"the run is improbable as it is declared (sound with {100 * v['sound']:.2g} %)"
    )


def _found(v: Values) -> str:
    parts = [
        ("median slip {:.2f}", v["slip"], 1.0),
        ("torque / (radius x load) up to {}", v["traction"], None),
        ("drawbar pull up to {} of the load", v["pull"], None),
        ("load {} of the weight", v["load_share"], None),
        ("ground speed {} of that of the positions", v["track"], None),
    ]
    found = [text.format(value if kind else number(value, 2)) for text, value, kind in parts if isfinite(value)]
    return ", ".join(found)


def _next_step(v: Values) -> str:
    rows = zip((BY_KEY[key] for key in v["mends"]), v["shares"], strict=True)
    steps = [f"{_mistake(mend)} ({_share(share)}): {_cure(mend, v)}" for mend, share in rows]
    step = steps[0] if len(steps) == 1 else f"one of these: {'; or '.join(steps)}"
    if held := v.get("held"):
        same = [f"{ROLES[role].name} stays the same for {time_s:.1f} s" for role, time_s in held.items()]
        return f"{', '.join(same)}: check the sensor and drive again. If it is sound, {step}"
    return step


def _share(share: float) -> str:
    return "more than 99.9 %" if share > 0.999 else f"{100 * share:.3g} %"


def _mistake(mend: Mend) -> str:
    if mend.kind is Kind.UNLISTED:
        return "no single mistake that is known explains it"
    if mend.kind is Kind.EXCHANGED:
        return f"{_names(mend.roles)} seem to be exchanged"
    verb = "seem" if len(mend.roles) > 1 else "seems"
    if mend.kind is Kind.SIGN:
        return f"{_names(mend.roles)} {verb} to have the wrong sign"
    if mend.kind is Kind.UNIT:
        units = [_UNIT_NAMES.get(unit, unit) for unit in dict.fromkeys(mend.units.values())]
        return f"{_names(mend.roles)} {verb} to be in {' and '.join(units)}"
    [(role, unit)] = mend.units.items()
    return f"{_names([role])} {verb} to be in {ROLES[role].unit_text}, and is taken for {_UNIT_NAMES.get(unit, unit)}"


def _names(roles: Sequence[str]) -> str:
    names = [ROLES[role].name if role in ROLES else "[wheel] radius_m" for role in roles]
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else names[0]


def _cure(mend: Mend, v: Values) -> str:
    if mend.kind is Kind.UNLISTED:
        return (
            "check unit, sign and name of every speed, force and torque, [wheel] radius_m, and whether one of them "
            "changes within the run"
        )
    if "radius_m" in mend.factors:
        return f"write radius_m = {v['radius_m'] * mend.factors['radius_m']:.4g} under [wheel] of vehicle.toml"
    lines = [_line(role, mend, v) for role in mend.roles]
    return f"write {' and '.join(lines)} under [signals] of vehicle.toml"


def _line(role: str, mend: Mend, v: Values) -> str:
    """Return the line of a role that undoes a mistake."""
    source = role
    if mend.exchanged:
        source = mend.exchanged[1] if role == mend.exchanged[0] else mend.exchanged[0]
    signal = v["signals"].get(source, "Message.Signal")
    unit, sign = v["units"].get(source, ""), v["signs"].get(source, 1)
    if mend.kind is Kind.SIGN:
        sign = -sign
    elif mend.kind is Kind.UNIT:
        unit = mend.units[role]
    elif mend.kind is Kind.DECLARED:
        unit = ROLES[role].unit
    if not unit:
        return f'{role} = "{"-" if sign < 0 else ""}{signal}"'
    return f'{role} = {{signal = "{signal}", unit = "{unit}"{", sign = -1" if sign < 0 else ""}}}'
