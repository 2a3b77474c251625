"""Inputs of a report: processed runs, their fit with the uncertainty of its curves, and their provenance."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from daq import REACTIONS, DataError, FloatArray, Note, VehicleConfig
from daq.recording import Event
from daq.runs import Run, SetAsideRun
from model import AveragedModel
from model.diagnosis import Diagnosis
from model.effects import EFFECTS
from model.fit import CampaignFit, ModelFit
from model.wheel_soil import Conditions, Prediction, conditions_of, joined_conditions
from processing import ProcessedRun
from wheelsoil import __version__
from wheelsoil.report.figures import EDGES, even_rows
from wheelsoil.report.recommendation import Pool, Recommendation, of_diagnosis, of_fit
from wheelsoil.wording.losses import WRAPPED
from wheelsoil.wording.names import listed, plain_name
from wheelsoil.wording.notes import note_text
from wheelsoil.wording.verdict import runs_apart, several_terrains
from wheelsoil.workflows.cause_cost import steady_traction
from wheelsoil.workflows.fit import wheel_of, whole_runs
from wheelsoil.workflows.grading import Grade, grade_of, runs_to_check, short_runs
from wheelsoil.workflows.last_report import LastReport, subject_of
from wheelsoil.workflows.recordings import sha256_of
from wheelsoil.workflows.tables import BenchFiles
from wheelsoil.workflows.traction import Traction, traction_of

_PER_BIN = 4
"""Samples of a run and a bin of slip for which it is worked out: the band is smooth."""

_NAMED = 5
"""Runs that a sentence names, more are counted."""


def model_sigmas(runs: Sequence[ProcessedRun], fit: CampaignFit) -> dict[str, dict[str, FloatArray]]:
    """Return one-sigma of each model's prediction from its coefficients alone, by channel and model, of the samples.

    Of the used samples of all runs, one after the other; NaN where it was not worked out, and for a model without
    standard errors.
    """
    used = [run.used for run in runs]
    slip = np.concatenate([run.slip[keep] for run, keep in zip(runs, used, strict=True)])
    run = np.repeat(np.arange(len(runs)), [int(keep.sum()) for keep in used])
    rows = even_rows(run * (len(EDGES) + 1) + np.digitize(slip, EDGES), _PER_BIN)
    conditions = joined_conditions(conditions_of(runs, fit.soil.unit_weight_n_m3), used).rows(rows)
    found: dict[str, dict[str, FloatArray]] = {channel: {} for channel in REACTIONS}
    for model in fit.models:
        for channel, sigma in _of_model(fit, model, conditions).items():
            found[channel][model.name] = np.full(len(slip), np.nan)
            found[channel][model.name][rows] = sigma
    return found


def _of_model(fit: CampaignFit, model: ModelFit, conditions: Conditions) -> dict[str, FloatArray]:
    """Return one-sigma of each channel under some conditions."""
    forward = fit.options.forward(fit.wheel, fit.soil, model.name)
    if isinstance(forward, AveragedModel):
        sigmas = forward.sigmas(conditions)
        return {channel: sigmas[channel] for channel in REACTIONS}
    names, covariance = _covariance(model)
    if not names:
        return dict.fromkeys(REACTIONS, np.full(len(conditions.slip), np.nan))
    prediction = forward.predict(conditions, model.values, wrt=names)
    found = {}
    for channel, quantity in REACTIONS.items():
        slopes = np.stack([getattr(prediction.sensitivities[name], quantity.field) for name in names])
        found[channel] = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", slopes, covariance, slopes), 0.0))
    return found


def _covariance(model: ModelFit) -> tuple[tuple[str, ...], FloatArray]:
    """Return the coefficients that have a standard error, and their covariance."""
    free = [e for e in model.estimates if not e.derived and np.isfinite(e.sigma)]
    names = tuple(e.name for e in free)
    size = np.array([e.sigma for e in free])
    correlation = np.eye(len(free))
    for (a, b), value in model.correlation.items():
        if a in names and b in names and np.isfinite(value):
            i, j = names.index(a), names.index(b)
            correlation[i, j] = correlation[j, i] = value
    return names, correlation * np.outer(size, size)


@dataclass(frozen=True)
class Source:
    """The file of one run; None where a number is not known.

    `loss` is what of it cannot be read, `gaps` what was not recorded between its parts, `losses` what the logger
    counted (`daq.recording.RunRecording.losses`). `exit_status` is empty where its end is missing, None where it is a
    log. `clock` is the last fit of the host's clock to GNSS time, `clock_steps` the steps it made. `events` are marks,
    and what went wrong while it was recorded.
    """

    run_id: str
    file: str
    bytes: int
    sha256: str
    frames: int | None
    dropped_frames: int | None
    loss: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()
    losses: dict[str, int] = field(default_factory=dict)
    exit_status: str | None = None
    clock: dict[str, str] = field(default_factory=dict)
    clock_steps: dict[str, str] = field(default_factory=dict)
    events: tuple[Event, ...] = ()

    @property
    def lost(self) -> list[str]:
        """What of the run was lost, in words."""
        missing = sum(number for key, number in self.losses.items() if key.startswith(("counter.", "missing.")))
        frames = [f"{self.dropped_frames} frames were lost before they were recorded"] if self.dropped_frames else []
        if missing and not frames:
            least = "at least " if any(key.startswith(f"{WRAPPED}.") for key in self.losses) else ""
            frames = [f"{least}{missing} frames are missing by their counters or their rate"]
        return [*frames, *self.loss, *self.gaps]


@dataclass(frozen=True)
class ReportInputs:
    """Inputs of the sections: runs, fits, diagnosis, and their sources.

    `no_fit` and `no_diagnosis` say why there is none; where no diagnosis was asked for the latter is empty, and the
    page says nothing of it. `diagnosis_failed`: a fault, and not the measurement, is why. `tables` are single-wheel
    tests in place of runs, `last` an earlier report to compare with; runs `set_aside` were given and are not used.
    """

    runs: tuple[ProcessedRun, ...]
    campaign: CampaignFit | None
    no_fit: str
    vehicle: VehicleConfig
    terrain: str
    sources: tuple[Source, ...] = ()
    command: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    diagnosed: Diagnosis | None = None
    no_diagnosis: str = ""
    diagnosis_failed: bool = False
    tables: tuple[BenchFiles, ...] = ()
    last: LastReport | None = None
    set_aside: tuple[SetAsideRun, ...] = ()

    @property
    def several_terrains(self) -> Note | None:
        """What says that the diagnosed runs are probably not of one soil; None where they may be."""
        return None if self.diagnosed is None else several_terrains(self.diagnosed)

    @property
    def diagnosis(self) -> Diagnosis:
        """The diagnosis; `DataError` with the reason if there is none, and the section that needs it is left out."""
        if self.diagnosed is None:
            raise DataError(self.no_diagnosis)
        return self.diagnosed

    @property
    def fit(self) -> CampaignFit:
        """The fit; `DataError` with the reason if there is none, and the section that needs it is left out."""
        if self.campaign is None:
            raise DataError(self.no_fit)
        return self.campaign

    @property
    def fitted(self) -> tuple[ProcessedRun, ...]:
        """The runs that the fit took: those that lack no signal it needs."""
        return whole_runs(self.runs)

    @property
    def not_fitted(self) -> str:
        """The other runs in words; empty where there are none, or none was fitted."""
        names = [run.run.id for run in self.runs if run.quality.missing and self.campaign]
        return listed(names) if len(names) <= _NAMED else f"{len(names)} of {len(self.runs)} runs"

    @cached_property
    def pool(self) -> Pool:
        """The used samples of all fitted runs in one."""
        return Pool(self.fitted, self.fit.models)

    @cached_property
    def recommendation(self) -> Recommendation:
        """The recommended model beside the baseline; `DataError` where there is neither a diagnosis nor a fit."""
        if self.diagnosed is not None and self.diagnosed.plot_data:
            return of_diagnosis(self.diagnosed)
        return of_fit(self.fit, tuple(run.run.id for run in self.fitted), self.pool)

    @cached_property
    def sigmas(self) -> dict[str, dict[str, FloatArray]]:
        """One-sigma of each model on the pool's samples; see `model_sigmas`."""
        return model_sigmas(self.fitted, self.fit)

    @cached_property
    def traction(self) -> Traction:
        """Pull at slip 0.2, best drawbar coefficient and efficiency; measured where there is no soil."""
        if self.campaign is None or self.vehicle.wheel is None:
            return traction_of(self.fitted)
        wheel, fit = wheel_of(self.vehicle), self.campaign
        return steady_traction(self.diagnosed, self.fitted, wheel, fit.soil, fit.options.reading)

    @cached_property
    def grades(self) -> tuple[Grade, ...]:
        """What each run is worth, losses of its recording counted in; a zero that is a named cause is in all runs."""
        sources = [self.source_of(run) for run in self.runs]
        named = self.diagnosed.causes if self.diagnosed is not None and self.diagnosed.verdict == "named" else ()
        of_role = {EFFECTS[cause.key].needs.zero_of: cause for cause in named if cause.key in EFFECTS}
        zeros = {role: f"{plain_name(c.name)}, the named cause: see Do next" for role, c in of_role.items() if role}
        return tuple(
            grade_of(run, [*zeros.values(), *told, *(source.lost if source else [])], zeros)
            for run, told, source in zip(
                self.runs, short_runs(self.runs, runs_apart(self.diagnosed)), sources, strict=True
            )
        )

    @property
    def poor(self) -> list[str]:
        """The runs to drive again."""
        return [run.run.id for run, grade in zip(self.runs, self.grades, strict=True) if grade.level == "poor"]

    @property
    def usable_runs(self) -> str:
        """How many of the given runs can be used, in words."""
        usable, given = len(self.grades) - len(self.poor), len(self.grades) + len(self.set_aside)
        return f"{usable} of {given} runs {'used' if usable == len(self.grades) < given else 'usable'}"

    @property
    def to_check(self) -> dict[str, str]:
        """Runs that can be used but lie apart, are short, or of which much is excluded, and why."""
        return runs_to_check(self.runs, self.grades) | dict.fromkeys(runs_apart(self.diagnosed), "lies apart")

    @property
    def facts(self) -> list[list[str]]:
        """What was configured of vehicle and soil, as rows of text."""
        rows = [[*fact] for fact in subject_of(self.vehicle).items()]
        if self.campaign is None:
            return rows
        soil = self.campaign.soil
        return [
            *rows,
            ["soil", soil.name],
            ["cohesion c", f"{soil.cohesion_pa / 1e3:g} kPa"],
            ["friction angle φ", f"{np.degrees(soil.friction_angle_rad):g}°"],
            ["shear modulus K", f"{soil.shear_modulus_m:g} m"],
            ["sinkage exponent n", f"{soil.sinkage_exponent:g}"],
            ["cohesive modulus k_c", f"{soil.cohesive_modulus / 1e3:g} kN/mⁿ⁺¹"],
            ["frictional modulus k_φ", f"{soil.frictional_modulus / 1e3:g} kN/mⁿ⁺²"],
        ]

    def predictions_of(self, run: ProcessedRun) -> dict[str, Prediction]:
        """Return what each model says of a run's samples, by its name; nothing of a run that was not fitted."""
        place = next((i for i, fitted in enumerate(self.fitted) if fitted is run), None)
        return {} if place is None else {model.name: model.predictions[place] for model in self.fit.models}

    def source_of(self, run: ProcessedRun) -> Source | None:
        """Return the file of a run."""
        return next((source for source in self.sources if source.run_id == run.run.id), None)


