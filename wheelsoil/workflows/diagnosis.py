"""From opened runs, a bench table or the plan of a campaign to a diagnosis: for `diagnose`, `report` and `demo`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from daq import (
    OUTPUTS,
    REACTIONS,
    ROLES,
    ConfigError,
    Fault,
    Note,
    RunInfo,
    RunsConfig,
    Severity,
    SoilSection,
    StaticTest,
    VehicleConfig,
    WheelSection,
    contradict,
    load_toml,
    nearest,
)
from daq.runs import RUNS_FILE, TERRAIN_FILE, VEHICLE_FILE, Collected, Run
from model import DiagnosisCode
from model.diagnosis import (
    ROLLING_RADIUS_SHARE,
    Bench,
    Campaign,
    Cause,
    Diagnosis,
    DiagnosisOptions,
    Lugs,
    OfVehicle,
    rolled,
)
from model.effects import EFFECTS, Effect, Remedy, parted
from model.wheel_soil import Reading, prior_of
from processing import ProcessedRun
from wheelsoil.cache.store import kept, known
from wheelsoil.workflows.fit import known_soil, load_terrain, observations_of_table, wheel_of
from wheelsoil.workflows.runs import Files
from wheelsoil.workflows.tables import BenchFiles
from wheelsoil.workflows.traction import at_usual_slip

if TYPE_CHECKING:
    from model.diagnosis import Plan

Processed = Sequence[tuple[Run, ProcessedRun]]

_ALMOST_AS_WELL = 0.05
"""Posterior probability from which on a set of causes is not separable from the others."""
_ONE_TERRAIN = 0.1
"""Scatter of tan phi from run to run that one terrain may have."""
_SURPRISING = 2.0
"""The same, in one-sigmas of the laboratory's tan phi."""
_APART = 2.0
"""Gap between two groups of runs in Dp/W at slip 0.2, over the wider of them, from which on they are stated."""
_KINDS = ("physical", "measurement")
_OF_SENSORS = (DiagnosisCode.WHEEL_ORDER, DiagnosisCode.ZEROS_DIFFER)
_UNNAMED = "runs"
"""Name of a campaign without a folder, on a soil without a name."""
_SHORTEST_S, _LONGEST_S = 10.0, 600.0
_MOST_RUNS = 40
_LARGEST_FORM = 50.0
_LEAST_FORCE = 0.01  # of a static test, over the load, or load x radius
_MOST_OFF = 0.2
"""Share by which a wheel may coast on another rolling radius than declared; it is as far as a cause may go."""
_ROLLS_AS_DECLARED = (-2.0 * ROLLING_RADIUS_SHARE, 2.0 * ROLLING_RADIUS_SHARE)

Given = tuple[Campaign, ...] | tuple[Bench, ...]


def diagnosis_options(
    reading: Reading = "balanced",
    *,
    effects: Iterable[str] = (),
    without: Iterable[str] = (),
    channels: Sequence[str] = tuple(OUTPUTS),
    most_causes: int = 3,
    seed: int = 0,
    next_run: bool = False,
    error_of_form: float | None = None,
) -> DiagnosisOptions:
    """Return the options of a diagnosis.

    Parameters
    ----------
    reading : "balanced" or "literal"
        Of the simulation under test.
    effects, without : iterable of str
        Consider only the first (none given: all), and none of the second: effects, families, "physical" or
        "measurement".
    channels : of "dp", "t", "z"
    most_causes, seed, next_run
        See `DiagnosisOptions`.
    error_of_form : float, optional
        In percent; see `DiagnosisOptions`.

    Raises
    ------
    ConfigError
        Everything that is wrong with them.
    """
    faults = [
        Fault(f"there is no channel {c!r} to diagnose", expected=", ".join(OUTPUTS), next_step="use --channels dp,t,z")
        for c in channels or ("",)
        if c not in OUTPUTS
    ]
    wanted, unwanted = list(effects), list(without)
    faults += [_unknown(name) for name in (*wanted, *unwanted) if not _keys(name)]
    chosen = tuple(
        key
        for key in EFFECTS
        if (not wanted or any(key in _keys(name) for name in wanted))
        and not any(key in _keys(name) for name in unwanted)
        and EFFECTS[key].reading in ("any", reading)
    )
    if not faults and not chosen:
        faults.append(_nothing_left(reading))
    if not 1 <= most_causes <= 3:
        faults.append(Fault("--most-causes is out of range", found=str(most_causes), expected="1 to 3"))
    if error_of_form is not None and not 0 < error_of_form <= _LARGEST_FORM:
        expected = f"above 0, up to {_LARGEST_FORM:g} (percent of load, load x radius and radius)"
        faults.append(Fault("--error-of-form is out of range", found=f"{error_of_form:g}", expected=expected))
    if faults:
        raise ConfigError(*faults)
    return DiagnosisOptions(
        reading=reading,
        effects=chosen,
        channels=tuple(channels),
        most_causes=most_causes,
        seed=seed,
        next_run=next_run,
        error_of_form=None if error_of_form is None else error_of_form / 100.0,
    )


