"""How the diagnosis was made: noise model, soils, notes, and how long each stage took."""

from __future__ import annotations

from math import isfinite

from wheelsoil.diagnosis_words import plain_name
from wheelsoil.report.content import Block, Section, Table, Text
from wheelsoil.report.material import Material
from wheelsoil.report.words import PARAMETERS, number

KEY = "workings"
TITLE = "How the diagnosis was made"


def build(material: Material) -> Section:
    """Build the section."""
    found = material.diagnosis
    blocks: list[Block] = [Text(f"{note[0].upper()}{note[1:].rstrip('.')}.") for note in found.notes if note]
    if found.noise:
        rows = [[plain_name(name), number(value)] for name, value in found.noise.items()]
        note = "Estimated from these runs by marginal likelihood; everything else on this page is weighed with it."
        blocks.append(Table("Noise model", ["quantity", "value"], rows, note))
    for soil in found.soils:
        rows = [
            [PARAMETERS.get(name, name), number(value, 4), _sigma(soil.sigmas.get(name, float("nan")))]
            for name, value in soil.values.items()
        ]
        note = "SI units. With the named cause in the model, or none where none is named."
        blocks.append(Table(f"Soil as the data leave it: {soil.campaign}", ["parameter", "value", "sigma"], rows, note))
    if found.stages_s:
        rows = [[plain_name(name), f"{seconds:.2f}"] for name, seconds in found.stages_s.items()]
        blocks.append(Table("Stages", ["stage", "time (s)"], rows))
    numbers = {"noise": found.noise, "soils": found.soils, "notes": found.notes, "stages_s": found.stages_s}
    return Section(KEY, TITLE, blocks or [Text("Nothing is known of it.")], numbers)


def _sigma(value: float) -> str:
    return number(value, 2) if isfinite(value) else "–"
