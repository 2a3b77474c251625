"""The analysis session behind the page: its campaigns, their processing in the background, and every request."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, TypeVar

from daq import ConfigError, DataError, Fault, WheelsoilError, nearest
from model.effects import EFFECTS
from model.wheel_soil import Reading, prior_of
from processing import Interval, ProcessOptions, with_by_hand
from processing.pipeline import shares_of
from wheelsoil import __version__
from wheelsoil.view import jobs
from wheelsoil.view.campaigns import DiagnosisOnPage, NotReadyError, ViewedCampaign, ViewedRun, open_campaigns
from wheelsoil.view.changes import rows_of_difference
from wheelsoil.view.counts import selected_of
from wheelsoil.view.curve import checked_values, curve_of, effect_entries, over_time, soil_parameters
from wheelsoil.view.helper import Helper, HelperEndedError
from wheelsoil.view.jobs import Member, PlotData, process_run
from wheelsoil.view.medians import compared
from wheelsoil.view.messages import CurveAsked, PredictionAsked, SelectedAsked, campaign_entry, fault_of_ours
from wheelsoil.view.saving import saved
from wheelsoil.view.trace import Signals, signal_as_json, trace_as_json
from wheelsoil.workflows.choice import SCHEMA, parse_choice
from wheelsoil.workflows.runs import Files

_TRIES = 3

_ENDED = {
    "running": "it was cancelled because the choice was changed",
    "done": "the choice was changed since the last diagnosis",
}
_CHANGED, _CANCELLED = "the choice was changed in the meantime", "it was cancelled"
"""Why a diagnosis by its state, or a fit, ended without a result."""

_OF_DIAGNOSIS = frozenset({"run", "cutoff_hz", "min_speed_mps", "max_gap_s", "sinkage"})
"""Keys of a choice that a diagnosis depends on; the others concern the fit only."""

_Keyed = TypeVar("_Keyed", ViewedCampaign, ViewedRun)


class Processing:
    """A thread that hands waiting runs to a helper process.

    `lock` guards the state of the campaigns, `zero` stands in for the zero files that the vehicles name, `folder` is
    for the processed runs, and `whole` is called with a campaign whose runs are all processed.
    """

    def __init__(
        self,
        campaigns: Sequence[ViewedCampaign],
        lock: threading.RLock,
        helper: Helper,
        zero: Path | None,
        folder: Path,
        whole: Callable[[ViewedCampaign], None],
    ) -> None:
        self._campaigns, self._lock, self._helper, self._zero, self._folder = campaigns, lock, helper, zero, folder
        self._whole = whole
        self._preferred: ViewedRun | None = None
        self._news = threading.Event()
        self._closed = False
        self._number = count(1)
        self._thread = threading.Thread(target=self._process, name="processing", daemon=True)
        self._thread.start()

    def prefer(self, run: ViewedRun) -> None:
        """Process this run next, because the page displays it."""
        self._preferred = run

    def wake(self) -> None:
        """Check again whether runs are waiting."""
        self._news.set()

    def close(self) -> None:
        """Start no further run; the current one ends when the helper is closed."""
        self._closed = True
        self._news.set()

    def _process(self) -> None:
        while not self._closed:
            self._news.clear()
            with self._lock:
                waiting = [(run, c.options) for c in self._campaigns for run in c.runs if run.state == "waiting"]
                first = [found for found in waiting if found[0] is self._preferred]
                found = next(iter(first or waiting), None)
                if found is not None:
                    found[0].state = "processing"
            if found is None:
                self._news.wait()
            else:
                self._process_one(*found)

    def _process_one(self, run: ViewedRun, options: ProcessOptions) -> None:
        target = self._folder / f"{run.key}-{next(self._number)}.pickle"
        try:
            plot_data = self._helper.ask(process_run, run.run, options, self._zero, target).result()
        except HelperEndedError as error:
            self._try_again(run, options, error)
        except WheelsoilError as error:
            self._put(run, options, faults=error.faults)
        except Exception as error:  # noqa: BLE001  # one run must not stop the others
            self._put(run, options, faults=(fault_of_ours(error, run.run.id),))
        else:
            self._put(run, options, plot_data=plot_data, file=target)

    def _try_again(self, run: ViewedRun, options: ProcessOptions, error: HelperEndedError) -> None:
        """Queue a run again after the helper ended; after `_TRIES` ends the run has failed."""
        with self._lock:
            run.ended += 1
            if run.ended < _TRIES:
                run.state = "waiting"
                return
        step = "close programs if memory is short; then switch the run off and on again"
        self._put(run, options, faults=tuple(replace(fault, next_step=step) for fault in error.faults), ended=run.ended)

    def _put(
        self,
        run: ViewedRun,
        options: ProcessOptions,
        *,
        plot_data: PlotData | None = None,
        file: Path | None = None,
        faults: tuple[Fault, ...] = (),
        ended: int = 0,
    ) -> None:
        with self._lock:
            if run.file is not None:
                with suppress(OSError):  # Windows deletes no file that a helper reads; `close` does
                    run.file.unlink()
            run.options, run.plot_data, run.file, run.faults, run.ended = options, plot_data, file, faults, ended
            campaign = next(viewed for viewed in self._campaigns if run in viewed.runs)
            run.update_state(campaign.options)
            self._whole(campaign)


class UnknownKeyError(ConfigError):
    """No campaign or run has this key."""


class AnalysisSession:
    """The campaigns on the page and the helper processes that compute; every method may be called from any thread.

    Opening `paths` (recordings, logs, campaign folders) raises what `daq.runs.open_runs` does. `against` is the place
    of the last report, or of a store, with which each diagnosis is compared; empty: with nothing.
    """

    def __init__(self, paths: Sequence[Path], files: Files, against: str = "") -> None:
        self.paths = tuple(paths)
        self.files, self.against = files, against
        self.campaigns, self.remarks = open_campaigns(paths, files)
        self.lock = threading.RLock()
        self._started = token_hex(8)
        self._scratch = TemporaryDirectory(prefix="wheelsoil-view-", ignore_cleanup_errors=True)
        self._quick, self._slow = Helper("quick helper"), Helper("slow helper")
        folder = Path(self._scratch.name)
        self._processing = Processing(self.campaigns, self.lock, self._quick, files.zero, folder, self._recall)

    def close(self) -> None:
        """End the helpers and delete their files; pending requests fail. Calling it again has no effect."""
        self._processing.close()
        self._quick.close()
        self._slow.close()
        self._scratch.cleanup()

    def list(self) -> dict[str, Any]:
        """Return the campaigns with their runs; `started` is a new random text at each start of the server."""
        with self.lock:
            campaigns = [campaign_entry(campaign, self.files) for campaign in self.campaigns]
        return {"version": __version__, "started": self._started, "remarks": self.remarks, "campaigns": campaigns}

    def run(self, campaign_key: str, run_key: str) -> dict[str, Any]:
        """Return the points of a run that are drawn; `shares` is the share of all samples by exclusion reason."""
        data, keep = self._ready(campaign_key, run_key)
        trace = data.trace
        reason = trace.reason if keep is None else with_by_hand(trace.reason, trace.time_s, keep)
        shares = {why.lower(): share for why, share in shares_of(data.kept(keep).reason).items() if why != "USED"}
        marks = [{"at_s": at_s, "text": text} for at_s, text in data.marks]
        return trace_as_json(trace, reason) | {"shares": shares, "marks": marks}

    def signals(self, campaign_key: str, run_key: str) -> dict[str, Any]:
        """Return the names of a run's decoded signals, with their units."""
        found = self._decoded(campaign_key, run_key)
        return {"signals": [{"name": name, "unit": signal.unit} for name, signal in found.items()]}

    def signal(self, campaign_key: str, run_key: str, name: str) -> dict[str, Any]:
        """Return the points of a decoded signal; `UnknownKeyError` if there is none of this name."""
        found = self._decoded(campaign_key, run_key)
        if name not in found:
            raise UnknownKeyError.of("there is no such signal", "name", repr(name), nearest(name, found))
        return signal_as_json(found[name])

    def _decoded(self, campaign_key: str, run_key: str) -> Signals:
        """Return the decoded signals of a run; they are decoded once, and kept in a file."""
        data, _ = self._ready(campaign_key, run_key)
        with self.lock:
            run = _of_key(self.campaign(campaign_key).runs, run_key, "run")
        file = Path(self._scratch.name) / f"{run_key}-signals.pickle"
        if not file.exists():
            self._quick.ask(jobs.decode_run, run.run, data.run.start_ns, file, urgent=True).result()
        return jobs.decoded(file)

    def compare(self, places: Sequence[tuple[str, str]]) -> dict[str, Any]:
        """Return medians of two runs or campaigns (without a run) from all samples, and what their diagnoses differ in.

        See `compared` and `rows_of_difference`; `changes` are None of one campaign, and where `undiagnosed` names some.
        """
        groups, viewed = [], []
        for campaign_key, run_key in places:
            with self.lock:
                campaign = self.campaign(campaign_key)
                keeps = campaign.keeps()
                runs = [_of_key(campaign.runs, run_key, "run")] if run_key else campaign.runs
                chosen = [(run.plot_data, keeps.get(run.key)) for run in runs if run_key or run.key in keeps]
                viewed.append((campaign.name, campaign.diagnosis.found))
            groups.append([data.kept(keep) for data, keep in chosen if data])
        found = [diagnosis for _, diagnosis in viewed if diagnosis is not None]
        two = places[0][0] != places[1][0]
        return compared(groups) | {
            "changes": rows_of_difference(*found) if two and len(found) == len(viewed) else None,
            "undiagnosed": [name for name, diagnosis in viewed if two and diagnosis is None],
        }

    def selected(self, asked: SelectedAsked) -> dict[str, Any]:
        """Return a summary of the selected samples of a run; see `wheelsoil.view.counts.selected_of`."""
        data, keep = self._ready(asked.campaign, asked.run)
        return selected_of(data.kept(keep), asked)

    def _ready(self, campaign_key: str, run_key: str) -> tuple[PlotData, tuple[Interval, ...] | None]:
        """Return a processed run and the intervals that are kept (None: all).

        `UnknownKeyError` if there is no such run, `NotReadyError` if it is not processed yet, else the faults of its
        processing.
        """
        with self.lock:
            campaign = self.campaign(campaign_key)
            run = _of_key(campaign.runs, run_key, "run")
            self._processing.prefer(run)
            if run.state == "failed":
                raise DataError(*run.faults)
            if run.plot_data is None or run.state != "ready":
                raise _not_processed(run)
            return run.plot_data, campaign.keeps().get(run.key)

    def parameters(self, key: str) -> dict[str, Any]:
        """Return the adjustable parameters; `complete` is false until all runs are processed."""
        with self.lock:
            campaign = self.campaign(key)
            base, choices = campaign.base(), campaign.choice.fit_choices()
            soil, terrain = campaign.soil, campaign.first.terrain if campaign.soil_name is None else None
            reasons, roles = campaign.not_identifiable.get(choices.reading), campaign.first.vehicle.signals
            asked = campaign.ready_members(), campaign.options
            chosen, pending = campaign.choice.effects, campaign.pending
        if reasons is None and not pending:
            reasons = self._not_identifiable(asked[0])
            with self.lock:
                if (campaign.ready_members(), campaign.options) == asked:
                    campaign.not_identifiable[choices.reading] = reasons
                else:
                    reasons = None  # these runs are processed again
        return {
            "complete": reasons is not None,
            "base": base,
            "soil": soil_parameters(soil, prior_of(soil, terrain)),
            "effects": list(effect_entries(base, choices.reading, reasons or {}, roles, chosen)),
        }

    def _not_identifiable(self, members: Sequence[Member]) -> dict[str, str]:
        asked = self._quick.ask(jobs.not_identifiable, members, self.paths, self.files.soil, urgent=True)
        try:
            found: dict[str, str] = asked.result()
        except HelperEndedError:
            raise
        except WheelsoilError as error:
            return dict.fromkeys((effect.name for effect in EFFECTS.values()), error.what)
        return found

    def curve(self, asked: CurveAsked) -> dict[str, Any]:
        """Return the model's curve for the given values; `ms` is the computing time."""
        began_s = perf_counter()
        values = checked_values(asked.effects, asked.values, asked.soil)
        with self.lock:
            campaign = self.campaign(asked.campaign)
            base = campaign.base(asked.load_n, asked.run or "")
            reading: Reading = asked.sinkage or campaign.choice.fit_choices().reading
        found = curve_of(base, asked.effects, reading, values)
        return {**found, "ms": round(1e3 * (perf_counter() - began_s), 2)}

    def prediction(self, asked: PredictionAsked) -> dict[str, Any]:
        """Return the model at the drawn samples of a run, as they stand in the answer of `run`."""
        values = checked_values(asked.effects, asked.values, asked.soil)
        with self.lock:
            campaign = self.campaign(asked.campaign)
            run = _of_key(campaign.runs, asked.run, "run")
            data = run.plot_data  # also while it is processed again: the page draws its old samples meanwhile
            if data is None:
                raise DataError(*run.faults) if run.faults else _not_processed(run)
            base = campaign.base(asked.load_n, asked.run)
            reading: Reading = asked.sinkage or campaign.choice.fit_choices().reading
            clock = campaign.campaign_time(data)
        return dict(over_time(base, replace(data.conditions, campaign_time=clock), asked.effects, reading, values))

    def choose(self, key: str, raw: dict[str, Any]) -> dict[str, Any]:
        """Apply a choice and return the campaign's entry; runs are processed again if their processing options changed.

        `ConfigError` lists every error of the choice.
        """
        choice = parse_choice({"schema": SCHEMA, **raw}, "choice")
        choice.process_options()
        with self.lock:
            campaign = self.campaign(key)
            before = campaign.choice
            if choice != before:
                campaign.choice = choice
                try:
                    campaign.check_keeps()
                except ConfigError:
                    campaign.choice = before
                    raise
                # The keys of choice.toml whose values differ, but for marks and comments.
                old, new = before.without_remarks().to_mapping(), choice.without_remarks().to_mapping()
                self._discard_results(campaign, {name for name in {*old, *new} if old.get(name) != new.get(name)})
            campaign.chosen += 1
            for run in campaign.runs:
                if run.ended:
                    run.ended, run.options = 0, None
                if run.state != "processing":
                    run.update_state(campaign.options)
            entry = campaign_entry(campaign, self.files)
            self._recall(campaign)
        self._processing.wake()
        return entry

    def _recall(self, campaign: ViewedCampaign) -> None:
        """Have the diagnosis of a campaign stand there if all its runs are processed and it is kept; asked for once."""
        mine = campaign.diagnosis
        if campaign.pending or mine.state != "none" or mine.recalled is not None:
            return
        with suppress(WheelsoilError):
            members, choices = campaign.members(), campaign.choice.fit_choices()
            given = members, self.paths, self.files.soil, choices, self.against
            asked = self._quick.ask(jobs.kept_diagnosis, *given)
            mine.recalled = asked
            asked.add_done_callback(lambda _: self._put_kept(campaign, mine, asked))

    def _put_kept(self, campaign: ViewedCampaign, mine: DiagnosisOnPage, asked: Future[dict[str, Any] | None]) -> None:
        if asked.cancelled() or asked.exception() is not None or asked.result() is None:
            return
        with self.lock:
            if campaign.diagnosis is mine:
                mine.found, mine.state, mine.share = asked.result(), "done", 1.0

    def _discard_results(self, campaign: ViewedCampaign, changed: set[str]) -> None:
        """Discard the results of another choice, and cancel the computations for it."""
        campaign.saved_at = None
        if not changed:
            return
        campaign.not_identifiable = {}
        dropped, campaign.fits, campaign.fits_ended = campaign.fits, [], _CHANGED
        for asked in dropped:
            self._quick.drop(asked)
        if changed & _OF_DIAGNOSIS:
            if campaign.diagnosis.asked is not None:
                self._slow.drop(campaign.diagnosis.asked)
            if campaign.diagnosis.recalled is not None:
                campaign.diagnosis.recalled.cancel()
            mine = campaign.diagnosis
            campaign.diagnosis = DiagnosisOnPage(ended=_ENDED.get(mine.state, mine.ended))

    def fit(self, key: str) -> dict[str, Any]:
        """Fit the campaign with its choice; the numbers are those of ``wheelsoil fit --choice``."""
        with self.lock:
            campaign = self.campaign(key)
            choice = campaign.choice
            members, choices = campaign.members(), choice.fit_choices()
            asked = self._quick.ask(jobs.fit_members, members, choices, self.files.soil, urgent=True)
            campaign.fits.append(asked)
        try:
            found: dict[str, Any] = asked.result()
        finally:
            with self.lock:
                if asked not in campaign.fits:
                    raise NotReadyError.of(f"no fit: {campaign.fits_ended}", campaign.name, next_step="fit again")
                campaign.fits.remove(asked)
        return found

    def diagnose(self, key: str) -> dict[str, Any]:
        """Start the diagnosis of a campaign in the background and return the campaign's entry."""
        with self.lock:
            campaign = self.campaign(key)
            if any(other.diagnosis.state == "running" for other in self.campaigns):
                raise NotReadyError.of("a diagnosis is running already", next_step="wait until it has ended")
            members, choices = campaign.members(), campaign.choice.fit_choices()
            mine = campaign.diagnosis = DiagnosisOnPage("running")
            given = members, self.paths, self.files.soil, choices, self.against
            asked = mine.asked = self._slow.ask(jobs.diagnose_members, *given, watch=mine.watch)
            entry = campaign_entry(campaign, self.files)

        def done(_: object) -> None:
            if asked.cancelled():
                return
            error = asked.exception()
            with self.lock:
                if error is None:
                    mine.found, mine.state, mine.share = asked.result(), "done", 1.0
                else:
                    mine.state = "failed"
                    mine.faults = error.faults if isinstance(error, WheelsoilError) else (fault_of_ours(error),)

        asked.add_done_callback(done)
        return entry

    def cancel(self, key: str) -> dict[str, Any]:
        """Cancel the fits and the diagnosis of a campaign that are underway, and return the campaign's entry."""
        with self.lock:
            campaign = self.campaign(key)
            dropped, campaign.fits, campaign.fits_ended = campaign.fits, [], _CANCELLED
            if campaign.diagnosis.state == "running":
                running, campaign.diagnosis = campaign.diagnosis.asked, DiagnosisOnPage(ended=_CANCELLED)
            else:
                running = None
            entry = campaign_entry(campaign, self.files)
        for asked in dropped:
            self._quick.drop(asked)
        if running is not None:
            self._slow.drop(running)
        return entry

    def diagnosis(self, key: str) -> dict[str, Any]:
        """Return the diagnosis as ``diagnose --json`` prints it."""
        with self.lock:
            diagnosis = self.campaign(key).diagnosis
            if diagnosis.faults:
                raise DataError(*diagnosis.faults)
            if diagnosis.found is None:
                raise NotReadyError.of("there is no diagnosis", found=diagnosis.state, next_step="start one")
            return diagnosis.found

    def save(self, key: str, name: str, *, replace_it: bool) -> dict[str, Any]:
        """Write the choice beside the runs; return its path and the campaign's entry; see `saved`."""
        campaign = self.campaign(key)
        choice = campaign.choice
        path = saved(campaign, name, replace_it=replace_it)
        with self.lock:
            if campaign.choice == choice:
                campaign.saved_at = path
            return {"path": str(path), "campaign": campaign_entry(campaign, self.files)}

    def campaign(self, key: str) -> ViewedCampaign:
        """Return a campaign by its key; `UnknownKeyError` if there is none."""
        return _of_key(self.campaigns, key, "campaign")


def _of_key(where: Sequence[_Keyed], key: str, what: str) -> _Keyed:
    found = next((viewed for viewed in where if viewed.key == key), None)
    if found is None:
        raise UnknownKeyError.of(f"there is no such {what}", what, repr(key), ", ".join(viewed.key for viewed in where))
    return found


def _not_processed(run: ViewedRun) -> NotReadyError:
    return NotReadyError.of("the run is not processed yet", run.run.id, found=run.state)