def _keys(name: str) -> tuple[str, ...]:
    """Return the effects that an effect's, a family's or a kind's name stands for."""
    return tuple(key for key, effect in EFFECTS.items() if name in (key, effect.name, effect.kind))


def _unknown(name: str) -> Fault:
    known = {*EFFECTS, *(effect.name for effect in EFFECTS.values()), *_KINDS}
    return Fault(
        f"no effect or family is called {name!r}",
        expected=nearest(name, known),
        next_step="correct the name; docs/effects lists all",
    )


def _nothing_left(reading: Reading) -> Fault:
    literal = " and ".join(key for key, effect in EFFECTS.items() if effect.reading == "literal")
    return Fault(
        "no cause is left to consider",
        found=f"{reading} reading",
        next_step=f"take more into --effects, or less into --without; {literal} needs --sinkage literal",
    )


def campaigns_of(paths: Sequence[Path], processed: Processed, soil: str | None = None) -> tuple[Campaign, ...]:
    """Group processed runs into campaigns: one for each folder, soil and wheel.

    Parameters
    ----------
    paths : sequence of Path
        What was given: a run belongs to the folder that it lies in; those of no folder are grouped by soil and wheel.
    processed : sequence of (Run, ProcessedRun)
    soil : str, optional
        A preset instead of terrain.toml.

    Raises
    ------
    ConfigError
        A soil or a wheel is not known.
    """
    return _with_unique_names([campaign for _, campaign in _campaigns(paths, processed, soil)])


def _campaigns(paths: Sequence[Path], processed: Processed, soil: str | None) -> list[tuple[Together, Campaign]]:
    groups: dict[Together, list[tuple[Run, ProcessedRun]]] = {}
    for run, done in processed:
        groups.setdefault(together(run, paths, soil), []).append((run, done))
    collected = Collected()
    found: list[tuple[Together, Campaign]] = []
    for group, members in groups.items():
        with collected.catch():
            campaign = _campaign(group.folder, members, soil)
            # the static tests of a folder count once
            counted = any(campaign.static and campaign.static == other.static for _, other in found)
            found.append((group, replace(campaign, static=()) if counted else campaign))
    collected.stop_if_any()
    return found


def vehicles_of(
    paths: Sequence[Path], wheels: Mapping[str, Processed], soil: str | None = None
) -> tuple[Campaign, ...]:
    """Group the runs of several wheels into campaigns of their vehicles: one for each folder, soil and wheel.

    Those of one folder and soil are driven together: on one soil, with one receiver.

    Parameters
    ----------
    paths, soil
        See `campaigns_of`.
    wheels : mapping wheel -> processed runs
    """
    places: dict[tuple[str, SoilSection | None], list[tuple[str, Campaign]]] = {}
    for wheel, processed in wheels.items():
        for group, campaign in _campaigns(paths, processed, soil):
            places.setdefault((group.folder, group.ground), []).append((wheel, campaign))
    firsts = _with_unique_names([members[0][1] for members in places.values()])
    found = [
        replace(
            campaign,
            name=f"{f'{first.name}, ' if len(places) > 1 else ''}wheel {wheel}",
            of_vehicle=OfVehicle(first.name, wheel, coasted=max(1, sum(map(_coasted, members)))),
        )
        for first, members in zip(firsts, places.values(), strict=True)
        for wheel, campaign in members
    ]
    return _with_unique_names(found)


