"""State of the page: opened recordings as campaigns, with their runs, choices and results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from time import monotonic
from typing import Any, Literal

import numpy as np

from daq import ConfigError, DataError, Fault, FloatArray, WheelsoilError
from daq.runs import Collected, Run, campaign_folders, readable
from model.wheel_soil import REFERENCE_INFLATION_KPA, Soil, Wheel
from processing import LOOK, Interval, ProcessOptions, check_within
from wheelsoil.view.curve import Base
from wheelsoil.view.jobs import Member, PlotData
from wheelsoil.wording.notes import texts_of
from wheelsoil.workflows import Files, known_soil, wheel_of
from wheelsoil.workflows.choice import CHOICE_FILE, Choice, ChosenRun, is_called, load_choice, runs_in_use
from wheelsoil.workflows.diagnosis import Together, together
from wheelsoil.workflows.grading import Grade, grade_of
from wheelsoil.workflows.runs import wheel_id

RunState = Literal["waiting", "processing", "ready", "failed"]
Keeps = tuple[tuple[PlotData, tuple[Interval, ...] | None], ...]
_USUAL_SPEED_MPS = 2.0
_TELLING = 0.1
"""Share of a diagnosis from which its speed is known well enough."""
DiagnosisState = Literal["none", "running", "done", "failed"]


@dataclass
class ViewedRun:
    """A run on the page.

    Attributes
    ----------
    key : str
        Identifies the run on the page.
    state : "waiting", "processing", "ready" or "failed"
    faults : tuple of Fault
        Why it failed.
    options : ProcessOptions or None
        Options of the last processing, successful or not.
    file : Path or None
        Contains the processed run.
    ended : int
        Number of consecutive ends of the helper while it processed this run.
    graded : tuple of (PlotData, keep, short, Grade), or None
        The last grade and its inputs.
    """

    key: str
    run: Run
    state: RunState = "waiting"
    faults: tuple[Fault, ...] = ()
    options: ProcessOptions | None = None
    plot_data: PlotData | None = None
    file: Path | None = None
    ended: int = 0
    graded: tuple[PlotData, tuple[Interval, ...] | None, list[str], Grade] | None = None

    def update_state(self, wanted: ProcessOptions) -> None:
        """Set the state: waiting if the wanted options differ from those of the last processing."""
        if self.options != wanted:
            self.state = "waiting"
        else:
            self.state = "failed" if self.faults else "ready"

    @property
    def refused(self) -> str:
        """Why the run is impossible as it is declared, or on firm ground without having coasted; empty where not."""
        return self.plot_data.no_use if self.plot_data else ""

    @property
    def on_soil(self) -> bool:
        """Whether a model is fitted to the run, once it is processed, and drawn over it."""
        return self.run.info.ground == "soft" and not self.refused

    def grade(self, plot_data: PlotData, keep: tuple[Interval, ...] | None, short: list[str]) -> Grade:
        """Return the grade of the kept part, as in the report; `short` is of `short_runs`."""
        if self.graded is None or self.graded[0] is not plot_data or self.graded[1:3] != (keep, short):
            grade = grade_of(plot_data.kept(keep), [*short, *plot_data.lost])
            self.graded = (plot_data, keep, short, grade)
        return self.graded[3]


@dataclass
class DiagnosisOnPage:
    """A diagnosis: its state, how far it is, its result, and the pending answers: of it, and whether it is kept.

    `ended` says what became of the one before, where that was cancelled or no longer holds.
    """

    state: DiagnosisState = "none"
    asked: Future[dict[str, Any]] | None = None
    recalled: Future[dict[str, Any] | None] | None = None
    found: dict[str, Any] | None = None
    faults: tuple[Fault, ...] = ()
    ended: str = ""
    share: float = 0.0
    began_s: float | None = None
    ends_s: float = 0.0

    def watch(self, share: float) -> None:
        """Take the share that is done, 0 to 1, and expect the rest to go on at the same speed."""
        now_s = monotonic()
        if self.began_s is None:
            self.began_s = now_s
        if share > self.share:
            self.share = share
            self.ends_s = now_s + (now_s - self.began_s) * (1.0 - share) / share

    @property
    def left_s(self) -> int | None:
        """About how many seconds it will still take; None where too little is done to say."""
        return max(ceil(self.ends_s - monotonic()), 1) if self.state == "running" and self.share > _TELLING else None


@dataclass
class ViewedCampaign:
    """Runs of one terrain and one wheel.

    Attributes
    ----------
    folder : Path
        Where the choice is saved.
    others : tuple of Run
        Recordings of the same folder with another terrain or wheel, and not with this one.
    soil_name : str or None
        A preset instead of terrain.toml.
    whole : bool
        Whether it was given as a folder, not as recordings.
    not_identifiable : mapping reading -> (mapping family -> reason)
        Families of effects that these data cannot identify; filled on request.
    chosen : int
        Number of choices since the page was opened.
    fits : list of Future
        Pending fits.
    fits_ended : str
        Why the last ones that were pending got no answer.
    medians : mapping run's key ("": all runs) -> (kept parts, load in N, ground speed in m/s)
        The last medians of the used samples, NaN if there are none, and the parts they were computed from.
    """

    key: str
    name: str
    folder: Path
    runs: list[ViewedRun]
    others: tuple[Run, ...] = ()
    soil_name: str | None = None
    whole: bool = True
    choice: Choice = field(default_factory=Choice)
    saved_at: Path | None = None
    diagnosis: DiagnosisOnPage = field(default_factory=DiagnosisOnPage)
    not_identifiable: dict[str, dict[str, str]] = field(default_factory=dict)
    chosen: int = 0
    fits: list[Future[dict[str, Any]]] = field(default_factory=list)
    fits_ended: str = ""
    medians: dict[str, tuple[Keeps, float, float]] = field(default_factory=dict)

    @property
    def first(self) -> Run:
        """The first run; terrain and wheel are the same for all."""
        return self.runs[0].run

    @property
    def options(self) -> ProcessOptions:
        """Options of the processing of its runs."""
        return self.choice.process_options(LOOK)

    @property
    def pending(self) -> int:
        """Number of runs that are not processed yet."""
        return sum(run.state in ("waiting", "processing") for run in self.runs)

    @property
    def soil(self) -> Soil:
        """The laboratory's soil; `ConfigError` if it is not known."""
        return known_soil(self.soil_name, self.first.terrain)

    @property
    def wheel(self) -> Wheel:
        """The wheel; `ConfigError` if it is not described."""
        return wheel_of(self.first.vehicle, self.first.vehicle_source)

    def keeps(self) -> dict[str, tuple[Interval, ...] | None]:
        """Return the kept intervals (None: all) of each used run by its key; `ConfigError` if the choice is unfit."""
        named = [self._named(section) for section in self.choice.runs]
        in_use, faults = runs_in_use(replace(self.choice, runs=tuple(named)), [run.run for run in self.runs])
        ConfigError.stop_if_any(faults)
        kept = {chosen.run.id: chosen.keep for chosen in in_use}
        return {run.key: kept[run.run.id] for run in self.runs if run.run.id in kept}

    def section_of(self, run: Run) -> ChosenRun:
        """Return the section of the choice for a run as it was given; an empty one if there is none."""
        matching = (section for section in self.choice.runs if is_called(self._named(section), run))
        return next(matching, ChosenRun())

    def _named(self, section: ChosenRun) -> ChosenRun:
        """Return a section identified by the id alone if both id and file match a run; ids on the page are unique."""
        files = {run.run.id: run.run.path.name for run in self.runs}
        alone = files.get(section.id) == section.file
        return replace(section, sha256="", file="" if alone else section.file)

    def ready_members(self) -> tuple[Member, ...]:
        """Return the runs that are used, possible and already processed, for a helper."""
        keeps = self.keeps()
        ready = [run for run in self.runs if run.state == "ready" and run.key in keeps and not run.refused]
        there = [(run.file, keeps[run.key]) for run in ready]
        return tuple(Member(file, keep) for file, keep in there if file is not None)

    def members(self) -> tuple[Member, ...]:
        """Return the runs that are used, for a helper.

        `ConfigError` where the choice does not fit the runs, or one could not be processed or lacks what a fit needs;
        `NotReadyError` while some are not processed yet.
        """
        keeps = self.keeps()
        used = [run for run in self.runs if run.key in keeps]
        step = "switch the run off, or correct the error"
        faults = [fault for run in used if run.state == "failed" for fault in run.faults]
        ConfigError.stop_if_any(replace(fault, next_step=fault.next_step or step) for fault in faults)
        pending = sum(run.state != "ready" for run in used)
        if pending:
            what = f"{pending} of {len(used)} runs are not processed yet"
            raise NotReadyError.of(what, self.name, next_step="wait until they are, or switch them off")
        lacking = [(run, text) for run in used if run.plot_data for text in run.plot_data.missing.values()]
        step = "correct vehicle.toml and open the page again, or switch the run off"
        ConfigError.stop_if_any(Fault(text, f"run {run.run.id}", next_step=step) for run, text in lacking)
        if used and all(run.refused for run in used):
            raise ConfigError(*(Fault(run.refused, f"run {run.run.id}") for run in used))
        return self.ready_members()

    def base(self, load_n: float | None = None, run_key: str = "") -> Base:
        """Return the conditions for which curves are drawn, at a load or at the median of the used samples.

        They are those of all used runs if no run is given or it has no usable load. `ConfigError` where soil or wheel
        is not known; `NotReadyError` or `DataError` where no run with a usable load is processed yet, or none has one.
        """
        keeps = self.keeps()
        used = [run for run in self.runs if run.key in keeps and run.plot_data and run.on_soil]
        own = [run for run in self.runs if run.key == run_key and run.plot_data]
        median_n, speed_mps = self._medians(run_key, own, keeps) if own else (np.nan, np.nan)
        if np.isnan(median_n):
            own = used
            median_n, speed_mps = self._medians("", own, keeps)
        if load_n is None and np.isnan(median_n):
            kind = NotReadyError if self.pending else DataError
            expected = "a run with a usable vertical load"
            whys = dict.fromkeys(
                why
                for run in self.runs
                if run.key in keeps and run.plot_data
                for why in (*run.plot_data.missing.values(), run.refused)
            )
            what = ", and ".join(filter(None, whys)) or "the load on the wheel is not known"
            raise kind(Fault(what, self.name, expected=expected))
        infos = [run.run.info for run in own] or [self.first.info]
        return Base(
            wheel=self.wheel,
            soil=self.soil,
            load_n=median_n if load_n is None else load_n,
            ground_speed_mps=_USUAL_SPEED_MPS if np.isnan(speed_mps) else speed_mps,
            direction=-1.0 if all(info.direction == "back" for info in infos) else 1.0,
            pass_number=float(max(map(_passage, own), default=self.first.info.pass_number)),
            inflation_kpa=min(filter(None, (info.inflation_kpa for info in infos)), default=REFERENCE_INFLATION_KPA),
        )

    def _medians(
        self, key: str, own: Sequence[ViewedRun], keeps: Mapping[str, tuple[Interval, ...] | None]
    ) -> tuple[float, float]:
        """Return the medians of load (N) and ground speed (m/s) over the used samples of some runs; NaN if unknown."""
        there = tuple((run.plot_data, keeps.get(run.key)) for run in own if run.plot_data)
        if key not in self.medians or self.medians[key][0] != there:
            runs = [plot_data.kept(keep) for plot_data, keep in there]
            load_n, speed_mps = (
                _median([getattr(run, name)[run.used] for run in runs])
                for name in ("vertical_load_n", "ground_speed_mps")
            )
            self.medians[key] = (there, load_n, speed_mps)
        return self.medians[key][1:]

    def campaign_time(self, data: PlotData) -> FloatArray:
        """Return the campaign's clock of a run's drawn samples, from -1/2 to 1/2; see `Conditions`."""
        there = [run.plot_data.run for run in self.runs if run.plot_data]
        first_ns = min(run.start_ns for run in there)
        span_s = max((run.start_ns - first_ns) * 1e-9 + float(run.time_s[-1]) for run in there)
        return ((data.run.start_ns - first_ns) * 1e-9 + data.trace.time_s) / max(span_s, 1e-9) - 0.5

    def check_keeps(self) -> None:
        """Check that the choice fits the runs, and its intervals those that are already processed: `ConfigError`."""
        keeps = self.keeps()
        for run in self.runs:
            kept = keeps.get(run.key)
            if run.plot_data is not None and kept is not None:
                check_within(kept, run.plot_data.end_s, f"run {run.run.id}")


