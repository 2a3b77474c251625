"""The extended model as a TOML file: what a diagnosis leaves behind for `fit`, `simulate` and `report`."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path

import tomli_w

from daq import ALL_WHEELS, TRANSDUCER_ROLES, ConfigError, Fault, file_name, read_toml
from daq.runs import Run
from model import ExtendedEffect, ExtendedModel, Fact, averaged_model, extended_model
from model.diagnosis import Bench, Campaign, Diagnosis, ParameterEstimate, SoilEstimate
from model.effects import EFFECTS, parted
from model.wheel_soil import Reading
from processing import ProcessedRun
from wheelsoil import __version__
from wheelsoil.console import check_output
from wheelsoil.wording.names import chance, effect_name, listed, parameter_name, plain_name
from wheelsoil.wording.verdict import gain_words, sentence_of

_WIDTH = 100
_SPEEDS = ("ground_speed", "wheel_speed")
_SCALED = (*TRANSDUCER_ROLES, *_SPEEDS, "pitch")


def model_targets(output: Path, names: Sequence[str], *, force: bool) -> list[Path]:
    """Return the file of each campaign's model: `output`, or one beside it for each of several.

    `ConfigError` where one of them cannot be written (`wheelsoil.console.check_output`).
    """
    if len(names) == 1:
        return [check_output(output, force=force)]
    paths = [output.with_stem(f"{output.stem}-{file_name(name, 'campaign')}") for name in names]
    apart = [p if paths.count(p) == 1 else p.with_stem(f"{p.stem}-{i}") for i, p in enumerate(paths, 1)]
    return [check_output(path, force=force) for path in apart]


def models_of(
    diagnosis: Diagnosis,
    campaigns: Sequence[Campaign | Bench],
    reading: Reading,
    command: str,
    processed: Iterable[tuple[Run, ProcessedRun]] = (),
) -> list[ExtendedModel]:
    """Return each campaign's model: its re-calibrated soil and, where a cause is named, that cause.

    `processed` are the campaigns' runs, for what their errors of measurement count from.

    Wheels of one vehicle have one model.
    Where several sets of causes remain possible, also beside named ones, it holds the most probable ones, each with its
    soil. A soil that was re-calibrated beside what nobody can explain is not worth keeping.
    """
    runs = {id(done): run for run, done in processed}
    average = diagnosis.average
    averaged = {soil.campaign for cause_set in average.sets[:1] for soil in cause_set.soils} if average else set()
    decided = diagnosis.verdict in ("named", "nothing_detectable")
    estimates = {soil.campaign: soil for soil in diagnosis.soils if decided}
    causes = diagnosis.causes if diagnosis.verdict == "named" else ()
    grounds = [campaign.ground for campaign in campaigns]
    models = [
        averaged_model(
            campaign.wheel,
            campaign.soil,
            average,
            ground,
            reading,
            tyre=campaign.tyre,
            provenance=_provenance(diagnosis, campaign, command, runs),
        )
        if average and ground in averaged
        else extended_model(
            campaign.wheel,
            campaign.soil,
            estimates.get(ground, SoilEstimate(ground, {}, {})),
            causes,
            reading,
            tyre=campaign.tyre,
            provenance=_provenance(diagnosis, campaign, command, runs),
        )
        for campaign, ground in ((campaigns[grounds.index(ground)], ground) for ground in dict.fromkeys(grounds))
    ]
    return [
        _of_wheels(model, [each for each in campaigns if each.ground == model.provenance["campaign"]], runs)
        for model in models
    ]


def _of_wheels(model: ExtendedModel, members: Sequence[Campaign | Bench], runs: Mapping[int, Run]) -> ExtendedModel:
    """Return a model with the wheels that it is of, and what its errors of measurement count from.

    `runs` are by the id of the processed run.
    """
    driven = [each for each in members if isinstance(each, Campaign)]
    wheels = {each.of_vehicle.wheel: (each.wheel, each.tyre) for each in driven if each.of_vehicle}
    whole = replace(model, wheels=wheels)
    counted = tuple(
        (wheel if wheels else "", name, value)
        for each in driven
        for wheel in [each.of_vehicle.wheel if each.of_vehicle else model.wheel_id]
        for declared in [[declared_of(runs[id(done)], done) for done in each.runs if id(done) in runs]]
        for name in sorted(set().union(*map(_counted_from, whole.of_wheel(wheel).keys)))
        for value in dict.fromkeys(facts[name] for facts in declared if name in facts)
    )
    return replace(whole, provenance=model.provenance | ({"counted_from": counted} if counted else {}))


def _provenance(
    diagnosis: Diagnosis, campaign: Campaign | Bench, command: str, runs: Mapping[int, Run]
) -> dict[str, Fact]:
    driven = () if isinstance(campaign, Bench) else campaign.runs
    names = campaign.rows.names if isinstance(campaign, Bench) else tuple(run.run.id for run in driven)
    # The held-out gain of what is in the file: of the average, of the named causes, else of nothing.
    if diagnosis.average is not None:
        gain = diagnosis.average.gain
    else:
        gain = diagnosis.gain if diagnosis.verdict == "named" else None
    facts: dict[str, Fact] = {
        "made_by": f"wheelsoil {__version__}",
        "made_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "campaign": campaign.ground,
        "runs": tuple(names),
        "wheel": ""
        if isinstance(campaign, Campaign) and campaign.of_vehicle
        else next((" ".join(runs[id(done)].vehicle.wheel_ids) for done in driven if id(done) in runs), ""),
        "verdict": diagnosis.verdict,
        "sentence": sentence_of(replace(diagnosis, gain=gain)),
        "candidates": tuple(f"{c.name} {c.probability:.3f}" for c in diagnosis.candidates if c.probability >= 0.01),
    }
    if gain is not None:
        facts["held_out_log_likelihood_gain"] = float(gain.log_likelihood_gain)
        facts["held_out_R0_reduction_percent"] = float(gain.reduction_percent)
    if diagnosis.average is not None and (worth := gain_words(gain)):
        facts["held_out"] = f"With their average, on held-out runs {worth}."
    return {name: fact for name, fact in facts.items() if fact == fact and (name, fact) != ("wheel", "")}  # without NaN


def declared_of(run: Run, processed: ProcessedRun) -> dict[str, str]:
    """Return what errors of measurement may count from, as vehicle.toml, its DBCs and the zeros of a run declare it."""
    wheel, transducer, zeros = run.vehicle.wheel, run.vehicle.transducer, processed.quality.zeros
    return {
        **{
            f"[wheel] {name}": f"{getattr(wheel, name):.9g}"
            for name in ("radius_m", "outboard_mass_kg", "outboard_inertia_kgm2")
            if wheel
        },
        "[wheel] rolling_radius_m": f"{wheel.rolling_radius_m:.9g}" if wheel and wheel.rolling_radius_m else "radius_m",
        **{f"[sensors.{role}] latency_s": f"{run.vehicle.latency_s(role):.9g}" for role in _SPEEDS},
        **{f"scale of {role}": text for role, text in run.scales(_SCALED).items()},
        **{f"unit and sign of {role}": f"times {text}" for role, text in run.factors(_SCALED).items()},
        **{f"zero of {role}": "none" for role in TRANSDUCER_ROLES},
        **{f"zero of {role}": ", ".join(zero.recordings) for role, zero in zeros.items()},
        "[transducer] zero": transducer.zero,
        "[transducer] angle_offset_deg": f"{transducer.angle_offset_deg:.9g}",
    }


def _counted_from(key: str) -> set[str]:
    """Return the names in `declared_of` that a cause counts from: what is mended there, it would correct again."""
    effect = EFFECTS[key]
    roles = {*effect.shows, *effect.needs.roles} if effect.kind == "measurement" else set()
    of_zero = roles if effect.at_standstill or effect.needs.zero_of else set()
    return {
        *(f"scale of {role}" for role in roles),
        *(f"unit and sign of {role}" for role in roles),
        *(f"[sensors.{role}] latency_s" for role in (_SPEEDS if roles & {*_SPEEDS} else ())),
        *(("[wheel] radius_m", "[wheel] rolling_radius_m") if "wheel_speed" in roles else ()),
        *(f"zero of {role}" for role in of_zero),
        *(("[transducer] zero", "[transducer] angle_offset_deg") if of_zero else ()),
        *(("[wheel] outboard_mass_kg",) if "vertical_load" in of_zero else ()),
        *(f"{each.section} {each.key}" for each in (effect.remedy.corrections if effect.remedy else ())),
    }


def refuse_mended(model: ExtendedModel, processed: Iterable[tuple[Run, ProcessedRun]]) -> None:
    """Raise ConfigError where a model is of another wheel, or what its errors of measurement count from has changed.

    What has been mended since would be corrected twice.
    """
    for run, done in processed:
        wheel, facts = " ".join(run.vehicle.wheel_ids), model.provenance.get("counted_from")
        keys = model.of_wheel(wheel).keys
        rows = [row for row in (facts if isinstance(facts, tuple) else ()) if not isinstance(row, str)]
        now = declared_of(run, done) if rows else {}
        faults = [
            Fault(
                f"the model file corrects {listed([plain_name(key) for key in keys if name in _counted_from(key)])}, "
                f"and {name} has changed since it was made",
                f"{run.vehicle_source}{f', wheel {wheel}' if wheel else ''}",
                value,
                ", ".join(known),
                "diagnose anew (`wheelsoil diagnose FOLDER -o FILE`), or put the value back: with both it is corrected "
                "twice",
            )
            for name, value in now.items()
            if (known := [then for of, what, then in rows if of in ("", wheel) and what == name]) and value not in known
        ]
        ConfigError.stop_if_any(faults)


def model_toml(model: ExtendedModel) -> str:
    """Return the file's text: what it is in words, and the model."""
    sentence = " ".join(str(model.provenance.get("sentence", "")).split())
    head = ["The model that `wheelsoil diagnose` left, for `fit`, `simulate` and `report` with --model.", sentence]
    head += [_effect_line(effect) for effect in model.effects]
    for cause_set in model.sets:
        effects = "; ".join(map(_effect_line, cause_set.effects)) or "no cause, the soil re-calibrated"
        head.append(f"{chance(cause_set.probability)}: {effects}")
    if model.sets:
        named = model.provenance.get("verdict") == "named"
        head += [
            str(model.provenance.get("held_out", "")),
            f"{'What acts beside the named causes is not decided' if named else 'No cause is named'}: "
            f"{len(model.sets)} sets remain possible, each with its own soil. Their predictions "
            f"are averaged; {chance(model.rest_probability)} of the probability is of sets that are not here.",
        ]
    elif not model.effects:
        kept = "only the soil is re-calibrated" if model.soil_sigmas else "it is the laboratory's soil"
        head.append(f"No cause is named, so that none is in it: {kept}.")
    lines = [line for text in head for line in textwrap.wrap(text, _WIDTH)]
    return "".join(f"# {line}\n" for line in lines) + "\n" + tomli_w.dumps(model.to_mapping())