def _coasted(member: tuple[str, Campaign]) -> bool:
    return any(test.wheel_speed_radps for test in member[1].static)


class Together(NamedTuple):
    """What the runs of one campaign share; `folder` is empty for runs of no given folder."""

    folder: str
    ground: SoilSection | None
    wheel: WheelSection | None


def together(run: Run, paths: Sequence[Path], soil: str | None) -> Together:
    """Return what a run shares with the others of its campaign; see `campaigns_of`."""
    inside = [path for path in paths if path.is_dir() and path.resolve() in run.path.resolve().parents]
    ground = run.terrain.soil if run.terrain and soil is None else None
    return Together(str(inside[0]) if inside else "", ground, run.vehicle.wheel)


def _campaign(folder: str, members: Processed, soil_name: str | None) -> Campaign:
    first = members[0][0]
    terrain = first.terrain if soil_name is None else None
    soil = known_soil(soil_name, terrain)
    declared = first.vehicle.wheel
    _check_static(first, [run for _, run in members])
    _check_rolled(first)
    return Campaign(
        name=Path(folder).resolve().name if folder else soil.name or _UNNAMED,
        runs=tuple(run for _, run in members),
        wheel=wheel_of(first.vehicle, first.vehicle_source),
        soil=soil,
        soil_prior=prior_of(soil, terrain),
        tyre=declared.tread if declared else "",
        outboard_mass_kg=declared.outboard_mass_kg if declared else 0.0,
        outboard_inertia_kgm2=declared.outboard_inertia_kgm2 if declared else 0.0,
        static=first.static,
        commanded_slip="slip" in first.vehicle.signals,
    )


def _check_static(run: Run, members: Sequence[ProcessedRun]) -> None:
    """Refuse static tests in wheel axes, of a wheel of another size, and of another zero than was taken off."""
    where = f"{run.path.parent / RUNS_FILE}, [[static]]"
    if any(test.readings for test in run.static) and run.vehicle.transducer.frame == "wheel":
        raise ConfigError.of(
            "static tests of a transducer that reads in wheel axes",
            where,
            "",
            "readings in vehicle axes",
            "take the tests out: a force that turns with the wheel is no zero of the drawbar pull",
        )
    for number, test in enumerate(run.static):
        radius_m, usual_m = (test.ground_speed_mps or 0.0) / (test.wheel_speed_radps or 1.0), members[0].rolling_m
        if test.wheel_speed_radps and abs(radius_m / usual_m - 1.0) > _MOST_OFF:
            raise ConfigError.of(
                f"{_called(number, test)} coasts on another radius than that of the slip",
                f"run {test.run} on firm ground" if test.run else where,
                f"ground speed / wheel speed is {radius_m:.3g} m, that is {radius_m / usual_m:.3g} times {usual_m:g} m",
                f"{1.0 - _MOST_OFF:g} to {1.0 + _MOST_OFF:g} times",
                "check the units of both speeds, and radius_m in vehicle.toml",
            )
        for channel, (reading, sigma) in test.readings.items() if test.test == "lifted" else ():
            role = REACTIONS[channel].role
            zeros = (zero for member in members if (zero := member.quality.zeros.get(role)) and zero.is_known)
            known = next(zeros, None)
            if known and contradict(reading, sigma, known.offset, known.systematic_sigma):
                raise ConfigError.of(
                    f"{_called(number, test)} reads another zero of {ROLES[role].name} than "
                    f"{', '.join(known.recordings)}",
                    where,
                    f"{reading:g} and {known.offset:.4g} {ROLES[role].unit_text}",
                    "the same within five sigmas",
                    "take out the wrong one; beside a zero_file a lifted reading adds nothing",
                )