def _passage(run: ViewedRun) -> int:
    """Return the wheels that have driven over the soil, with this one; the pass of a run that is not processed."""
    return run.plot_data.run.passage if run.plot_data else run.run.info.pass_number


def _median(pieces: Sequence[FloatArray]) -> float:
    values = np.concatenate([np.zeros(0), *pieces])
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


class NotReadyError(WheelsoilError):
    """The result is not available yet."""


def open_campaigns(paths: Sequence[Path], files: Files) -> tuple[list[ViewedCampaign], list[str]]:
    """Open recordings and group them: one campaign for each folder, soil and wheel.

    A folder of campaign folders means all of them. As on the command line, run ids are unique within a campaign only. A
    `choice.toml` in a folder is loaded; one that cannot be used is reported and not changed. The texts are remarks:
    unreadable files and folders, which are skipped, and the parts of a choice that do not fit. `WheelsoilError` where
    nothing is readable (`daq.runs.open_runs`).
    """
    remarks: list[str] = []
    folders: list[Path] = []
    loose: list[Path] = []
    collected = Collected()
    for path in paths:
        with collected.catch(), readable(path):
            if path.is_dir():
                folders += campaign_folders(path)
            else:
                loose.append(path)
    opened: list[Run] = []
    for part in [*([folder] for folder in folders), *([loose] if loose else [])]:
        with collected.catch():
            opened += files.each_run(part, lambda run: remarks.extend([run.message] * bool(run.message)))
    if not opened:
        collected.stop_if_any()
    faults = dict.fromkeys(fault for error in collected.errors for fault in error.faults)
    remarks += [f"{fault.where} is skipped: {fault.what}" for fault in faults]
    groups: dict[Together, list[ViewedRun]] = {}
    once = {(run.path.resolve(), wheel_id(run)): run for run in opened}
    for number, run in enumerate(once.values(), 1):
        groups.setdefault(together(run, folders, files.soil), []).append(ViewedRun(f"r{number}", run))
    loose_groups = [group for shared, group in groups.items() if not shared.folder]
    if len(loose_groups) > 1:
        for group in loose_groups:
            of_wheel = replace(files, wheel=wheel_id(group[0].run) or files.wheel)
            alone = of_wheel.open_runs([viewed.run.path for viewed in group], set_aside=lambda _: None)
            for viewed, run in zip(group, alone, strict=True):
                viewed.run = run
    campaigns = [
        _campaign(f"c{number}", folder, runs, [r for o, g in groups.items() if o.folder == folder for r in g], files)
        for number, ((folder, _, _), runs) in enumerate(groups.items(), 1)
    ]
    for campaign in campaigns:
        remarks += _load_choice(campaign)
    return campaigns, remarks


