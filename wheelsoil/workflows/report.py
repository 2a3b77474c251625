"""From paths to a report: open, process, fit, build."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from daq import DataError, Note, Severity, VehicleConfig, WheelsoilError
from daq.runs import Run, SetAsideRun
from model import ExtendedModel, FitCode
from model.diagnosis import Campaign, Diagnosis, DiagnosisOptions
from model.fit import CampaignFit
from processing import LOOK, ProcessOptions
from wheelsoil.console import computing, say_folded
from wheelsoil.report.build import Report, build_report
from wheelsoil.report.inputs import ReportInputs, command_line, source_of, source_of_table, versions
from wheelsoil.wording.notes import note_text
from wheelsoil.workflows.choice import Choice, FitChoices, provenance_of
from wheelsoil.workflows.diagnosis import (
    Processed,
    bench_of,
    campaigns_of,
    diagnose_benches,
    diagnose_campaigns,
    diagnosis_options,
    vehicles_of,
    with_advice,
)
from wheelsoil.workflows.fit import fit_runs, fit_table, nothing_whole, one_terrain
from wheelsoil.workflows.last_report import LastReport
from wheelsoil.workflows.runs import Files, noted_in, process_on_soil
from wheelsoil.workflows.tables import BenchFiles


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis, or why there is none, and whether a fault cost it; nothing of these where none was asked for."""

    diagnosis: Diagnosis | None = None
    why_not: str = ""
    failed: bool = False


NOT_DIAGNOSED = Diagnosed()
_log = logging.getLogger(__name__)


def report_of(
    paths: Sequence[Path],
    choice: Choice | None = None,
    files: Files | None = None,
    *,
    extended: ExtendedModel | None = None,
    diagnose: bool = True,
    last: LastReport | Callable[[Processed], LastReport] | None = None,
) -> Report:
    """Open and process runs, fit the models and build the report.

    Parameters
    ----------
    choice : Choice, optional
        Runs, parts of them and settings; None: all of it, the defaults.
    extended : ExtendedModel, optional
        See `FitChoices`.
    diagnose : bool
        Whether to diagnose the runs, too.
    last : LastReport or callable, optional
        An earlier report, with which this one is compared; or what finds it for the processed runs, and may raise.

    Raises
    ------
    WheelsoilError
        The runs cannot be opened or processed, or are of different soils. Runs that cannot be fitted give a report
        that says why.
    """
    files, aside = files or Files(), list[SetAsideRun]()
    opened = files.open_runs(paths, noted_in(aside))
    return report_of_opened(
        opened,
        paths,
        choice or Choice(),
        files,
        extended=extended,
        diagnose=diagnose,
        last=last,
        set_aside=aside,
    )[0]


@dataclass(frozen=True)
class WheelReport:
    """The report of one wheel of a vehicle, and what it was made of; without a report why there is none.

    `page` is the name of its file.
    """

    wheel: str
    processed: Processed = ()
    report: Report | None = None
    diagnosed: Diagnosed = NOT_DIAGNOSED
    page: str = ""
    why: str = ""


def report_of_opened(
    opened: Sequence[Run],
    paths: Sequence[Path],
    choice: Choice,
    files: Files,
    *,
    extended: ExtendedModel | None = None,
    diagnose: bool = True,
    last: LastReport | Callable[[Processed], LastReport] | None = None,
    set_aside: Sequence[SetAsideRun] = (),
) -> tuple[Report, Processed, Diagnosed]:
    """Process, diagnose and fit open runs of one wheel; return their report, and what it is made of.

    `set_aside` could not be opened; see `report_of` for the rest.
    """
    choices, options, aside = choice.fit_choices(extended), choice.process_options(LOOK), [*set_aside]
    processed = process_on_soil(opened, options, files, choice=choice, check=one_terrain, set_aside=noted_in(aside))
    if callable(last):
        last = last(processed)
    with computing("diagnosing"):
        found = diagnosed_runs(paths, processed, choices, files.soil) if diagnose else NOT_DIAGNOSED
    report = report_of_processed(
        processed,
        choices,
        options,
        soil=files.soil,
        diagnosed=found,
        choice=choice,
        last=last,
        set_aside=aside,
        opened=opened,
    )
    return report, processed, found


def report_of_processed(
    processed: Processed,
    choices: FitChoices,
    options: ProcessOptions,
    *,
    soil: str | None = None,
    campaign: CampaignFit | None = None,
    diagnosed: Diagnosed = NOT_DIAGNOSED,
    choice: Choice | None = None,
    last: LastReport | None = None,
    set_aside: Sequence[SetAsideRun] = (),
    opened: Sequence[Run] = (),
) -> Report:
    """Fit processed runs, unless they are already, and build the report; see `report_of`.

    Of those `opened`, runs on firm ground that are static tests of the others stand among the files, too.
    """
    first = one_terrain([run for run, _ in processed])
    problem, aside = "", {run.run for run in set_aside}
    if campaign is None:
        try:
            with computing("fitting"):
                campaign = _fitted(lambda own: fit_runs(processed, own, soil, keep_predictions=True), choices)
        except DataError as error:
            problem = error.what
    inputs = ReportInputs(
        runs=tuple(run for _, run in processed),
        campaign=campaign,
        no_fit=problem,
        vehicle=first.vehicle,
        terrain=campaign.soil.name if campaign else first.terrain.soil.name if first.terrain else "",
        sources=tuple(
            map(
                source_of,
                (
                    *(run for run, _ in processed),
                    *(run for run in opened if run.info.ground == "firm" and run.id not in aside),
                ),
            )
        ),
        command=command_line(),
        options={
            **_plain(choices),
            **asdict(options),
            **({"soil": soil} if soil else {}),
            **(provenance_of(choice) if choice else {}),
        },
        versions=versions(),
        diagnosed=diagnosed.diagnosis,
        no_diagnosis=diagnosed.why_not,
        diagnosis_failed=diagnosed.failed,
        last=last,
        set_aside=tuple(set_aside),
    )
    return build_report(inputs)