def _called(number: int, test: StaticTest) -> str:
    """Return what a user knows a static test by: its run, or its place in runs.toml; of a wheel, among its own."""
    among = test.wheel and f" of those of wheel {test.wheel}"
    return f"run {test.run}" if test.run else f"[[static]] {number + 1}{among}"


def _check_rolled(run: Run) -> None:
    """Refuse tests of a coasting wheel that roll on different radii."""
    radii = {_called(i, test): radius for i, test in enumerate(run.static) if (radius := rolled(test))}
    for name, other in combinations(radii, 2):
        if contradict(*radii[name], *radii[other]):
            raise ConfigError.of(
                f"{name} and {other} contradict each other: a coasting wheel rolls on one radius",
                f"{run.path.parent / RUNS_FILE}",
                f"{radii[name][0]:.4g} and {radii[other][0]:.4g} m",
                "the same within five sigmas",
                "take out the wrong one, or switch the run off in choice.toml",
            )


def _with_unique_names(campaigns: Sequence[Campaign]) -> tuple[Campaign, ...]:
    """Add a number to each name that several campaigns have."""
    names = [campaign.name for campaign in campaigns]
    numbers = [f" ({names[:i].count(name)})" if names.count(name) > 1 else "" for i, name in enumerate(names, 1)]
    return tuple(
        replace(campaign, name=campaign.name + number) for campaign, number in zip(campaigns, numbers, strict=True)
    )


def diagnose_given(given: Given, options: DiagnosisOptions) -> Diagnosis:
    """Diagnose campaigns, or bench tables."""
    campaigns = tuple(campaign for campaign in given if isinstance(campaign, Campaign))
    benches = tuple(wheel_test for wheel_test in given if isinstance(wheel_test, Bench))
    return diagnose_benches(benches, options) if benches else diagnose_campaigns(campaigns, options)


def diagnose_campaigns(campaigns: Sequence[Campaign], options: DiagnosisOptions) -> Diagnosis:
    """Diagnose campaigns jointly: shared causes, a soil for each.

    Raises
    ------
    ConfigError, DataError
        See `model.diagnosis.time_series.diagnosis.diagnose`.
    """
    inputs, without_average = tuple(campaigns), replace(options, average=False)

    def compute() -> Diagnosis:
        from model.diagnosis import diagnose

        before = known("diagnosis", (inputs, without_average)) if options.average else None
        # only where several sets remain possible is there an average: any other diagnosis is the same without one
        decided = before and before.verdict != "one_of" and not before.grounds.beside
        return before if before and decided else diagnose(campaigns, options)

    found: Diagnosis = kept("diagnosis", (inputs, options), compute)
    if options.average:
        kept("diagnosis", (inputs, without_average), lambda: replace(found, average=None))
    return _with_remarks(found, campaigns)


def with_advice(joint: Diagnosis, wheels: Mapping[str, Diagnosis]) -> Diagnosis:
    """Return the diagnosis of all wheels with the next runs of the wheel whose steps separate most of its candidates.

    They are ranked by that wheel alone, so that what they are worth to the name of all is not known. Only a verdict
    `one_of` has any. `wheels` has the diagnosis of each by itself.
    """
    candidates = [parted(cause.name) for cause in joint.causes if joint.verdict == "one_of"]
    listed = [
        (len({family for family, at in candidates if at in ("", wheel)} & {*run.separates}), run, wheel)
        for wheel, found in wheels.items()
        for run in found.next_run
    ]
    best = max(listed, key=lambda each: (each[0], each[1].expected_log_bayes_factor))[2] if listed else ""
    runs = (replace(run, campaign=f"wheel {best}", naming_chance=None) for n, run, at in listed if n and at == best)
    return replace(joint, next_run=tuple(runs))


def known_diagnosis(campaigns: Sequence[Campaign], options: DiagnosisOptions) -> Diagnosis | None:
    """Return what `diagnose_campaigns` returns, where it is kept; else None, without computing it."""
    found: Diagnosis | None = known("diagnosis", (tuple(campaigns), options))
    return None if found is None else _with_remarks(found, campaigns)