def _campaign(
    key: str, folder: str, runs: list[ViewedRun], all_runs: Sequence[ViewedRun], files: Files
) -> ViewedCampaign:
    place = Path(folder).resolve() if folder else runs[0].run.path.resolve().parent
    own = {run.run.path for run in runs}
    others = tuple(run.run for run in all_runs if folder and run.run.path not in own)
    terrain, wheel = runs[0].run.terrain, wheel_id(runs[0].run)
    parts = (place.name, terrain.soil.name if others and terrain else "", f"wheel {wheel}" if wheel else "")
    return ViewedCampaign(key, ", ".join(filter(None, parts)), place, runs, others, files.soil, whole=bool(folder))


def _load_choice(campaign: ViewedCampaign) -> list[str]:
    """Load the choice beside the runs; return the errors of it, and its warnings about the runs."""
    path = campaign.folder / CHOICE_FILE
    if not path.is_file():
        return []
    try:
        choice = load_choice(path)
        own = [run.run for run in campaign.runs]
        in_use, faults = runs_in_use(choice, [*own, *campaign.others])
        ConfigError.stop_if_any(faults)
        choice.process_options()
    except WheelsoilError as error:
        return [f"{path} is not used: {error.what}"]
    choice = replace(choice, runs=tuple(r for r in choice.runs if any(is_called(r, run) for run in own)))
    if runs_in_use(choice, own)[1]:
        return []  # it belongs to the other terrain of the folder
    campaign.choice, campaign.saved_at = choice, path
    return [text for chosen in in_use for text in texts_of(chosen.warnings)]
