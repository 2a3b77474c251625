"""Output of the commands that take the runs of several wheels, one wheel after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from daq import ALL_WHEELS
from wheelsoil.console import print_json, print_pairs, say, say_folded

if TYPE_CHECKING:
    from daq import Fault
    from daq.runs import Run, SetAsideRun
    from processing import ProcessedRun
    from wheelsoil.workflows.choice import Choice
    from wheelsoil.workflows.diagnosis import Processed
    from wheelsoil.workflows.runs import Check, Files

_OF_CAUSES = ("causes", "further_causes")


def print_set_aside(runs: Sequence[SetAsideRun]) -> None:
    """Print the runs that are not used below a result: name and text."""
    if runs:
        print()
        print_pairs([("set aside", f"{run.run}: {run.reason}") for run in runs])


class PerWheel:
    """Does the work of a command for each wheel: texts under headings, JSON of several wheels as one list.

    `opened` has the runs of each wheel (`wheelsoil.workflows.runs.Files.runs_of_wheels`); what is `unreadable` could
    not be opened, and is of every wheel.
    """

    def __init__(self, opened: Mapping[str, list[Run]], *, json: bool, unreadable: Sequence[SetAsideRun] = ()) -> None:
        self._opened, self._json, self._unreadable = opened, json, unreadable
        self.set_aside_runs: list[SetAsideRun] = []
        self._found: list[dict[str, Any]] = []
        self._shown = 0
        self._said: dict[str, str] = {}
        self._remarks: list[str] = []
        self.doubts: Sequence[Fault] = ()
        self.wheel = ""
        """Of which the work is done now; `set_aside_runs` are not used of it, `doubts` are of all together."""

    @property
    def several(self) -> bool:
        """Whether there is more than one wheel."""
        return len(self._opened) > 1

    def each(self, work: Callable[[list[Run]], object], together: Callable[[], None] | None = None) -> None:
        """Do the work of each wheel; what is wrong with one is raised when that of all is done.

        `together` is done last, where several wheels have a result.
        """
        from daq.runs import Collected

        collected = Collected()
        try:
            for wheel, runs in self._opened.items():
                self.wheel, self.set_aside_runs, self._remarks = wheel, [*self._unreadable], []
                if self.several:
                    say(self._heading)
                with collected.catch(self._heading if wheel else ""):
                    work(runs)
            if together and self.several and len(self._opened) - len(collected.errors) < 2:
                say("fewer than two wheels have a result: nothing is of all wheels together")
            elif together and self.several:
                if collected.errors:
                    say("a wheel without a result is not among all wheels together")
                self.wheel, self.set_aside_runs, self._remarks = ALL_WHEELS, [], []
                say(self._heading)
                with collected.catch(self._heading):
                    together()
        finally:
            if self._found:
                print_json(self._found if self.several else self._found[0])
            if len(self._said) > 1:
                print()
                print_pairs(self._said.items())
        collected.stop_if_any()

    def processed(
        self, purpose: str, runs: Sequence[Run], files: Files, choice: Choice, check: Check | None = None
    ) -> list[tuple[Run, ProcessedRun]]:
        """Process the runs of this wheel; of one with an id those that lack a signal are set aside, where one has all.

        A diagnosis is given the whole of them, as a report shows them.
        """
        import numpy as np

        from daq.runs import SetAsideRun
        from processing import LOOK
        from wheelsoil.workflows.fit import nothing_whole

        found = self._process(LOOK, runs, files, choice, check) if self.wheel else []
        torque = "driving_torque is missing" if purpose in ("fit_torque", "sinkage") else ""
        lacking = [
            nothing_whole([done]) or ("" if np.isfinite(done.driving_torque_nm).any() else torque) for _, done in found
        ]
        if all(lacking):  # then this says what is wrong
            return self._process(purpose, runs, files, choice, check)
        for (run, _), why in zip(found, lacking, strict=True):
            if why:
                message = f"set aside: run {run.id}, wheel {self.wheel}: {why}"
                self.set_aside(SetAsideRun(run.id, "silent", why, "drive it again, or go on without it", message))
        return [each for each, why in zip(found, lacking, strict=True) if purpose == "diagnose" or not why]

    def _process(
        self, purpose: str, runs: Sequence[Run], files: Files, choice: Choice, check: Check | None
    ) -> list[tuple[Run, ProcessedRun]]:
        """Process runs as a choice says, and remark what makes them implausible."""
        from wheelsoil.workflows import process_on_soil
        from wheelsoil.workflows.grading import doubted_runs, doubted_soils

        options = choice.process_options(purpose)
        processed = process_on_soil(runs, options, files, choice=choice, check=check, set_aside=self.set_aside)
        soils = doubted_soils(run.terrain for run, _ in processed if files.soil is None)
        for text in (*doubted_runs([run for _, run in processed]), *soils):
            self.remark(text)
        return processed

    def doubt(self, of_wheels: Mapping[str, Processed]) -> None:
        """Print what makes it doubtful that the wheels have one clock and their places (stderr), and keep it."""
        from wheelsoil.workflows.vehicle import doubts_of_wheels

        there = {wheel: processed for wheel, processed in of_wheels.items() if processed}
        self.doubts = doubts_of_wheels(there) if len(there) > 1 else ()
        for doubt in self.doubts:
            say(str(doubt))

    def set_aside(self, run: SetAsideRun) -> None:
        """Print why a run of this wheel is not used (stderr), and list it below the result."""
        from wheelsoil.workflows.runs import noted_in

        noted_in(self.set_aside_runs)(run)

    def remark(self, text: str) -> None:
        """Print what is noted of this wheel's runs (stderr), and keep it for the JSON."""
        say_folded(text)
        self._remarks.append(text)

    def show(self, as_json: Callable[[], dict[str, Any]], print_text: Callable[[], None], sentence: str = "") -> None:
        """Print what was found of the wheel, or keep it for the JSON of all; its `sentence` stands at the end, too."""
        if self._json:
            aside, remarks = [run.facts() for run in self.set_aside_runs], [*dict.fromkeys(self._remarks)]
            beside = {"runs_set_aside": aside, "doubts": self.doubts, "remarks": remarks}
            self._found.append(self._with_wheel(as_json() | {key: value for key, value in beside.items() if value}))
            return
        if self.several:
            print(f"\n{self._heading}" if self._shown else self._heading)
        self._shown += 1
        print_text()
        print_set_aside(self.set_aside_runs)
        if sentence:
            self._said[self._heading] = sentence

    @property
    def _heading(self) -> str:
        return "all wheels together" if self.wheel == ALL_WHEELS else f"wheel {self.wheel}"

    def _with_wheel(self, found: dict[str, Any]) -> dict[str, Any]:
        """Return JSON with the wheel's id beside it and beside every cause in it; its size, if any, as `wheel_size`.

        Of all wheels together a cause has the wheel at which it acts alone, if it does.
        """
        if not self.wheel:
            return found
        of_causes = {
            key: [{"wheel": self.wheel, **cause} for cause in found[key]]
            for key in _OF_CAUSES
            if key in found and self.wheel != ALL_WHEELS
        }
        sized = {"wheel_size" if key == "wheel" else key: value for key, value in found.items()}
        return {"wheel": self.wheel, **sized, **of_causes}