def bench_of(files: BenchFiles) -> Bench:
    """Return the rows of a bench table as a diagnosis takes them."""
    table = files.rows
    sigmas = {
        key: float(np.sqrt(np.nanmean(table.sigma[channel.field] ** 2)))
        for key, channel in OUTPUTS.items()
        if channel.field in table.sigma and np.isfinite(table.sigma[channel.field]).any()
    }
    section = files.wheel_section
    return Bench(
        name=files.name or Path(table.name).stem,
        rows=observations_of_table(table),
        wheel=files.wheel,
        soil=files.soil,
        soil_prior=prior_of(files.soil, files.terrain),
        sigmas=sigmas,
        tyre=section.tread,
        lugs=Lugs(section.lug_height_m, section.lug_count or 0) if section.lug_height_m else None,
        lines=table.lines,
    )


def diagnose_benches(benches: Sequence[Bench], options: DiagnosisOptions) -> Diagnosis:
    """Diagnose bench tables jointly.

    Raises
    ------
    ConfigError, DataError
        See `model.diagnosis.single_wheel.diagnose.diagnose_bench`.
    """

    def compute() -> Diagnosis:
        from model.diagnosis import diagnose_bench

        return diagnose_bench(benches, options)

    return _with_remarks(kept("diagnosis", (tuple(benches), options), compute), benches)


def _with_remarks(diagnosis: Diagnosis, given: Sequence[Campaign | Bench]) -> Diagnosis:
    """Add a note on an assumed uncertainty of the soil, and a caution where runs are hardly of one terrain.

    Of wheels together there is no note on one sensor: it stands at its wheel.
    """
    together = any(isinstance(campaign, Campaign) and campaign.of_vehicle for campaign in given)
    notes = [note for note in diagnosis.notes if not (together and note.code in _OF_SENSORS)]
    guessed = [campaign.name for campaign in given if campaign.soil_prior.assumed]
    assumed = Note(DiagnosisCode.SOIL_SIGMA_ASSUMED, values={"campaigns": tuple(guessed)})
    mixed = [note for campaign in given for note in _mixed(campaign, diagnosis, alone=len(given) == 1)]
    some = diagnosis.verdict != "nothing_detectable"
    alike = [*_like_radius(diagnosis, given), *_rolling_alike(diagnosis, given)] if some else []
    cautions = (*diagnosis.grounds.cautions, *mixed, *alike)
    grounds = replace(diagnosis.grounds, cautions=cautions)
    notes += [note for campaign in given if isinstance(campaign, Campaign) for note in _small_forces(campaign)]
    return replace(diagnosis, grounds=grounds, notes=(*notes, *([assumed] if guessed else [])))


def _small_forces(campaign: Campaign) -> list[Note]:
    """Return a note on each static test whose known force is next to nothing beside the load, as kN written as N."""
    loads = np.concatenate([run.vertical_load_n[run.used] for run in campaign.runs])
    load_n = float(np.median(loads[np.isfinite(loads)])) if campaign.static else 0.0
    usual = {"dp": load_n, "t": load_n * campaign.wheel.radius_m}
    return [
        Note(DiagnosisCode.STATIC_SMALL, values={"channel": c, "applied": force, "share": abs(force) / usual[c]})
        for test in campaign.static
        for c, force in (test.applied.items() if test.test != "coasting" else ())
        if 0.0 < abs(force) < _LEAST_FORCE * usual[c]
    ]


