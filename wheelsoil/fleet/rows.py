"""The rows of one campaign, for the tables of a store."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any

import numpy as np
import pyarrow as pa

from daq import ALL_WHEELS, OUTPUTS, Note
from daq.runs import Run, SetAsideRun
from model.diagnosis import Diagnosis
from model.effects import parted
from model.fit import CampaignFit
from processing import ProcessedRun, Segment
from wheelsoil import __version__
from wheelsoil.fleet.roots import Source
from wheelsoil.fleet.tables import SAMPLES_HZ, schema_of
from wheelsoil.wording.names import SOIL_UNITS
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.verdict import runs_apart, sentence_of
from wheelsoil.workflows.cause_cost import steady_traction
from wheelsoil.workflows.fit import wheel_of, whole_runs
from wheelsoil.workflows.grading import grade_of, short_runs
from wheelsoil.workflows.key_figures import CALIBRATED_SOIL, MODELS, Z95
from wheelsoil.workflows.tables import BenchFiles
from wheelsoil.workflows.traction import Traction, traction_of


@dataclass(frozen=True)
class Found:
    """What was found out about a campaign, or as much of it as there is.

    Attributes
    ----------
    fault : str
        Why it failed, or what every run lacks.
    state : "done", "failed" or "silent"
    remarks : tuple of (where, text)
        What was said while it was worked on.
    set_aside : tuple of SetAsideRun
        Runs that were given and are not used.
    wheel : str
        Id of the wheel that it is of, where there are several; `ALL_WHEELS`: what is found of all of them together, of
        which there is a row of ``campaigns`` only where it failed.
    """

    source: Source
    processed: Sequence[tuple[Run, ProcessedRun]] = ()
    benches: Sequence[BenchFiles] = ()
    fit: CampaignFit | None = None
    diagnosis: Diagnosis | None = None
    fault: str = ""
    remarks: tuple[tuple[str, str], ...] = ()
    state: str = field(default="done")
    set_aside: tuple[SetAsideRun, ...] = ()
    wheel: str = ""


def tables_of(wheels: Sequence[Found], content: str) -> dict[str, pa.Table]:
    """Return the rows of a campaign, by table: of each wheel its own, and once those that are of the vehicle."""
    made: dict[str, list[dict[str, Any]]] = {}
    for found in wheels:
        for name, rows in _rows_of(found).items():
            made.setdefault(name, []).extend({**row, "wheel": found.wheel} for row in rows)
    signals = [
        {(role, str(s)) for role, s in found.processed[0][0].vehicle.signals.items()}
        for found in wheels
        if found.processed
    ]
    shared = {role for role, _ in set.intersection(*signals)} if len(signals) > 1 else set()
    made["sensors"] = _once(made["sensors"], lambda row: (row["run"], row["role"]) if row["role"] in shared else None)
    made["notes"] = _once(made["notes"], lambda row: (row["run"], row["text"]) if row["of"] == "opening" else None)
    tables = {name: _table(name, rows, content) for name, rows in made.items() if rows}
    sampled = [_samples(done, content, found.wheel) for found in wheels for _, done in found.processed]
    return tables | ({"samples": pa.concat_tables(sampled)} if sampled else {})


def _once(rows: Iterable[dict[str, Any]], key_of: Callable[[dict[str, Any]], Any]) -> list[dict[str, Any]]:
    """Return rows; those that two wheels have under one key once, as the vehicle's."""
    kept: dict[Any, dict[str, Any]] = {}
    for i, row in enumerate(rows):
        key = key_of(row)
        if key in kept and kept[key]["wheel"] != row["wheel"]:
            kept[key] = {**kept[key], "wheel": ""}
        else:
            kept[i if key is None or key in kept else key] = row
    return list(kept.values())


def _rows_of(found: Found) -> dict[str, Iterable[dict[str, Any]]]:
    diagnosis, together = found.diagnosis, found.wheel == ALL_WHEELS
    short = short_runs([done for _, done in found.processed], runs_apart(diagnosis))
    return {
        "campaigns": [] if together and not found.fault else [_campaign(found)],
        "runs": [_run(run, done, lost) for (run, done), lost in zip(found.processed, short, strict=True)],
        "notes": _notes(found),
        "fits": _fits(found.fit),
        "coefficients": [*_coefficients(found.fit), *_soils(diagnosis)],
        "diagnoses": [] if diagnosis is None else [_diagnosis(diagnosis)],
        "causes": [] if diagnosis is None else _causes(diagnosis, "" if together else found.wheel),
        "gains": [] if diagnosis is None else _gains(diagnosis),
        "evidence": _evidence(found),
        "sensors": [row for run, done in found.processed for row in _sensors(run, done)],
    }