def source_of(run: Run) -> Source:
    """Return what a report says of a run's file."""
    size, recording = sum(file.stat().st_size for file in run.files), run.recording
    source = Source(run.id, run.path.name, size, sha256_of(*run.files), frames=None, dropped_frames=None)
    if recording is None:
        return source
    return replace(
        source,
        frames=sum(recording.frame_counts.values()),
        dropped_frames=sum(recording.drops.values()) if recording.drops else None,
        loss=tuple(map(str, recording.loss)),
        gaps=tuple(note_text(gap.note()) for gap in recording.gaps),
        losses=recording.losses,
        exit_status=recording.exit_status,
        clock=recording.metadata.get("clock", {}),
        clock_steps=recording.metadata.get("clock_steps", {}),
        events=tuple(event for event in recording.events() if event.name == "mark" or event.severity != "info"),
    )


def source_of_table(wheel_test: BenchFiles) -> Source:
    """Return what a report says of a table's file."""
    path = Path(wheel_test.rows.name)
    return Source(wheel_test.name, path.name, path.stat().st_size, sha256_of(path), frames=None, dropped_frames=None)


def versions() -> dict[str, str]:
    """Return the versions of what makes the numbers."""
    names = ("numpy", "scipy", "cantools", "mcap")
    return {"wheelsoil": __version__, "Python": platform.python_version(), **{name: version(name) for name in names}}


def command_line() -> str:
    """Return the command that runs now, without the folders of its program."""
    return " ".join(["wheelsoil", *sys.argv[1:]]) if sys.argv and sys.argv[0].endswith("wheelsoil") else "Python"
