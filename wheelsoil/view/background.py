"""Background processing of the runs on the page, one after another; the displayed run comes first."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

from daq import Fault, WheelsoilError
from processing import ProcessOptions
from wheelsoil.view.campaigns import ViewedCampaign, ViewedRun
from wheelsoil.view.entries import fault_of_ours
from wheelsoil.view.helper import Helper, HelperEndedError
from wheelsoil.view.jobs import PlotData, process_run

_TRIES = 3


class Processing:
    """A thread that hands waiting runs to a helper process.

    Parameters
    ----------
    lock : RLock
        Guards the state of the campaigns.
    zero : Path or None
        A zero file in place of those that the vehicles name.
    folder : Path
        For the processed runs.
    """

    def __init__(
        self,
        campaigns: Sequence[ViewedCampaign],
        lock: threading.RLock,
        helper: Helper,
        zero: Path | None,
        folder: Path,
    ) -> None:
        self._campaigns, self._lock, self._helper, self._zero, self._folder = campaigns, lock, helper, zero, folder
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
                found = self._next()
                if found is not None:
                    found[0].state = "processing"
            if found is None:
                self._news.wait()
            else:
                self._process_one(*found)

    def _next(self) -> tuple[ViewedRun, ProcessOptions] | None:
        waiting = [(run, c.options) for c in self._campaigns for run in c.runs if run.state == "waiting"]
        first = [found for found in waiting if found[0] is self._preferred]
        return next(iter(first or waiting), None)

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
                run.file.unlink(missing_ok=True)
            run.options, run.plot_data, run.file, run.faults, run.ended = options, plot_data, file, faults, ended
            run.update_state(next(campaign.options for campaign in self._campaigns if run in campaign.runs))