def _table(name: str, rows: Iterable[Mapping[str, Any]], content: str) -> pa.Table:
    schema = schema_of(name)
    known = [{key: _known(value) for key, value in row.items()} for row in rows]
    known = [{**row, "content": content, "wheel": row["wheel"] or ""} for row in known]
    return pa.Table.from_pylist(known, schema=schema)


def _known(value: Any) -> Any:
    """Return a value for a table: null for NaN and for an empty text."""
    if isinstance(value, float | np.floating):
        return float(value) if isfinite(value) else None
    return None if isinstance(value, str) and not value else value


def _campaign(found: Found) -> dict[str, Any]:
    runs = tuple(done for _, done in found.processed)
    row: dict[str, Any] = {
        "kind": "table" if found.source.is_table else "runs",
        "state": found.state,
        "fault": found.fault,
        "path": found.source.path,
        "version": __version__,
        "runs": len(runs),
    }
    if found.benches:
        wheel_test = found.benches[0]
        wheel = wheel_test.wheel_section
        rows = sum(len(table.rows) for table in found.benches)
        row |= {"terrain": wheel_test.soil.name, "samples": rows, "used_share": 1.0}
    elif runs:
        first = found.processed[0][0]
        section = first.vehicle.wheel
        if section is None:
            return row
        wheel = section
        traction = _traction(found, runs)
        pull = traction.pull if traction.model else None
        starts = [run.start_ns for run in runs if run.start_ns > 0]
        row |= {
            "vehicle": first.vehicle.vehicle.name,
            "transducer": first.vehicle.transducer.serial,
            "terrain": first.terrain.soil.name if first.terrain else "",
            "start": min(starts) // 1000 if starts else None,
            "samples": sum(map(len, runs)),
            "used_share": sum(int(run.used.sum()) for run in runs) / max(sum(map(len, runs)), 1),
            "duration_s": sum(len(run) / run.rate_hz for run in runs),
            "latitude_deg": _middle([run.latitude_deg for run in runs]),
            "longitude_deg": _middle([run.longitude_deg for run in runs]),
            "pull_at_slip_0_2_n": pull.pull_n if pull else None,
            "pull_at_slip_0_2_lower95_n": pull.interval95[0] if pull else None,
            "pull_at_slip_0_2_upper95_n": pull.interval95[1] if pull else None,
            "drawbar_coefficient": traction.drawbar_coefficient,
            "tractive_efficiency": traction.efficiency,
        }
    else:
        return row
    return row | {"wheel_radius_m": wheel.radius_m, "wheel_width_m": wheel.width_m, "tread": wheel.tread}


def _traction(found: Found, runs: tuple[ProcessedRun, ...]) -> Traction:
    """Return what the report shows as the traction; measured where there is no fit."""
    first, whole = found.processed[0][0], whole_runs(runs)
    if found.fit is None or not whole:
        return traction_of(whole)
    wheel = wheel_of(first.vehicle, first.vehicle_source)
    return steady_traction(found.diagnosis, whole, wheel, found.fit.soil, found.fit.options.reading)


def _run(run: Run, done: ProcessedRun, lost: Sequence[str]) -> dict[str, Any]:
    grade, traction, quality, info = grade_of(done, lost), traction_of((done,)), done.quality, done.run
    return {
        "run": info.id,
        "file": run.path.name,
        "start": done.start_ns // 1000 if done.start_ns > 0 else None,
        "duration_s": len(done) / done.rate_hz,
        "rate_hz": done.rate_hz,
        "cutoff_hz": done.cutoff_hz,
        "samples": len(done),
        "used": int(done.used.sum()),
        "pass_number": info.pass_number,
        "direction": info.direction,
        "added_load_kg": info.added_load_kg,
        "inflation_kpa": info.inflation_kpa,
        "load_n": _middle([done.vertical_load_n[done.used]]),
        "highest_slip": grade.highest_slip,
        "grade": grade.level,
        "grade_reasons": "; ".join(grade.reasons),
        "speed_scale": quality.speed_scale,
        "residual_latency_s": quality.residual_latency_s,
        "drawbar_coefficient": traction.drawbar_coefficient,
        "tractive_efficiency": traction.efficiency,
        "pull_at_slip_0_2_n": traction.pull.pull_n if traction.pull else None,
    }