def report_of_tables(
    benches: Sequence[BenchFiles],
    choices: FitChoices,
    *,
    options: DiagnosisOptions | None = None,
    diagnose: bool = True,
) -> Report:
    """Fit and diagnose single-wheel tables, and build the report.

    Parameters
    ----------
    options : DiagnosisOptions, optional
        Of the diagnosis.

    Raises
    ------
    ConfigError
        The options are wrong. A table that cannot be fitted or diagnosed gives a report that says why.
    """
    found = _diagnosed_tables(benches, options or diagnosis_options(choices.reading)) if diagnose else NOT_DIAGNOSED
    campaign, problem, first = None, "", benches[0]
    if len(benches) > 1:
        problem = "the tables are of several wheels; `wheelsoil fit --table` takes one at a time"
    else:
        try:
            with computing("fitting"):
                campaign = _fitted(
                    lambda own: fit_table(first.rows, first.wheel, first.soil, own, first.terrain), choices
                )
        except DataError as error:
            problem = error.what
    soils = dict.fromkeys(wheel_test.soil.name for wheel_test in benches)
    inputs = ReportInputs(
        runs=(),
        campaign=campaign,
        no_fit=problem,
        vehicle=VehicleConfig(wheel=benches[0].wheel_section),
        terrain=" and ".join(soils),
        sources=tuple(map(source_of_table, benches)),
        command=command_line(),
        options=_plain(choices),
        versions=versions(),
        diagnosed=found.diagnosis,
        no_diagnosis=found.why_not,
        diagnosis_failed=found.failed,
        tables=tuple(benches),
    )
    return build_report(inputs)


def _fitted(fit: Callable[[FitChoices], CampaignFit], choices: FitChoices) -> CampaignFit:
    """Fit the models; where the one of the model file does not suit the data, the others, with a note that says why."""
    try:
        return fit(choices)
    except DataError as error:
        if choices.extended is None:
            raise
        note = Note(FitCode.MODEL_NOT_USED, Severity.DOUBT, {"why": error.what})
    found = fit(replace(choices, extended=None))
    say_folded(note_text(note))
    return replace(found, notes=(note, *found.notes))


def _diagnosed_tables(benches: Sequence[BenchFiles], options: DiagnosisOptions) -> Diagnosed:
    try:
        with computing("diagnosing"):
            return Diagnosed(diagnose_benches(tuple(map(bench_of, benches)), options))
    except WheelsoilError as error:
        return Diagnosed(why_not=error.what, failed=not isinstance(error, DataError))


def _plain(choices: FitChoices) -> dict[str, object]:
    extended = choices.extended.provenance.get("sentence", "yes") if choices.extended else None
    return {**asdict(replace(choices, extended=None)), "extended": extended}


def diagnosed_runs(paths: Sequence[Path], processed: Processed, choices: FitChoices, soil: str | None) -> Diagnosed:
    """Diagnose the runs of a report; what goes wrong is noted on the page and costs no other section.

    Runs that are too poor get a verdict that says so; an error is a file that is wrong, or a fault of ours.
    """
    if missing := nothing_whole([run for _, run in processed]):
        return Diagnosed(why_not=missing)
    return _diagnosed(lambda: campaigns_of(paths, processed, soil), choices)


def diagnosed_vehicle(
    paths: Sequence[Path], wheels: Sequence[WheelReport], choices: FitChoices, soil: str | None
) -> Diagnosed:
    """Diagnose all wheels of a vehicle together, where more than one is diagnosed; see `diagnosed_runs`."""
    given = [wheel for wheel in wheels if wheel.diagnosed.diagnosis]
    if len(given) < 2:
        return NOT_DIAGNOSED
    with computing("diagnosing all wheels together"):
        found = _diagnosed(lambda: vehicles_of(paths, {wheel.wheel: wheel.processed for wheel in given}, soil), choices)
    alone = {wheel.wheel: wheel.diagnosed.diagnosis for wheel in given if wheel.diagnosed.diagnosis}
    return replace(found, diagnosis=found.diagnosis and with_advice(found.diagnosis, alone))


def _diagnosed(campaigns: Callable[[], Sequence[Campaign]], choices: FitChoices) -> Diagnosed:
    try:
        return Diagnosed(diagnose_campaigns(campaigns(), diagnosis_options(choices.reading)))
    except WheelsoilError as error:
        return Diagnosed(why_not=error.what, failed=not isinstance(error, DataError))
    except Exception as error:  # noqa: BLE001 - the boundary of the report's sections: it must not take the report
        _log.debug("diagnosis", exc_info=True)
        why = f"a fault in the diagnosis ({type(error).__name__}: {error}); please report it"
        return Diagnosed(why_not=why, failed=True)
