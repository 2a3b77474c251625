"""The commands whose numbers are kept: each a case of its own."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from typing import Any

from cli_support import ok
from golden.inputs import PUBLIC, Inputs
from golden.outputs import contents

CAMPAIGNS = ("clay", "sandy", "biased", "braked", "literal")
OF_A_CAMPAIGN = {
    "info": "info {%s} --json",
    "process": "process {%s} -o {out}/samples.csv --json",
    "fit": "fit {%s} --json",
    "diagnose": "diagnose {%s} -o {out}/model.toml --json",
    "sinkage": "sinkage {%s} --json",
}
CMU = (
    "--table {cmu} --rename vertical_load_n=load_N,drawbar_pull_n=drawbar_pull_N,sinkage_m=sinkage_mm*0.001,"
    "group=Vry_nominal_mm_s --where beta_deg=0 --where wheel="
)
SMOOTH = CMU + "smooth --vehicle {real}/smooth.toml"
GROUSERED = CMU + "grouser --vehicle {real}/grousered.toml"
PUBLISHED = (
    "--table {published} --rename drawbar_pull_n=meas_drawbar_pull_n,sinkage_m=meas_sinkage_m,"
    "driving_torque_nm=meas_torque_nm --where "
)
DING = PUBLISHED + "source=ding2011 --where grouser_height_m=%s --vehicle {wheels}/ding-%s.toml"
HURRELL = PUBLISHED + "source=hurrell2025_rashid1 --vehicle {wheels}/hurrell.toml"
TABLES = {
    "cmu-smooth": (SMOOTH, "{real}/terrain.toml"),
    "cmu-grousered": (GROUSERED, "{real}/terrain.toml"),
    "ding-smooth": (DING % ("0.0", "smooth"), "{wheels}/ding-soil.toml"),
    "ding-lugged": (DING % ("0.01", "lugged"), "{wheels}/ding-soil.toml"),
    "hurrell": (HURRELL, "{wheels}/hurrell-soil.toml"),
}
OTHERS = {
    "clay-report": "report {clay} -o {out}/report.html --json",
    "sandy-report": "report {sandy}/run-1.mcap {sandy}/run-2.mcap --no-diagnosis -o {out}/report.html --json",
    "biased-report": "report {biased} -o {out}/report.html --json",
    "braked-report": "report {braked} --no-diagnosis -o {out}/report.html --json",
    "literal-report": "report {literal} --sinkage literal -o {out}/report.html --json",
    "clay-parquet": "process {clay} -o {out}/samples.parquet --rate 50 --json",
    "clay-export": "export {clay}/run-1.mcap -o {out} --format csv --json",
    "clay-plan": "diagnose --plan {clay} -o {out}/cosines.csv --json",
    "literal-fit-literal": "fit {literal} --sinkage literal --channels dp,t --json",
    "joint-diagnose": "diagnose {biased} {braked} --next-run --json",
    "plates-soil": "soil --plate {plates}/*.csv --json",
    "bevameter-soil": "soil --plate {bevameter}/plate-*.csv --radius 0.05 0.05 0.1 0.1"
    " --shear {bevameter}/shear-*.csv -o {out}/terrain.toml --json",
    "run-info": "info {clay}/run-1.mcap --json",
    "run-process": "process {clay}/run-1.mcap -o {out}/samples.csv --json",
    "short-fit": "fit {short} --json",
    "run-sinkage": "sinkage {clay}/run-1.mcap --json",
    "table-diagnose": "diagnose --table {single_wheel} --vehicle {wheels}/hurrell.toml"
    " --terrain {wheels}/hurrell-soil.toml --most-causes 1 --effects vasilev,interface_friction --channels dp,z --json",
}
IN_EVERY_TEST = ("run-info", "run-process", "bevameter-soil", "run-sinkage", "short-fit", "table-diagnose")
"""Cases that `make test` runs: each room, in a few seconds."""


@dataclass(frozen=True)
class Case:
    """A command line whose ``{names}`` stand for inputs, and ``{out}`` for a folder of its own."""

    name: str
    line: str

    @property
    def needs_public_data(self) -> bool:
        """Whether an input comes from WHEELSOIL_DATA."""
        return any(field in PUBLIC for _, field, _, _ in Formatter().parse(self.line))

    def outputs(self, inputs: Inputs) -> dict[str, Any]:
        """Run the command; return what it prints and what it writes, by the names of the files."""
        inputs["out"] = inputs.folder / f"{self.name}.out"
        inputs["out"].mkdir()
        found = {"stdout": ok(*_arguments(self.line, inputs)).json}
        found |= {path.name: contents(path) for path in sorted(inputs["out"].rglob("*"))}
        return {name: value for name, value in found.items() if value is not None}


def _arguments(line: str, inputs: Inputs) -> Iterator[str]:
    for word in shlex.split(line):
        text = word.format_map(inputs)
        folder, slash, pattern = text.rpartition("/")
        many = slash and "*" in pattern
        yield from sorted(map(str, Path(folder).glob(pattern))) if many else [text]


def _cases() -> Iterator[Case]:
    for campaign in CAMPAIGNS:
        for command, line in OF_A_CAMPAIGN.items():
            yield Case(f"{campaign}-{command}", line % campaign)
    for table, (options, terrain) in TABLES.items():
        yield Case(f"{table}-fit", f"fit {options} --terrain {terrain} --slip-threshold 0 --json")
        if table != "ding-lugged":  # as the smooth wheel, and long
            yield Case(f"{table}-diagnose", f"diagnose {options} --terrain {terrain} --most-causes 2 --json")
        if table.startswith("ding"):  # the others hold no torque
            yield Case(f"{table}-sinkage", f"sinkage {options} --json")
    for name, line in OTHERS.items():
        yield Case(name, line)


CASES = {case.name: case for case in _cases()}