def _like_radius(diagnosis: Diagnosis, given: Sequence[Campaign | Bench]) -> list[Note]:
    """Return a caution for each cause as which a wrong radius of a wheel of undeclared tyre looks, of each radius.

    Causes of the verdict have a size; those of the most probable sets have none. The wheel is the first of that radius.
    """
    lengths = {effect.name: effect.like_radius for effect in EFFECTS.values() if effect.like_radius}
    sets = [each.causes for each in diagnosis.sets if each.probability >= _ALMOST_AS_WELL]
    larger: dict[str, float | None] = dict.fromkeys(name for name in chain(*sets) if parted(name)[0] in lengths)
    sizes = [(cause.name, size) for cause in diagnosis.causes for size in cause.parameters]
    larger |= {name: size.value for name, size in sizes if size.name == lengths.get(parted(name)[0])}
    places = ((getattr(each, "of_vehicle", None), each) for each in reversed(given) if not each.tyre)
    radii = [(each.wheel.radius_m, of.wheel if of else "") for of, each in places]
    return [
        Note(DiagnosisCode.LIKE_RADIUS, values={"family": name, "radius_m": radius, "larger_m": size, "wheel": at})
        for name, size in larger.items()
        for radius, at in {radius: at for radius, at in radii if parted(name)[1] in ("", at)}.items()
    ]


def _rolling_alike(diagnosis: Diagnosis, given: Sequence[Campaign | Bench]) -> list[Note]:
    """Return a caution for each gain of a force that is as far off as the radius that a wheel rolls on, of each wheel.

    A wheel whose radius is another one than declared rolls on it, and its torque acts there.
    """
    found = []
    for each in (each for each in given if isinstance(each, Campaign)):
        radius, at = each.wheel.radius_m, each.of_vehicle.wheel if each.of_vehicle else ""
        own = [cause for cause in diagnosis.causes if parted(cause.name)[1] in ("", at)]
        rolled = [size for cause in own if "rolling_radius_m" in _remedy(cause).keys for size in cause.parameters]
        ends = [end for size in rolled for end in size.interval95] or _ROLLS_AS_DECLARED
        rolls = [each.runs[0].rolling_m / radius * (1.0 + end) for end in ends]
        for cause, power in ((cause, EFFECTS.get(cause.key, Effect).of_radius) for cause in own):
            for size in cause.parameters if power and not min(rolls) <= 1.0 <= max(rolls) else ():
                shown, *reach = ((1.0 + x) ** (1.0 / power) for x in (size.value, *size.interval95))
                if min(reach) <= max(rolls) and min(rolls) <= max(reach):
                    values = {"family": cause.name, "radius_m": radius, "larger_m": radius * (shown - 1.0), "wheel": at}
                    found.append(Note(DiagnosisCode.LIKE_RADIUS, values=values))
    return found


def _remedy(cause: Cause) -> Remedy:
    return EFFECTS.get(cause.key, Effect).remedy or Remedy()


def _mixed(campaign: Campaign | Bench, diagnosis: Diagnosis, *, alone: bool) -> list[Note]:
    """Return a caution where the soil differs more from run to run than on one terrain."""
    label = "" if alone else f"{campaign.name}: "
    scatter = diagnosis.noise.get(f"{label}friction_run_to_run", 0.0)
    known = campaign.soil_prior.sigma_of("tan_phi") / campaign.soil.tan_phi if campaign.soil.tan_phi else 0.0
    if not scatter > max(_ONE_TERRAIN, _SURPRISING * known):
        return []
    values = {"campaign": campaign.name, "share": scatter}
    if isinstance(campaign, Campaign):
        values |= _two_groups(campaign.runs)
    return [Note(DiagnosisCode.SEVERAL_TERRAINS, Severity.FAULT, values)]


def _two_groups(runs: Sequence[ProcessedRun]) -> dict[str, object]:
    """Return the runs in two groups by their pull at slip 0.2 over load; nothing where they are not clearly two."""
    pulls = {run.run.id: at_usual_slip((run,), "drawbar_pull_n") for run in runs}
    known = {name: pull.pull_n / pull.load_n for name, pull in pulls.items() if pull is not None and pull.load_n > 0}
    if len(known) < max(len(runs), 2):
        return {}
    order = sorted(known, key=known.__getitem__)
    cut = max(range(1, len(order)), key=lambda i: known[order[i]] - known[order[i - 1]])
    sides = [[name for name in known if name in part] for part in (order[:cut], order[cut:])]
    sides.sort(key=lambda side: list(known).index(side[0]))
    ends = [(min(known[name] for name in side), max(known[name] for name in side)) for side in sides]
    gap = known[order[cut]] - known[order[cut - 1]]
    if gap < _APART * max(high - low for low, high in ends):
        return {}
    files = tuple(run.run.file for run in runs if run.run.id in sides[1] and run.run.file)
    groups = tuple(map(tuple, sides))
    return {"runs": tuple(known), "groups": groups, "drawbar_coefficients": tuple(ends), "files": files}