def _samples(run: ProcessedRun, content: str, wheel: str) -> pa.Table:
    """Return a run at `SAMPLES_HZ`: some of its own samples, which are filtered already, and no means."""
    schema = schema_of("samples")
    segments = np.array([each.name.lower() for each in Segment])
    rows = np.arange(0, len(run), max(round(run.rate_hz / SAMPLES_HZ), 1))
    time = (run.start_ns + np.round(run.time_s[rows] * 1e9).astype(np.int64)) // 1000
    own = {
        "content": np.full(len(rows), content),
        "wheel": np.full(len(rows), wheel),
        "run": np.full(len(rows), run.run.id),
        "time": time if run.start_ns > 0 else [None] * len(rows),
        "segment": segments[run.segment[rows]],
        "used": run.used[rows],
    }
    values = [own[name] if name in own else run.column(name)[rows] for name in schema.names]
    arrays = [pa.array(each, from_pandas=True, type=kind) for each, kind in zip(values, schema.types, strict=True)]
    return pa.table(arrays, schema=schema)


def _notes(found: Found) -> Iterator[dict[str, Any]]:
    for _, done in found.processed:
        missing = done.quality.missing.values()
        yield from (_note(note, "processing", done.run.id) for note in (*done.quality.notes, *missing))
    if found.fit:
        yield from (_note(note, "fit") for note in found.fit.notes)
        yield from (_note(note, f"fit of {model.name}") for model in found.fit.models for note in model.notes)
    if found.diagnosis:
        grounds = found.diagnosis.grounds
        first = [grounds.undecided] if grounds.undecided else []
        noted = dict.fromkeys(map(note_text, (*first, *grounds.cautions, *found.diagnosis.notes)))
        by_text = {note_text(note): note for note in (*first, *grounds.cautions, *found.diagnosis.notes)}
        yield from (_note(by_text[text], "diagnosis") for text in noted)
    yield from ({"of": where, "severity": "remark", "text": text} for where, text in found.remarks)
    for run in found.set_aside:
        text = f"set aside: {run.reason}; next: {run.next_step}"
        yield {"run": run.run, "of": "opening", "code": run.cause, "severity": "remark", "text": text}


def _note(note: Note, of: str, run: str = "") -> dict[str, Any]:
    return {
        "run": run,
        "of": of,
        "code": str(note.code),
        "severity": note.severity.name.lower(),
        "text": note_text(note),
    }


def _fits(fit: CampaignFit | None) -> Iterator[dict[str, Any]]:
    for model in fit.models if fit else ():
        for channel, criteria in model.criteria.items():
            yield {
                "model": model.name,
                "channel": OUTPUTS[channel].role,
                "R0": criteria.R0_N,
                "R0_per_load": criteria.R0_per_load,
                "M0_percent": criteria.M0_percent,
                "R2": criteria.R2,
                "samples": criteria.samples,
                "slip_threshold": criteria.threshold,
                "stop_reason": model.stop_reason,
            }


def _coefficients(fit: CampaignFit | None) -> Iterator[dict[str, Any]]:
    for model in fit.models if fit else ():
        for estimate in model.estimates:
            lower, upper = estimate.interval
            yield _estimate(estimate.name, estimate.unit, estimate.value, lower, upper) | {"model": model.name}


def _soils(found: Diagnosis | None) -> Iterator[dict[str, Any]]:
    """Yield the soil as the diagnosis calibrated it: with the causes of a `named` verdict, else without any."""
    model = MODELS["named"] if found and found.verdict == "named" else CALIBRATED_SOIL
    for soil in found.soils if found else ():
        for name, value in soil.values.items():
            half = Z95 * soil.sigmas.get(name, nan)
            yield _estimate(name, SOIL_UNITS.get(name) or "1", value, value - half, value + half) | {"model": model}


