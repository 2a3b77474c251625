"""Bevameter results in words: rows for a table, JSON, and the text of a terrain.toml."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, degrees, inf, isfinite
from typing import Any

import numpy as np

from daq import ConfigError, DataError, Fault, TerrainConfig
from daq.series import PlateTest, ShearTest
from model.bevameter import (
    FitFault,
    JointFit,
    PlateFit,
    PressureSinkage,
    ShearFit,
    ShearStrength,
    WindowOptions,
    fit_pressure_sinkage,
    fit_shear_strength,
    terrain_of,
    terrain_toml,
)
from wheelsoil.wording.notes import note_text, texts_of

Rows = tuple[list[str], list[list[str]]]

SCHEMA = "wheelsoil/soil/1"
UNITS = {
    "cohesive_modulus": ("k_c", "N/m^(n+1)", "kN/m^(n+1)", 1e-3),
    "frictional_modulus": ("k_phi", "N/m^(n+2)", "kN/m^(n+2)", 1e-3),
    "stiffness": ("k", "Pa/m^n", "kPa/m^n", 1e-3),
    "sinkage_exponent": ("n", "1", "", 1.0),
    "cohesion_pa": ("c", "Pa", "kPa", 1e-3),
    "tan_phi": ("tan phi", "1", "", 1.0),
    "strength_pa": ("tau_max", "Pa", "kPa", 1e-3),
    "shear_modulus_m": ("K", "m", "mm", 1e3),
}
"""Textbook symbol, SI unit, printed unit and the factor to it, of every parameter."""
ZEROS = {
    "given": "sinkage and pressure counted from the table's zero",
    "contact": "sinkage and pressure counted from where the pressure leaves its baseline",
    "fitted": "sinkage counted from a zero fitted near the contact",
}


@dataclass(frozen=True)
class BenchSoil:
    """What plate and shear tests gave; None where there were no such tests."""

    pressure: PressureSinkage | None
    shear: ShearStrength | None
    window: WindowOptions

    @property
    def joints(self) -> list[JointFit]:
        """The joint fits that there are."""
        return [part.joint for part in (self.pressure, self.shear) if part]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader must know: of each test, then of all plates or shear tests together."""
        texts: list[str] = []
        for part, tests in ((self.pressure, _plates(self)), (self.shear, _shears(self))):
            texts += [f"{test.name}: {note_text(note)}" for test in tests for note in test.warnings]
            texts += [note_text(note) for note in (part.warnings if part else ())]
        return tuple(texts)


def evaluate(
    plates: Sequence[PlateTest], shears: Sequence[ShearTest], window: WindowOptions, *, shear_to_m: float = inf
) -> BenchSoil:
    """Fit what there is; `ConfigError` where no test is there, or a parameter is left open, else `DataError`."""
    if not plates and not shears:
        raise ConfigError.of("there is no test", next_step="give --plate FILE..., --shear FILE..., or both")
    try:
        return BenchSoil(
            pressure=fit_pressure_sinkage(plates, window) if plates else None,
            shear=fit_shear_strength(shears, to_m=shear_to_m) if shears else None,
            window=window,
        )
    except DataError as error:
        if isinstance(error.__cause__, np.linalg.LinAlgError):
            raise ConfigError(_what_is_missing(plates, shears)) from None
        raise DataError(*map(_worded, error.faults)) from None


def _what_is_missing(plates: Sequence[PlateTest], shears: Sequence[ShearTest]) -> Fault:
    """Return which tests are needed where those that are there leave a parameter open."""
    if shears:
        stresses = ", ".join(f"{stress:g}" for stress in sorted({test.normal_stress_pa for test in shears}))
        lengths = ", ".join(f"{max(test.displacement_m, default=0.0):g}" for test in shears)
        found = f"normal stresses {stresses} Pa, displacements up to {lengths} m"
        expected = "two normal stresses, one at least twice the other, and curves that rise over several displacements"
        step = "add a test at another normal stress; check the units of the columns"
        return Fault("the shear tests leave c, phi or K open", shears[0].name, found, expected, step)
    widths = ", ".join(f"{width:g}" for width in sorted({test.width_m for test in plates}))
    step = "add a test with another plate; check the units of the columns"
    what, expected = "the plate tests leave k_c, k_phi or n open", "two sizes, and pressures that rise with the sinkage"
    return Fault(what, plates[0].name, f"plates of {widths} m", expected, step)


def _worded(fault: Fault) -> Fault:
    """Return a fault with what the fit noted of its parameters as sentences."""
    if not isinstance(fault, FitFault):
        return fault
    found = "; ".join([fault.found, *(texts_of(fault.notes) or ["no minimum"])])
    return Fault(fault.what, fault.where, found, fault.expected, fault.next_step)


def _plates(result: BenchSoil) -> tuple[PlateFit, ...]:
    return result.pressure.plates if result.pressure else ()


def _shears(result: BenchSoil) -> tuple[ShearFit, ...]:
    return result.shear.shears if result.shear else ()


