"""``wheelsoil demo``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.errors import ConfigError, Fault
from wheelsoil.cli.options import Json
from wheelsoil.cli.talk import number, print_facts, print_json, say

if TYPE_CHECKING:
    from model.fit_result import CampaignFit

_HIDDEN = {"m1": 0.1, "m2": 0.05}
"""The paper's coefficients of Lyasko's law on clay (Tab. 3): what the demo hides in the soil and has to find."""
_MANIFEST = "manifest.toml"


def command(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where everything is written.")
    ] = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same frames.")] = 0,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 6,
    duration: Annotated[float, typer.Option(metavar="S", help="Of each run.")] = 40.0,
    json: Json = False,
) -> None:
    """Show the whole way on simulated frames: simulate, record, process, fit, report; takes less than a minute.

    A vehicle is driven over clay whose slip sinkage follows Lyasko's law. Its frames go through the DBCs into
    recordings; from there on nothing knows what was hidden.
    """
    from processing.options import ProcessOptions
    from wheelsoil.fitting import FitChoices, fit_runs
    from wheelsoil.reporting import report_of_processed
    from wheelsoil.runs import open_and_process
    from wheelsoil.virtual_campaign import simulate_campaign
    from wheelsoil.virtual_options import SimulationOptions

    options = SimulationOptions(effects={"lyasko": _HIDDEN}, runs=runs, duration_s=duration, seed=seed)
    _check_folder(output)
    campaign = output / "clay"
    with _step("simulate and record"):
        output.mkdir(parents=True, exist_ok=True)
        simulated = simulate_campaign(campaign, options, force=True)
    say(f"  {runs} runs, {simulated.frames:,} frames in {campaign}")
    choices = FitChoices()
    process_options = ProcessOptions(purpose="fit")
    with _step("decode and process"):
        processed = open_and_process([campaign], process_options)
    with _step("fit four models"):
        fit = fit_runs(processed, choices, None)
    with _step("write the report"):
        report = report_of_processed(processed, choices, process_options, campaign=fit)
        page, numbers = report.write(output / "report.html")
    hidden = _compare(fit)
    if json:
        print_json({"report": page, "numbers": numbers, "result": report.sentence, "hidden": hidden})
        return
    say(report.sentence)
    low, high = hidden["interval95"]
    say(
        f"Hidden in the soil: Lyasko with m1 + m2 = {number(hidden['truth'])}; "
        f"found: {number(hidden['value'])} ({number(low)} to {number(high)})"
    )
    print_facts([("report", str(page)), ("numbers", str(numbers)), ("recordings", str(campaign))])


@contextmanager
def _step(name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    say(f"{name}: {time.perf_counter() - start:.1f} s")


def _check_folder(output: Path) -> None:
    """Refuse a folder that holds somebody's own campaign."""
    campaign = output / "clay"
    if campaign.is_dir() and any(campaign.iterdir()) and not (campaign / _MANIFEST).is_file():
        raise ConfigError(
            Fault(
                "the folder holds something that is not of a demo", str(campaign), next_step="choose another: -o FOLDER"
            )
        )


def _compare(fit: CampaignFit) -> dict[str, Any]:
    found = fit.model("lyasko").estimate("p")
    return {
        "name": "p",
        "truth": sum(_HIDDEN.values()),
        "value": found.value,
        "interval95": found.interval,
        "inside": found.interval[0] <= sum(_HIDDEN.values()) <= found.interval[1],
    }