def _effect_line(effect: ExtendedEffect) -> str:
    sizes = "; ".join(_size(effect.key, p) for p in (*effect.combinations, *effect.parameters))
    return f"{effect_name(effect.key)}: {sizes}"


def _size(key: str, p: ParameterEstimate) -> str:
    """Return a parameter with its value and, where it is known, its interval."""
    low, high = p.interval95
    band = f" ({low:.4g} to {high:.4g})" if isfinite(low) and isfinite(high) else ""
    return f"{parameter_name(key, p.name)} = {p.value:.4g}{band}{'' if p.unit == '1' else f' {p.unit}'}"


def load_model(path: Path) -> ExtendedModel:
    """Read a model file; of one of a vehicle `ExtendedModel.of_wheel` gives each wheel's model.

    Raises
    ------
    ConfigError
        Everything that is wrong with it.
    """
    return ExtendedModel.from_mapping(read_toml(path), str(path))


def models_of_wheels(path: Path | None, wheels: Iterable[str]) -> dict[str, ExtendedModel | None]:
    """Read the model of each wheel from a model file, where one is given; that of a file of one wheel is of each.

    That of all wheels (`daq.ALL_WHEELS`) is None where a cause acts at one of them alone. `ConfigError` lists
    everything that is wrong with it, or that it is of other wheels.
    """
    read = load_model(path) if path else None
    found = {wheel: read and read.of_wheel(wheel, str(path)) for wheel in wheels}
    alone = read and any(parted(key)[1] for key in read.keys)
    return found | {ALL_WHEELS: None if alone else next(iter(found.values()))}