def plan_campaigns(
    folders: Sequence[Path],
    files: Files,
    options: DiagnosisOptions,
    *,
    run_count: int | None = None,
    duration_s: float = 40.0,
) -> Plan:
    """Return what planned campaigns will separate: one for each folder, or one where none is given.

    Parameters
    ----------
    folders : sequence of Path
        With vehicle.toml and, where they are there, terrain.toml and runs.toml; recordings are not looked at.
    files : Files
        In place of what lies in the folders; a zero file is not taken.
    run_count : int, optional
        Runs to drive where no runs.toml lists them.
    duration_s : float
        Of each run.

    Raises
    ------
    ConfigError
        Everything that is wrong with the files.
    DataError
        The soil cannot carry the wheel.
    """
    from model.diagnosis import plan_of

    faults = []
    if run_count is not None and not 1 <= run_count <= _MOST_RUNS:
        faults.append(Fault("--planned-runs is out of range", found=str(run_count), expected=f"1 to {_MOST_RUNS}"))
    if not _SHORTEST_S <= duration_s <= _LONGEST_S:
        expected = f"{_SHORTEST_S:g} to {_LONGEST_S:g} s"
        faults.append(Fault("--planned-duration is out of range", found=f"{duration_s:g}", expected=expected))
    if faults:
        raise ConfigError(*faults)
    collected = Collected()
    campaigns: list[Campaign] = []
    for folder in folders or (None,):
        with collected.catch():
            campaigns.append(_planned(folder, files, run_count, duration_s, options.seed))
    collected.stop_if_any()
    return plan_of(campaigns, options)


def _planned(folder: Path | None, files: Files, run_count: int | None, duration_s: float, seed: int) -> Campaign:
    from model.diagnosis import plan_for, planned_campaign, usual_runs

    if folder is not None and not folder.is_dir():
        raise ConfigError.of(
            "a plan takes no recording",
            folder,
            "",
            "a folder with vehicle.toml and terrain.toml",
            "give that folder, or omit --plan",
        )
    vehicle_file = files.vehicle or _in(folder, VEHICLE_FILE)
    if vehicle_file is None:
        raise ConfigError.of(
            "the vehicle is not known",
            folder or "",
            next_step="give --vehicle FILE with [wheel] and mass_kg, or a folder with vehicle.toml",
        )
    collected = Collected()
    with collected.catch():
        vehicle = load_toml(vehicle_file, VehicleConfig).for_wheel(files.wheel, str(vehicle_file))
        wheel_of(vehicle, str(vehicle_file))
    with collected.catch():
        terrain = None if files.soil else load_terrain(files.terrain or _in(folder, TERRAIN_FILE))
        soil = known_soil(files.soil, terrain)
    with collected.catch():
        runs = _listed_runs(folder, files) if run_count is None else usual_runs(run_count)
    collected.stop_if_any()
    name = folder.resolve().name if folder else "plan"
    plan = plan_for(vehicle, soil, prior_of(soil, terrain), runs, duration_s=duration_s, name=name, seed=seed)
    return planned_campaign(plan)


def _in(folder: Path | None, name: str) -> Path | None:
    return folder / name if folder and (folder / name).is_file() else None


def _listed_runs(folder: Path | None, files: Files) -> tuple[RunInfo, ...]:
    listed = files.runs or _in(folder, RUNS_FILE)
    found = [run for run in load_toml(listed, RunsConfig).run if run.ground == "soft"] if listed else []
    return tuple(run if run.id else run.model_copy(update={"id": f"run-{i}"}) for i, run in enumerate(found, 1))
