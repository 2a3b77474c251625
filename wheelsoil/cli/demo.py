"""``wheelsoil demo``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated

import typer

from daq import ConfigError, Fault
from wheelsoil.cli.console import print_json, print_pairs, say, terminal_width
from wheelsoil.cli.options import Json

if TYPE_CHECKING:
    from model.diagnosis import Diagnosis
    from wheelsoil.simulation.options import SimulationOptions

_CAMPAIGN = "clay"
_MANIFEST = "manifest.toml"
_CAVEAT = (
    "Simulator and diagnosis share their physics: the demo shows that the program works, not that the model is right. "
    "docs/blind_results.md has results with an independent simulator, docs/real_data.md with real measurements."
)


def demo_command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder.")] = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the hidden effect, the soil and the noise.")] = 10,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 6,
    duration: Annotated[float, typer.Option(metavar="S", help="Duration of each run.")] = 40.0,
    json: Json = False,
) -> None:
    """Simulate a vehicle with a hidden effect, diagnose its CAN frames, compare with the true value; 15 s to a minute.

    The seed draws a cause of the library (family, form, size, direction), or none. The vehicle drives over a clay
    drawn within the laboratory's uncertainty; its frames are encoded with the DBCs into recordings. Processing and
    diagnosis read these recordings only.
    """
    from wheelsoil.wording.diagnosis_text import diagnosis_lines
    from wheelsoil.wording.verdict import sentence_of
    from wheelsoil.workflows.demo import draw_hidden, open_envelope

    _check_folder(output)
    options = _campaign(seed, runs, duration)
    hidden = draw_hidden(seed, options.wheel)
    found, page, numbers = _simulate_to_report(output, replace(options, effects=hidden.effects))
    opened = open_envelope(hidden, found)
    if json:
        print_json(
            {
                "report": page,
                "numbers": numbers,
                "recordings": output / _CAMPAIGN,
                "result": sentence_of(found),
                "verdict": found.verdict,
                "hidden": {"family": hidden.family, "effect": hidden.key, "parameters": hidden.values},
                "outcome": opened.outcome,
                "compared": opened.parameters,
            }
        )
        return
    width = terminal_width()
    for line in ["", *diagnosis_lines(found, width), "", *wrap(f"Hidden effect. {opened.sentence} {_CAVEAT}", width)]:
        say(line)
    print_pairs([("report", str(page)), ("numbers", str(numbers)), ("recordings", str(output / _CAMPAIGN))])


def _campaign(seed: int, runs: int, duration_s: float) -> SimulationOptions:
    """Return the options of the simulation, without the hidden effect."""
    from wheelsoil.simulation.options import SimulationOptions

    return SimulationOptions(
        runs=runs,
        duration_s=duration_s,
        seed=seed,
        draw_soil=True,
        pass_number=(1, 1, 1, 2, 2, 2),
        inflation_kpa=(340.0, 340.0, 250.0, 250.0),
    )


def _simulate_to_report(output: Path, options: SimulationOptions) -> tuple[Diagnosis, Path, Path]:
    """Run everything from frames to the report; return the diagnosis and the paths of page and numbers."""
    from processing import ProcessOptions
    from wheelsoil.simulation.campaign import simulate_campaign
    from wheelsoil.workflows.diagnosis import campaigns_of, diagnose_campaigns, diagnosis_options
    from wheelsoil.workflows.fit import FitChoices, fit_runs
    from wheelsoil.workflows.report import Diagnosed, report_of_processed
    from wheelsoil.workflows.runs import open_and_process

    folder = output / _CAMPAIGN
    choices, process_options = FitChoices(), ProcessOptions(purpose="diagnose")
    with _step("simulate and record"):
        output.mkdir(parents=True, exist_ok=True)
        simulated = simulate_campaign(folder, options, force=True)
    say(f"  {options.runs} runs, {simulated.frames:,} frames in {folder}")
    with _step("decode and process"):
        processed = open_and_process([folder], process_options)
    with _step("diagnose"):
        found = diagnose_campaigns(campaigns_of([folder], processed), diagnosis_options())
    with _step("fit four models"):
        fit = fit_runs(processed, choices, None)
    with _step("write the report"):
        report = report_of_processed(processed, choices, process_options, campaign=fit, diagnosed=Diagnosed(found))
        page, numbers = report.write(output / "report.html")
    return found, page, numbers


@contextmanager
def _step(name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    say(f"{name}: {time.perf_counter() - start:.1f} s")


def _check_folder(output: Path) -> None:
    """Reject a folder with a campaign that is not a demo."""
    campaign = output / _CAMPAIGN
    if campaign.is_dir() and any(campaign.iterdir()) and not (campaign / _MANIFEST).is_file():
        raise ConfigError(
            Fault(
                "the folder contains files that are not from a demo",
                str(campaign),
                next_step="choose another: -o FOLDER",
            )
        )