def plate_rows(result: BenchSoil) -> Rows:
    """Return the head and a row for each plate test."""
    head = ["plate test", "b m", "k kPa/m^n", "n", "misfit kPa", "zero mm", "window mm", "points"]
    return head, [
        [
            fit.name,
            f"{fit.width_m:.4g}",
            f"{fit.stiffness / 1e3:.4g}",
            f"{fit.exponent:.3f}",
            f"{fit.rms_pa / 1e3:.3g}",
            f"{fit.window.zero_m * 1e3:.2f}",
            f"{fit.window.from_m * 1e3:.1f}-{fit.window.to_m * 1e3:.1f}",
            str(fit.window.points),
        ]
        for fit in _plates(result)
    ]


def shear_rows(result: BenchSoil) -> Rows:
    """Return the head and a row for each shear test."""
    head = ["shear test", "sigma kPa", "tau_max kPa", "K mm", "misfit kPa", "window mm", "points"]
    return head, [
        [
            fit.name,
            f"{fit.normal_stress_pa / 1e3:.4g}",
            f"{fit.strength_pa / 1e3:.4g}",
            f"{fit.shear_modulus_m * 1e3:.3g}",
            f"{fit.rms_pa / 1e3:.3g}",
            f"0-{fit.to_m * 1e3:.1f}",
            str(fit.points),
        ]
        for fit in _shears(result)
    ]


def parameter_rows(result: BenchSoil) -> Rows:
    """Return the head and a row for each parameter of the terrain."""
    head = ["parameter", "value", "sigma", "95 % interval", "unit"]
    rows = []
    for parameter in _parameters(result):
        symbol, _, unit, factor = UNITS[parameter.name]
        value, sigma, low, high = (factor * x for x in (parameter.value, parameter.sigma, *parameter.interval95))
        rows.append([symbol, f"{value:.4g}", f"{sigma:.2g}", f"{low:.4g} to {high:.4g}", unit])
    return head, rows


def facts(result: BenchSoil) -> list[tuple[str, str]]:
    """Return what the intervals rest on, as (name, text)."""
    lines = []
    if result.pressure:
        share, exponent = np.sqrt(np.diag(result.pressure.joint.scatter))
        depth = result.pressure.reference_sinkage_m * 1e3
        source = _source(result.pressure.joint)
        text = f"{100 * share:.1f} % of the pressure at {depth:.1f} mm, {exponent:.3f} in n ({source})"
        lines += [("plate scatter", text), ("plate zero", ZEROS[result.window.zero])]
    if result.shear:
        share, modulus = np.sqrt(np.diag(result.shear.joint.scatter))
        text = f"{100 * share:.1f} % of the strength, {100 * modulus:.1f} % of K ({_source(result.shear.joint)})"
        lines.append(("shear scatter", text))
        if result.shear.separate:
            ends = result.shear.joint.interval95[result.shear.joint.names.index("tan_phi")]
            angle, low, high = (degrees(atan(slope)) for slope in (result.shear.joint["tan_phi"], *ends))
            lines.append(("friction angle", f"{angle:.2f} deg, 95 % interval {low:.2f} to {high:.2f}"))
    return lines


def as_json(result: BenchSoil) -> dict[str, Any]:
    """Return everything as plain values, SI units."""
    return {
        "schema": SCHEMA,
        "parameters": _parameters(result),
        "joint": result.joints,
        "plates": _plates(result),
        "shears": _shears(result),
        "reference_sinkage_m": result.pressure.reference_sinkage_m if result.pressure else None,
        "window": result.window,
        "warnings": result.warnings,
    }


def terrain_text(result: BenchSoil, name: str, base: TerrainConfig | None) -> str:
    """Return the text of a terrain.toml, with what it rests on in its head; see `terrain_of` for what it raises."""
    terrain = terrain_of(name, result.pressure, result.shear, base=base)
    head = ["Terrain parameters from bevameter tests, by `wheelsoil soil`."]
    head += [f"{label}: {text}" for label, text in facts(result)]
    head += [f"{row[0]} = {row[1]} {row[4]}".rstrip() + f", 95 % {row[3]}" for row in parameter_rows(result)[1]]
    for rows in (plate_rows, shear_rows):
        names = [line[0] for line in rows(result)[1]]
        head += [f"{rows(result)[0][0]}s: {', '.join(names)}"] if names else []
    head += [f"note: {text}" for text in result.warnings]
    if base is not None:
        head.append("What was not tested is from the base file.")
    return terrain_toml(terrain, head)


@dataclass(frozen=True)
class Parameter:
    """One fitted parameter of the terrain, SI units."""

    name: str
    symbol: str
    unit: str
    value: float
    sigma: float
    interval95: tuple[float, float]


def _parameters(result: BenchSoil) -> list[Parameter]:
    return [
        Parameter(name, UNITS[name][0], UNITS[name][1], float(value), float(sigma), (float(low), float(high)))
        for joint in result.joints
        for name, value, sigma, (low, high) in zip(
            joint.names, joint.values, joint.sigma, joint.interval95, strict=True
        )
    ]


def _source(joint: JointFit) -> str:
    if joint.scatter_source == "assumed":
        return "assumed: no repeats"
    freedom = float(joint.freedom[0])
    return f"{joint.tests} tests, {freedom:.0f} degrees of freedom" if isfinite(freedom) else f"{joint.tests} tests"
