"""Where a blind campaign meets the engine: recordings in, what it says out."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch
from zlib import crc32

from blind.field import FieldDay, driven
from blind.folders import run_info, terrain_config, vehicle_config, write_campaign
from blind.mix import Case
from blind.tilts import with_pitch

from daq import TerrainConfig
from daq.config import WheelSection
from daq.runs import open_runs
from model.diagnosis import Campaign, Diagnosis, DiagnosisOptions
from model.diagnosis.core.hypotheses import Posterior
from model.effects import EFFECTS
from model.wheel_soil import Wheel, prior_of, soil_from_terrain
from processing import ProcessedRun, ProcessOptions
from processing.pipeline import process
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.workflows import campaigns_of, process_runs

OPTIONS = ProcessOptions(purpose="diagnose")
_GIVEN_EVERY = 3
"""One single in so many is diagnosed with nothing but its true cause, too, for the gain."""


def campaign_from_channels(day: FieldDay, hidden: Sequence[tuple[str, float]], *, pitch: bool = False) -> Campaign:
    """Process the channels without frames between; `pitch`: with a pitch sensor."""
    vehicle, recorded = vehicle_config(day), driven(day, hidden)
    runs = tuple(
        process(channels, vehicle, run_info(plan), OPTIONS)
        for plan, channels in zip(day.plans, with_pitch(day, recorded) if pitch else recorded, strict=True)
    )
    return _campaign(runs, terrain_config(day.laboratory), vehicle.wheel)


def campaign_from_frames(day: FieldDay, hidden: Sequence[tuple[str, float]]) -> Campaign:
    """Write a campaign folder and read it as `wheelsoil diagnose FOLDER` does."""
    with TemporaryDirectory(prefix="blind-") as name:
        folder = Path(name) / "campaign"
        write_campaign(folder, day, hidden)
        opened = process_runs(open_runs([folder]), OPTIONS)
        [campaign] = campaigns_of([folder], opened)
    return campaign


def _campaign(runs: tuple[ProcessedRun, ...], terrain: TerrainConfig, wheel: WheelSection | None) -> Campaign:
    soil = soil_from_terrain(terrain)
    assert wheel is not None
    own, prior = Wheel(wheel.radius_m, wheel.width_m), prior_of(soil, terrain)
    return Campaign("blind", runs, own, soil, prior, outboard_mass_kg=wheel.outboard_mass_kg)


def asked(campaign: Campaign, case: Case, truth: dict[str, Any]) -> dict[str, Any]:
    """Diagnose a campaign; where something listed is hidden, once more with nothing else in the library."""
    from model.diagnosis import diagnose

    options = DiagnosisOptions(
        reading="literal" if case.kind == "literal" else "balanced",
        effects=tuple(
            key
            for key, effect in EFFECTS.items()
            if effect.name != case.without and effect.reading in ("any", "literal" if case.kind == "literal" else "any")
        ),
    )
    begin, cpu = time.perf_counter(), time.process_time()
    with averages_kept() as kept:
        said = diagnose([campaign], options)
    out = {**_told(said), "engine_s": time.perf_counter() - begin, "engine_cpu_s": time.process_time() - cpu}
    out["as_they_are"] = kept[0].as_they_are().families() if kept else {}
    member = truth["members"][0] if case.kind == "single" else {}
    if member and not member["variant"]:
        out["given_fit"] = {"causes": fitted(campaign, member["family"], member["key"], options)}
    if member and not member["variant"] and member["L"] > 1.5 and crc32(case.name.encode()) % _GIVEN_EVERY == 0:
        own = tuple(key for key, effect in EFFECTS.items() if effect.name == member["family"])
        out["given_truth"] = _told(diagnose([campaign], replace(options, effects=own, most_causes=1)))
    return out


@contextmanager
def averages_kept() -> Iterator[list[Posterior]]:
    """Keep what the engine averages over runs that are drawn anew; the first is that of the verdict."""
    from model.diagnosis.findings.held_out import bagged
    from model.diagnosis.time_series import diagnosis

    kept: list[Posterior] = []

    def keeping(*args: Any) -> Posterior:
        kept.append(bagged(*args))
        return kept[-1]

    with patch.object(diagnosis, "bagged", keeping):
        yield kept


def fitted(campaign: Campaign, family: str, key: str, options: DiagnosisOptions) -> list[dict[str, Any]]:
    """Return the fit given the true cause, whatever the verdict: as a cause of the JSON; none where it has no fit."""
    from model.diagnosis.findings.explained import Fits
    from model.diagnosis.findings.set_fit import parameters_of
    from model.diagnosis.time_series import linearise_campaigns

    own = tuple(name for name, effect in EFFECTS.items() if effect.name == family and effect.form in ("", key))
    linearised = linearise_campaigns([campaign], replace(options, effects=own, most_causes=1))
    if not linearised.grams.causes:  # the data lack what the effect needs
        return []
    found = parameters_of(Fits(linearised)[own], linearised)[own[0]]
    parameters = [{"name": p.name, "value": p.value, "interval95": list(p.interval95)} for p in found]
    return [{"name": family, "form": EFFECTS[own[0]].form, "parameters": parameters}]


def _told(said: Diagnosis) -> dict[str, Any]:
    full = diagnosis_json(said)
    kept = (
        "verdict",
        "sentence",
        "causes",
        "candidates",
        "sets",
        "what_is_wrong",
        "gain",
        "adequacy",
        "lack_of_fit_rms",
        "free_form",
        "noise",
        "stages_s",
    )
    return json.loads(json.dumps({key: full[key] for key in kept}, default=float))