def _estimate(name: str, unit: str, value: float, lower: float, upper: float) -> dict[str, Any]:
    return {"parameter": name, "unit": unit, "value": value, "lower95": lower, "upper95": upper}


def _diagnosis(found: Diagnosis) -> dict[str, Any]:
    row: dict[str, Any] = {
        "verdict": found.verdict,
        "sentence": sentence_of(found),
        "none_probability": next((c.probability for c in found.candidates if c.name == "none"), None),
        "adequate": found.adequacy.ok if found.adequacy else None,
        "proposal": found.proposal.formula if found.proposal else None,
    }
    if gain := found.gain:
        row |= {
            "R0_base": gain.base[gain.channel].R0,
            "R0_extended": gain.extended[gain.channel].R0,
            "reduction_percent": gain.reduction_percent,
            "reduction_lower95": gain.interval95[0],
            "reduction_upper95": gain.interval95[1],
        }
    return row


def _causes(found: Diagnosis, wheel: str) -> Iterator[dict[str, Any]]:
    """Yield the causes of the verdict, a row a parameter, and every other candidate, a row each.

    `wheel` is that at which those act that are not of one wheel by their name.
    """

    def place(name: str) -> dict[str, Any]:
        family, own = parted(name)
        return {"family": family, "at_wheel": own or wheel}

    for cause, _ in found.stated:
        own = {
            **place(cause.name),
            "kind": cause.kind,
            "role": found.verdict if cause in found.causes else "barred",
            "probability": cause.probability,
            "effect": parted(cause.key)[0],
            "form_probability": cause.form_probability,
        }
        estimates = [_estimate(p.name, p.unit, p.value, *p.interval95) for p in cause.parameters]
        yield from (own | estimate for estimate in estimates or [{}])
    shown = {cause.name for cause, _ in found.stated}
    for candidate in found.candidates:
        if candidate.name not in shown:
            yield {**place(candidate.name), "role": "candidate", "probability": candidate.probability}


def _gains(found: Diagnosis) -> Iterator[dict[str, Any]]:
    gain = found.gain
    if gain is None:
        return
    for model, scores in (("base", gain.base), ("extended", gain.extended)):
        for channel, score in scores.items():
            row: dict[str, Any] = {
                "channel": OUTPUTS[channel].role,
                "model": model,
                "R0": score.R0,
                "M0_percent": score.M0_percent,
                "R2": score.R2,
            }
            fall = gain.reductions.get(channel) if model == "extended" else None
            if fall:
                row |= {"reduction_percent": fall.percent, "lower95": fall.interval95[0], "upper95": fall.interval95[1]}
            yield row


def _evidence(found: Found) -> Iterator[dict[str, Any]]:
    """Yield what can be pooled with other campaigns, with what it is pooled by."""
    if found.diagnosis is None or found.diagnosis.information is None:
        return
    information = found.diagnosis.information
    campaign = _campaign(found)
    yield {
        **{name: campaign.get(name) for name in ("transducer", "terrain", "start")},
        **{name: list(value) if isinstance(value, tuple) else value for name, value in vars(information).items()},
        "matrix": information.matrix.ravel().tolist(),
    }


_OF_THE_TRANSDUCER = ("vertical_load", "drawbar_pull", "driving_torque")


def _sensors(run: Run, done: ProcessedRun) -> Iterator[dict[str, Any]]:
    for role, facts in done.quality.sensors.items():
        zero = done.quality.zeros.get(role)
        yield {
            "run": done.run.id,
            "role": role,
            "serial": run.vehicle.transducer.serial if role in _OF_THE_TRANSDUCER else "",
            "rate_hz": facts.rate_hz,
            "samples": facts.samples,
            "gaps": facts.gaps,
            "longest_gap_s": facts.longest_gap_s,
            "latency_s": facts.latency_s,
            "sigma": facts.sigma,
            "sigma_source": facts.sigma_source,
            "zero_offset": zero.offset if zero else None,
            "zero_method": ", ".join(zero.methods) if zero else None,
        }


def _middle(values: Sequence[np.ndarray[Any, Any]]) -> float:
    known = np.concatenate([each[np.isfinite(each)] for each in values]) if values else np.zeros(0)
    return float(np.median(known)) if len(known) else float("nan")
