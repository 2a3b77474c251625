"""How the diagnosis was made: noise model, soils, notes, and how long each stage took."""

from __future__ import annotations

from math import isfinite

from wheelsoil.report.content import Block, Section, Table, Text
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.words import letter, named_with_unit, number
from wheelsoil.wording.names import plain_name
from wheelsoil.wording.notes import texts_of

KEY = "workings"
TITLE = "How the diagnosis was made"

_SOIL = {
    "cohesion_pa": "Pa",
    "tan_phi": "",
    "shear_modulus_m": "m",
    "sinkage_exponent": "",
    "cohesive_modulus": "N/m^(n+1)",
    "frictional_modulus": "N/m^(n+2)",
}
"""Units of `model.wheel_soil.wheel_soil_model.SOIL_PARAMETERS`."""


def build(material: ReportInputs) -> Section:
    """Build the section."""
    found = material.diagnosis
    blocks: list[Block] = [Text(f"{note[0].upper()}{note[1:].rstrip('.')}.") for note in texts_of(found.notes)]
    if found.noise:
        named = [(*named_with_unit(name), value) for name, value in found.noise.items()]
        rows = [[name, number(value), unit] for name, unit, value in named]
        note = "Estimated from these runs by marginal likelihood; everything else on this page is weighed with it."
        blocks.append(Table("Noise model", ["quantity", "value", "unit"], rows, note))
    for soil in found.soils:
        rows = [
            [letter(name), number(value, 4), _sigma(soil.sigmas.get(name, float("nan"))), _SOIL[name]]
            for name, value in soil.values.items()
        ]
        note = "With the named cause in the model, or none where none is named."
        blocks.append(
            Table(f"Soil as the data leave it: {soil.campaign}", ["parameter", "value", "sigma", "unit"], rows, note)
        )
    if found.stages_s:
        rows = [[plain_name(name), f"{seconds:.2f}"] for name, seconds in found.stages_s.items()]
        blocks.append(Table("Stages", ["stage", "time (s)"], rows))
    numbers = {"noise": found.noise, "soils": found.soils, "notes": found.notes, "stages_s": found.stages_s}
    return Section(KEY, TITLE, blocks or [Text("Nothing is known of it.")], numbers)


def _sigma(value: float) -> str:
    return number(value, 2) if isfinite(value) else "–"
