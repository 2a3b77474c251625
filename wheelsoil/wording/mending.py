"""What to do after a diagnosis: each step with its reason, and the command or the lines of a file to paste."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from shlex import quote

from daq import Note, VehicleConfig, number, zero_file_name
from model import DiagnosisCode, LackCode, StepCode
from model.diagnosis import Cause, Diagnosis, Kind, NextRun, Rows
from model.effects import EFFECTS, Effect, Remedy, parted
from wheelsoil.wording.grounds_text import findings_text, unsure_words
from wheelsoil.wording.names import listed, plain_name, plain_names, upper, with_chance
from wheelsoil.wording.notes import key_text, naming_text, note_text, odds_text, step_text
from wheelsoil.wording.verdict import (
    against_tests,
    deciding_runs,
    groups_of_runs,
    like_radius,
    runs_apart,
    several_terrains,
    terrains_step,
)

_LIFTED = (
    "# record the lifted wheel as spin.mcap, then:\nwheelsoil zero spin.mcap --vehicle vehicle.toml\n"
    '# then:\n[transducer]\nzero_file = "zero.toml"'
)
_LINES: dict[str, str] = {
    StepCode.LIFTED_ZERO: _LIFTED,
    StepCode.RUT: "[[run.rut]]\ndepth_m = READING\nsigma_m = SIGMA\ntime_s = TIME  # or distance_m; one for each place",
    StepCode.KNOWN_PULL: (
        '[[static]]\ntest = "known_pull"\napplied_n = FORCE  # about {pull_n:.0f}\ndrawbar_pull_n = READING\n'
        "drawbar_pull_sigma_n = SIGMA"
    ),
    StepCode.KNOWN_TORQUE: (
        '[[static]]\ntest = "known_torque"\napplied_nm = TORQUE  # about {torque_nm:.0f}; or applied_n and lever_m\n'
        "driving_torque_nm = READING\ndriving_torque_sigma_nm = SIGMA"
    ),
}
"""Of a step, to paste: in runs.toml the words in capitals are no TOML until a number is put in their place."""
_RELEASED = '# in the vehicle.toml of that run only\n[vehicle]\nstandstill_brakes = "released"'
_RADIUS = "Measure the wheel's radius from hub to ground; diagnose again."
_BOTH_RADII = "Measure the wheel's radius from hub to ground, and the rolling radius on firm ground; diagnose again."
_ROLLING = "Write the rolling radius into vehicle.toml that the coasting wheel and these runs show."
_REPEAT = "Repeat the static test, and take it out of runs.toml if it was wrong; diagnose again."
PROBABLE = 0.5
_MOST_FILES = 12
"""Files that a command names."""


@dataclass(frozen=True)
class Step:
    """A thing to do next, why, and the command or the lines of a file to paste; where there are several, its campaign.

    `what` then begins with the campaign.
    """

    what: str
    why: str = ""
    paste: str = ""
    campaign: str = ""


def next_steps(
    found: Diagnosis, vehicle: VehicleConfig, wheels: Mapping[str, VehicleConfig] | None = None
) -> list[Step]:
    """Return what parts two terrains, else runs up to three, what removes named causes, and what decides most.

    Of all wheels together `wheels` has the configuration of each, in place of `vehicle` for a cause at one of them.
    """
    if several_terrains(found) is not None:
        return [parting_step(found)]
    runs, steps = deciding_runs(found), [*_mending_steps(found, vehicle, wheels or {})]
    missing = missing_step(found) if steps or not runs else None
    if found.verdict == "named" and not steps and not runs:
        steps = [(step_of(found), vehicle)]
    steps += [(step, vehicle) for step in (missing, *(_step_of_run(run, found) for run in runs)) if step]
    return [*_up_to_three(found), *(replace(step, paste=_of_wheel(step.paste, of)) for step, of in steps)]


def first_steps(
    found: Diagnosis,
    vehicle: VehicleConfig,
    wheels: Mapping[str, VehicleConfig] | None = None,
    *,
    saved: bool = False,
) -> list[tuple[str, Step]]:
    """Return the first of `next_steps` in a sentence; of named causes what removes each of them.

    Where the model is `saved` already, nothing asks to save it.
    """
    steps = next_steps(found, vehicle, wheels) or [step_of(found)]
    if saved and found.verdict == "named":
        steps = [Step(step.why) if step.what == step_of(found).what else step for step in steps]
    count = sum(1 for _ in _mending_steps(found, vehicle, wheels or {})) if found.verdict == "named" else 1
    whats = [step.what if step.campaign else f"{step.what[0].lower()}{step.what[1:]}" for step in steps]
    texts = [f"{'Also' if i else 'Next'}: {what.rstrip('.')}." for i, what in enumerate(whats)]
    return list(zip(texts, steps, strict=True))[: max(count, 1)]


def _mending_steps(
    found: Diagnosis, vehicle: VehicleConfig, wheels: Mapping[str, VehicleConfig]
) -> Iterator[tuple[Step, VehicleConfig]]:
    """Yield what mends static tests, the radius, runs and causes, each with the vehicle whose files it is about."""
    alike = [note for note in like_radius(found) if note.values["larger_m"]]
    coasted = any(test.wheel_speed_radps for test in found.static)
    for note in against_tests(found):
        yield Step(_REPEAT, f"{upper(note_text(note))}."), vehicle
    for note in alike:
        yield _radius_or_lugs(note), wheels.get(note.values["wheel"], vehicle)
    for cause in found.causes if found.verdict == "one_of" and not alike else ():
        if cause.probability > PROBABLE and _corrects_rolling(cause):
            probably = f"Probably wrong: {with_chance(cause.name, cause.probability)}."
            yield Step(_RADIUS if coasted else _BOTH_RADII, probably), vehicle
    for note in runs_apart(found).values():
        yield _apart_step(note), vehicle
    looks_alike = [note.values["family"] for note in alike]
    for cause in found.causes if found.verdict == "named" else ():
        if cause.name not in looks_alike and (cause.kind == "measurement" or EFFECTS.get(cause.key, Effect).remedy):
            of = wheels.get(parted(cause.name)[1], vehicle)
            step = mending_of(cause, of, table=bool(found.grounds.table_channels))
            yield replace(step, what=_ROLLING) if coasted and step.paste and _corrects_rolling(cause) else step, of
    if found.verdict == "unexplained" and not found.grounds.table_channels:
        yield parting_step(found) if groups_of_runs(found) else residual_step(found), vehicle


def _corrects_rolling(cause: Cause) -> bool:
    remedy = EFFECTS.get(cause.key, Effect).remedy
    return remedy is not None and "rolling_radius_m" in remedy.keys


def _up_to_three(found: Diagnosis) -> list[Step]:
    """Return how many runs to drive first where there are fewer than three: then no cause is named, whatever it is."""
    return [
        Step(
            f"Drive {'one run' if lacking == 1 else f'{lacking} runs'} more like the others, so that there are three.",
            "With fewer no name can be checked against other runs, so that none is given.",
        )
        for note in found.notes
        if note.code == DiagnosisCode.FEW_RUNS
        for lacking in [3 - note.values["runs"]]
    ]


def _of_wheel(paste: str, vehicle: VehicleConfig) -> str:
    """Return commands and lines, with what is done with a table; of one of several `[[wheel]]` as it is there."""
    paste = re.sub(r"^(\[[\w.]+\])$", r"\1  # add to the one in the file", paste, flags=re.MULTILINE)
    if not vehicle.wheel_option:
        return paste
    of = f"  # of wheel {vehicle.wheel_ids[0]}:"
    texts = {
        "[wheel]  #": f"[[wheel]]{of}",
        "[transducer]  #": f"[wheel.transducer]{of}",
        "vehicle.toml\n": f"vehicle.toml{vehicle.wheel_option}\n",
        **{table: f'{table}wheel = "{vehicle.wheel_ids[0]}"\n' for table in ("[[static]]\n", "[[run.rut]]\n")},
        '"zero.toml"': f'"{zero_file_name(vehicle)}"',
    }
    return reduce(lambda text, part: text.replace(*part), texts.items(), f"{paste}\n").removesuffix("\n")


def parting_step(found: Diagnosis) -> Step:
    """Return how to part runs that are probably not of one soil into two folders."""
    note = several_terrains(found)
    files = note.values.get("files", ()) if note is not None else ()
    moved = f"mkdir ../second\ncp *.toml *.dbc ../second\nmv {' '.join(files)} ../second"
    lines = [moved, "# then write its soil into ../second/terrain.toml"]
    paste = "\n".join(lines) if 0 < len(files) <= _MOST_FILES else ""
    before = "" if note is not None else "if these are two soils, "
    return Step(f"{upper(before + terrains_step(found))}.", "Until then rely on no cause.", paste)


def _radius_or_lugs(note: Note) -> Step:
    """Return what decides between a cause and another wheel radius, with the lines for each outcome."""
    declared, larger = note.values["radius_m"], note.values["radius_m"] + note.values["larger_m"]
    of_tyre = any(effect.like_radius for effect in EFFECTS.values() if effect.name == parted(note.values["family"])[0])
    lines = (
        f"# if the radius is about {larger:.3f} m: the measured value\n[wheel]\nradius_m = {larger:.4f}",
        f'# if it is {declared:g} m, and the tyre has lugs\n[wheel]\ntyre = "lugged"',
        f'# if it is {declared:g} m, and the tyre has none\n[wheel]\ntyre = "smooth"',
    )
    what = f"Measure the wheel's radius from hub to ground{', declare the tyre,' * of_tyre} and diagnose again."
    return Step(what, f"{upper(note_text(note))}.", "\n".join(lines if of_tyre else lines[:1]))


def _apart_step(note: Note) -> Step:
    run, zero = note.values["run"], plain_name(note.values["family"])
    what = f"Check the {zero} in {run}; if it is off, switch the run off and diagnose again."
    own = run.removeprefix(f"{note.values['campaign']}: ")
    off = f'schema = "wheelsoil/choice/1"\n[[run]]\nid = "{own}"\nuse = false  # diagnose FOLDER --choice choice.toml'
    return Step(what, f"{upper(note_text(note))}.", off)


def residual_step(found: Diagnosis) -> Step:
    """Return what to look at where nothing explains the runs: the channel in which the residual is, where it is one."""
    role, worst = doubted_channel(found), found.grounds.lack_of_fit.worst
    if not role:
        return step_of(found)
    where = findings_text([w for w in found.what_is_wrong if w.channel == role][:2] or worst)
    return Step(_CHECKS[role], f"Residual: {where}. Until then do not rely on the model.")


def doubted_channel(found: Diagnosis) -> str:
    """Return the role to which the residual of unexplained runs points; "" where it points to several."""
    roles = {
        finding.channel
        if isinstance(finding.place, Rows)
        else _ROLE_OF_KIND.get(Kind(finding.place.kind), finding.channel)
        for finding in found.grounds.lack_of_fit.worst
    }
    return roles.pop() if found.grounds.barred is None and len(roles) == 1 else ""


def step_of(found: Diagnosis) -> Step:
    """Return the step that a verdict asks for where nothing has to be mended and no run decides."""
    if found.grounds.undecided is not None:
        faults = found.grounds.undecided.values.get("faults", ())
        told = dict.fromkeys(fault.next_step for fault in faults if fault.next_step)
        return Step(upper("; ".join(told) or "give what is missing") + ".")
    if found.verdict == "unexplained":
        checked, then = "runs are on one soil.", ""
        if found.grounds.table_channels:
            checked, then = "rows are of one wheel and one soil.", "Then repeat the rows that are off most."
        return Step(
            "Look at what is wrong, and where: nothing known explains it, so do not rely on the model there. "
            f"Check zeros, signs and configuration first, and whether all {checked}",
            then,
        )
    if found.verdict == "named":
        doubt = found.grounds.beside and not found.grounds.table_channels
        what = "model, averaged over what may act beside the named causes," if doubt else "recommended model"
        advice = f"Save the {what} for fit, simulate and report."
        decided = "No further run is needed for the name." if not deciding_runs(found) else ""
        return Step(advice, decided, "" if found.grounds.table_channels else "wheelsoil diagnose FOLDER -o model.toml")
    return Step(
        "Drive another run: these do not decide whether a cause acts."
        if unsure_words(found)
        else "No further run is asked for; see the minimum detectable effect."
    )


def _step_of_run(run: NextRun, found: Diagnosis) -> Step:
    open_ones = {cause.name for cause in found.causes} if found.verdict == "one_of" else {""}
    names = listed([plain_name(name) for name in run.separates])
    parted = "them" if open_ones <= set(run.separates) else names
    tells = f"; expected odds {odds_text(run.expected_log_bayes_factor)}"
    if named := naming_text(run):
        tells = f": the right name in {named} of such cases, else none"
    cost = f"; as long as {number(run.cost_runs, 2)} runs" if run.cost_runs > 1 else ""
    decides = f"Decides whether {names} acts" if len(run.separates) == 1 else f"Separates {parted}"
    reason = [f"{decides}{tells}{cost}."] if parted else []
    written = [f"Write {key}."] if (key := key_text(run)) and run.step.code != StepCode.LIFTED_ZERO else []
    what = step_text(run) if run.campaign else upper(step_text(run))
    paste = _LINES.get(run.step.code, "").format(**run.step.values)
    return Step(what, " ".join([*reason, *written]), paste, run.campaign)


def mending_of(cause: Cause, vehicle: VehicleConfig, *, table: bool = False) -> Step:
    """Return how to remove a measurement cause at a wheel of a vehicle, or to check it where no file can.

    A table of single-wheel tests has columns and no DBC.
    """
    effect, wheel = EFFECTS.get(cause.key, Effect), parted(cause.name)[1]
    size, remedy = cause.parameters[0].value if cause.parameters else 0.0, effect.remedy or Remedy()
    if remedy.scales:
        step = _gain(effect.shows[0], 1 / (1 + size), vehicle, table=table)
    elif effect.needs.zero_of:
        step = Step("Determine the zero with the wheel lifted, and name its file in vehicle.toml.", paste=_LIFTED)
    else:
        known = [each for each in remedy.corrections if vehicle.wheel or not each.share_of]  # no share of nothing
        lines = (line for each in known for line in (each.section, each.line(vehicle, size)))
        step = Step(remedy.what, paste=remedy.paste or "\n".join(dict.fromkeys(lines)))
    return replace(step, what=f"At wheel {wheel}: {step.what[:1].lower()}{step.what[1:]}") if wheel else step


def missing_step(found: Diagnosis) -> Step | None:
    """Return what would make the causes identifiable that the verdict says are not; None where no run does."""
    wanting = [f for f, why in found.not_identifiable.items() if why.code is LackCode.NOT_AT_STANDSTILL]
    lacking = plain_names(dict.fromkeys(parted(family)[0] for family in wanting))
    if not lacking or found.grounds.table_channels:
        return None
    why = (
        f"These runs do not show {listed(lacking)}: their brakes were held, or are not declared. Put the new run in a "
        "folder of its own, and diagnose both folders together."
    )
    return Step("Drive another run with a standstill of 10 s, brakes released", why, _RELEASED)


def _gain(role: str, scale: float, vehicle: VehicleConfig, *, table: bool) -> Step:
    """Return how to scale one channel: its column, or its signal in a DBC that is of its bus alone."""
    begun = f"Calibrate the {role.replace('_', ' ')}: these runs suggest {scale:.3f} times"
    if table:
        unit = "nm" if role == "driving_torque" else "n"
        return Step(f"{begun} today's values of its column.", paste=f"--rename {role}_{unit}=COLUMN*{scale:.3f}")
    name = vehicle.signals[role].signal if role in vehicle.signals else ""
    if name and not vehicle.bus:
        return Step(f"{begun} today's values of the column {name}.")
    channel, _, signal = name.rpartition(":")
    own = next((bus.dbc for bus in vehicle.bus if bus.channel == channel), ())
    others = [bus for bus in vehicle.bus if bus.channel != channel and {*bus.dbc} & {*own}]
    if not others:
        return Step(f"{begun} today's scale in the DBC.")
    shared = [file for file in own if any(file in bus.dbc for bus in others)]
    copies = {file: f"{file.removesuffix('.dbc')}-{channel}.dbc" for file in shared}
    what = f"{begun} today's scale of {signal} on {channel}, in a copy of {listed(shared)} for {channel} alone."
    files = ", ".join(f'"{copies.get(file, file)}"' for file in own)
    lines = [f"cp {quote(file)} {quote(copy)}" for file, copy in copies.items()]
    lines += [f"# scale {signal} in the copy, and change:", "[[bus]]", f'channel = "{channel}"', f"dbc = [{files}]"]
    why = f"Scaled in {listed(shared)} itself, it changes {listed([bus.channel for bus in others])} too."
    return Step(what, why, "\n".join(lines))


_ROLE_OF_KIND = {
    Kind.DRAWBAR_PULL: "drawbar_pull",
    Kind.DRAWBAR_PULL_SQUARED: "drawbar_pull",
    Kind.DRAWBAR_PULL_DRIFT: "drawbar_pull",
    Kind.TORQUE: "driving_torque",
    Kind.TORQUE_SQUARED: "driving_torque",
    Kind.TORQUE_DRIFT: "driving_torque",
    Kind.SPEED_ERROR: "ground_speed",
    Kind.LOAD_ERROR: "vertical_load",
    Kind.LOAD_ERROR_WITH_LOAD: "vertical_load",
}
"""Channel that a shape of the residual points to, whichever channel shows it."""
_CHECKS = {
    "drawbar_pull": "Check the drawbar pull against known pulls in both directions: a load cell on the lifted wheel.",
    "driving_torque": "Check the driving torque against known torques: a lever and weights on the lifted wheel.",
    "vertical_load": "Check the vertical load on scales, at two loads.",
    "ground_speed": "Check the ground speed against a second receiver, or a measured distance.",
    "sinkage": "Check the sinkage against the depth of the rut, by a ruler.",
}
