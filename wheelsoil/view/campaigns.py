"""What the page knows: campaigns, their runs, what was chosen and what has been found so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daq import ConfigError, DataError, Fault, WheelsoilError
from daq.runs import Run
from model.wheel_soil import REFERENCE_INFLATION_KPA, Soil, Wheel
from processing import LOOK, Interval, ProcessOptions, check_within
from wheelsoil.view.curve import Base
from wheelsoil.view.jobs import Member, Seen
from wheelsoil.wording.notes import Grade, grade_of
from wheelsoil.workflows.choice import Choice, ChosenRun, is_called, runs_in_use
from wheelsoil.workflows.fit import known_soil, wheel_of

RunState = Literal["waiting", "processing", "ready", "failed"]
Keeps = tuple[tuple[Seen, tuple[Interval, ...] | None], ...]
_USUAL_SPEED_MPS = 2.0
DiagnosisState = Literal["none", "running", "done", "failed"]


@dataclass
class ViewedRun:
    """A run on the page.

    Attributes
    ----------
    key : str
        Of this run on the page.
    run : Run
    state : "waiting", "processing", "ready" or "failed"
    faults : tuple of Fault
        Why it failed.
    options : ProcessOptions or None
        What `seen` was processed with, or the failure.
    seen : Seen or None
    file : Path or None
        Holds the processed run.
    ended : int
        How often in a row the helper ended while it was at it.
    graded : tuple of (Seen, keep, Grade), or None
        The last grade, and of what.
    """

    key: str
    run: Run
    state: RunState = "waiting"
    faults: tuple[Fault, ...] = ()
    options: ProcessOptions | None = None
    seen: Seen | None = None
    file: Path | None = None
    ended: int = 0
    graded: tuple[Seen, tuple[Interval, ...] | None, Grade] | None = None

    def settle(self, wanted: ProcessOptions) -> None:
        """Say whether what was processed is what is wanted."""
        if self.options != wanted:
            self.state = "waiting"
        else:
            self.state = "failed" if self.faults else "ready"

    def grade(self, seen: Seen, keep: tuple[Interval, ...] | None) -> Grade:
        """Return the grade of what is kept of it, as the report gives it."""
        if self.graded is None or self.graded[0] is not seen or self.graded[1] != keep:
            self.graded = (seen, keep, grade_of(seen.kept(keep), seen.lost))
        return self.graded[2]


@dataclass
class DiagnosisOnPage:
    """A diagnosis, how far it is, and what it says once it is done; `asked` is what the helper makes of it."""

    state: DiagnosisState = "none"
    asked: Future[dict[str, Any]] | None = None
    found: dict[str, Any] | None = None
    faults: tuple[Fault, ...] = ()


@dataclass
class ViewedCampaign:
    """Runs of one terrain and one wheel.

    Attributes
    ----------
    key, name : str
    folder : Path
        Where the choice is saved.
    runs : list of ViewedRun
    others : tuple of Run
        Of the same folder, but of another terrain or wheel.
    soil_name : str or None
        A preset in place of terrain.toml.
    whole : bool
        It was given as a folder, not as recordings.
    choice : Choice
    saved_at : Path or None
    diagnosis : DiagnosisOnPage
    told : mapping reading -> families that cannot be told, with the reason
        Empty until it was asked for.
    chosen : int
        How often somebody has chosen since the page was opened.
    fits : list of Future
        Fits that somebody waits for.
    medians : mapping run's key ("": all runs) -> (what is kept of the runs, load in N, ground speed in m/s)
        The last medians of used samples, NaN where there is none, and of what.
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
    told: dict[str, dict[str, str]] = field(default_factory=dict)
    chosen: int = 0
    fits: list[Future[dict[str, Any]]] = field(default_factory=list)
    medians: dict[str, tuple[Keeps, float, float]] = field(default_factory=dict)

    @property
    def first(self) -> Run:
        """The run that stands for all."""
        return self.runs[0].run

    @property
    def options(self) -> ProcessOptions:
        """How its runs are processed."""
        return self.choice.process_options(LOOK)

    @property
    def pending(self) -> int:
        """Runs that are not processed yet."""
        return sum(run.state in ("waiting", "processing") for run in self.runs)

    @property
    def soil(self) -> Soil:
        """The laboratory's soil.

        Raises
        ------
        ConfigError
            It is not known.
        """
        return known_soil(self.soil_name, self.first.terrain)

    @property
    def wheel(self) -> Wheel:
        """The wheel.

        Raises
        ------
        ConfigError
            It is not described.
        """
        return wheel_of(self.first.vehicle, self.first.vehicle_source)

    def keeps(self) -> dict[str, tuple[Interval, ...] | None]:
        """Return what is kept (None: all) of each run that is used, by its key.

        Raises
        ------
        ConfigError
            The choice does not fit the runs.
        """
        named = [self._named(section) for section in self.choice.runs]
        in_use, faults = runs_in_use(replace(self.choice, runs=tuple(named)), [run.run for run in self.runs])
        if faults:
            raise ConfigError(*faults)
        kept = {chosen.run.id: chosen.keep for chosen in in_use}
        return {run.key: kept[run.run.id] for run in self.runs if run.run.id in kept}

    def section_of(self, run: Run) -> ChosenRun:
        """Return what the choice says of one of the runs, as it was given; an empty section where it says nothing."""
        said = (section for section in self.choice.runs if is_called(self._named(section), run))
        return next(said, ChosenRun())

    def _named(self, section: ChosenRun) -> ChosenRun:
        """Return a section by the id alone where that and the file fit a run; ids on the page are unique."""
        files = {run.run.id: run.run.path.name for run in self.runs}
        alone = files.get(section.id) == section.file
        return replace(section, sha256="", file="" if alone else section.file)

    def ready_members(self) -> tuple[Member, ...]:
        """Return the runs that are used and processed by now, for a helper."""
        keeps = self.keeps()
        there = [(run.file, keeps[run.key]) for run in self.runs if run.state == "ready" and run.key in keeps]
        return tuple(Member(file, keep) for file, keep in there if file is not None)

    def members(self) -> tuple[Member, ...]:
        """Return the runs that are used, for a helper.

        Raises
        ------
        ConfigError
            The choice does not fit the runs, or one could not be processed or lacks what a fit needs.
        NotReadyError
            Some are not processed yet.
        """
        keeps = self.keeps()
        used = [run for run in self.runs if run.key in keeps]
        faults = [fault for run in used if run.state == "failed" for fault in run.faults]
        if faults:
            step = "switch the run off, or mend what is wrong"
            raise ConfigError(*(replace(fault, next_step=fault.next_step or step) for fault in faults))
        pending = sum(run.state != "ready" for run in used)
        if pending:
            what = f"{pending} of {len(used)} runs are still to be processed"
            raise NotReadyError(Fault(what, self.name, next_step="wait until they are, or switch them off"))
        lacking = [(run, text) for run in used if run.seen for text in run.seen.missing.values()]
        if lacking:
            step = "mend vehicle.toml and open the page again, or switch the run off"
            raise ConfigError(*(Fault(text, f"run {run.run.id}", next_step=step) for run, text in lacking))
        return self.ready_members()

    def base(self, load_n: float | None = None, run_key: str = "") -> Base:
        """Return what curves are drawn for.

        Parameters
        ----------
        load_n : float, optional
            In place of the median of the used samples.
        run_key : str
            Draw for one run; of all used ones where it is empty, or that run has no load that can be used.

        Raises
        ------
        ConfigError
            Soil or wheel is not known.
        NotReadyError, DataError
            No run with a usable load is there yet, or at all.
        """
        keeps = self.keeps()
        used = [run for run in self.runs if run.key in keeps and run.seen]
        own = [run for run in self.runs if run.key == run_key and run.seen]
        median_n, speed_mps = self._medians(run_key, own, keeps) if own else (np.nan, np.nan)
        if np.isnan(median_n):
            own = used
            median_n, speed_mps = self._medians("", own, keeps)
        if load_n is None and np.isnan(median_n):
            kind = NotReadyError if self.pending else DataError
            expected = "a run with a usable vertical load"
            missing = dict.fromkeys(text for run in used if run.seen for text in run.seen.missing.values())
            what = ", and ".join(missing) or "the load on the wheel is not known"
            raise kind(Fault(what, self.name, expected=expected))
        infos = [run.run.info for run in own] or [self.first.info]
        return Base(
            wheel=self.wheel,
            soil=self.soil,
            load_n=median_n if load_n is None else load_n,
            ground_speed_mps=_USUAL_SPEED_MPS if np.isnan(speed_mps) else speed_mps,
            direction=-1.0 if all(info.direction == "back" for info in infos) else 1.0,
            pass_number=float(max(info.pass_number for info in infos)),
            inflation_kpa=min(filter(None, (info.inflation_kpa for info in infos)), default=REFERENCE_INFLATION_KPA),
        )

    def _medians(
        self, key: str, own: Sequence[ViewedRun], keeps: Mapping[str, tuple[Interval, ...] | None]
    ) -> tuple[float, float]:
        """Return the medians of load and ground speed over the used samples of some runs; NaN where none is known."""
        there = tuple((run.seen, keeps.get(run.key)) for run in own if run.seen)
        if key not in self.medians or self.medians[key][0] != there:
            runs = [seen.kept(keep) for seen, keep in there]
            load_n, speed_mps = (
                _median([getattr(run, name)[run.used] for run in runs])
                for name in ("vertical_load_n", "ground_speed_mps")
            )
            self.medians[key] = (there, load_n, speed_mps)
        return self.medians[key][1:]

    def check_keeps(self) -> None:
        """See that the choice fits the runs, and what is kept those that are processed by now.

        Raises
        ------
        ConfigError
        """
        keeps = self.keeps()
        for run in self.runs:
            kept = keeps.get(run.key)
            if run.seen is not None and kept is not None:
                check_within(kept, run.seen.end_s, f"run {run.run.id}")


def _median(pieces: Sequence[NDArray[np.float64]]) -> float:
    values = np.concatenate([np.zeros(0), *pieces])
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


class NotReadyError(WheelsoilError):
    """It cannot be said yet."""
