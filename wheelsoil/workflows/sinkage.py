"""From processed runs, or a bench table, to the sinkage that forces alone give: what `sinkage` and the report share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq import ConfigError, DataError, Fault, FloatArray, WheelSection
from daq.runs import Run
from daq.series import WheelTable
from model.diagnosis import BoundRows, Inconsistent, bound_rows_of_runs, bound_rows_of_table, inconsistent
from model.sinkage_from_forces import (
    LEAST_SLIP,
    WITHOUT_FORCES,
    Agreement,
    ForceCells,
    Growth,
    ShapeRanges,
    SlipBin,
    agreement_of,
    cells_of_runs,
    cells_of_table,
    sinkage_from_forces,
)
from processing import REBOUND_SIGMA_M, ProcessedRun
from wheelsoil.cache.store import kept
from wheelsoil.wording.notes import note_text

SCHEMA = "wheelsoil/sinkage/1"
_SEED = 0

IN_THE_BAND = (
    "the 95 % band holds: noise of load, drawbar pull and torque, their zeros' uncertainty where one was taken off, "
    "the radius (1 %), where the stress peaks (ahead, as Wong and Reece measured, or at the bottom), the sinkage "
    "exponent (0.5 to 1.4), an exit behind the bottom (none, or up to a fifth of the entry angle at no slip, and up to "
    "0.8 of it more at full slip), soil pushed in front (none, or up to two fifths of the resistance), 20 % for what "
    "else differs from wheel to wheel, and how deep wheels usually are. It does not hold a tyre that flattens, or a "
    "gain of the transducer. On measured wheels it is a range, not a proven 95 %: few tests have torque and sinkage "
    "(docs/sinkage.md)"
)


@dataclass(frozen=True)
class SinkageFacts:
    """The sinkage of one wheel from its forces.

    Attributes
    ----------
    source : str
        Of the table, or the runs' names.
    checked : int
        Rows that the bound was checked on: driven, with measured sinkage.
    agreement : Agreement, optional
        With the measured sinkage, where there is any.
    """

    source: str
    radius_m: float
    bins: list[SlipBin]
    growth: Growth
    checked: int
    inconsistent: tuple[Inconsistent, ...]
    notes: tuple[str, ...]
    agreement: Agreement | None = None

    @property
    def withdrawn(self) -> bool:
        """Whether the measured sinkage contradicts, so that forces give no number here."""
        return self.agreement is not None and self.agreement.refuted

    def number_m(self, slip_bin: SlipBin) -> float | None:
        """Return the sinkage of a range of slip; None where forces say no more than is known without them."""
        return slip_bin.sinkage_m.value if slip_bin.tells and not self.withdrawn else None


def sinkage_of_runs(processed: Sequence[tuple[Run, ProcessedRun]]) -> SinkageFacts:
    """Return the sinkage of runs of one wheel.

    Raises
    ------
    ConfigError
        The runs are of different wheels.
    DataError
        No run is driven for long enough.
    """
    first, *others = [run for run, _ in processed]
    strangers = [run.id for run in others if run.vehicle.wheel != first.vehicle.wheel]
    if strangers:
        raise ConfigError.of(
            "the runs are of different wheels",
            found=f"{', '.join(strangers)} differ from {first.id}",
            next_step="take each wheel by itself, or give --vehicle for all",
        )
    return facts_of_runs([run for _, run in processed], first.vehicle.wheel)


def facts_of_runs(runs: Sequence[ProcessedRun], wheel: WheelSection | None) -> SinkageFacts:
    """Return the sinkage of processed runs of one wheel that carry a torque.

    `DataError` where no run is driven for long enough.
    """
    cells = cells_of_runs(runs, _lug_height(wheel))
    if not len(cells):
        raise DataError(_not_driven(runs))
    notes = _lugs(wheel)
    zeroless = [run.run.id for run in runs if not {"drawbar_pull", "driving_torque"} <= run.quality.zeros.keys()]
    if zeroless:
        notes = (*notes, "the zeros of drawbar pull and torque were taken as they are: no zero file says how sure")
    rows = bound_rows_of_runs(runs, lugged=_lugged(wheel))
    # The one-sigma of a rut reading as sinkage, the worst of all; None where there is none.
    sigmas = [reading.sigma_m for run in runs for reading in run.run.rut]
    rut_sigma = float(np.hypot(max(sigmas), REBOUND_SIGMA_M)) if sigmas else None
    return _facts(", ".join(cells.names), cells, rows, notes, rut_sigma)


def sinkage_of_table(table: WheelTable, wheel: WheelSection) -> SinkageFacts:
    """Return the sinkage of every driven row of a bench table.

    Raises
    ------
    DataError
        The table has no torque, or no driven row.
    """
    faults = []
    if not np.isfinite(table.driving_torque_nm).any():
        faults.append(
            Fault(
                "the table has no torque, which the sinkage from forces needs",
                table.name,
                expected="a column driving_torque_nm",
                next_step="take a foreign column under that name: --rename driving_torque_nm=NAME",
            )
        )
    if not (table.slip > 0).any():
        faults.append(
            Fault(
                "no row is driven",
                table.name,
                found="no slip above 0",
                expected="slips from 0 to 1",
                next_step="check the column slip and its sign",
            )
        )
    if faults:
        raise DataError(*faults)
    cells = cells_of_table(table, wheel.radius_m, _lug_height(wheel))
    notes = _lugs(wheel)
    if not table.sigma:
        notes = (*notes, "the table states no sigma: noise is not in the band")
    excluded = len(table) - len(cells)
    if excluded:
        notes = (*notes, f"{len(cells)} of {len(table)} rows used: {excluded} are not driven or have no torque")
    rows = bound_rows_of_table(table, wheel.radius_m, lugged=_lugged(wheel), lug_height_m=wheel.lug_height_m or None)
    return _facts(table.name, cells, rows, notes, _sinkage_sigma(table, cells))


def _sinkage_sigma(table: WheelTable, cells: ForceCells) -> FloatArray | None:
    """Return the one-sigma of the measured sinkage of every cell, by slip; None where the table states none."""
    if "sinkage_m" not in table.sigma:
        return None
    order = np.argsort(cells.forces.slip, kind="stable")
    return np.asarray(table.sigma["sinkage_m"][cells.bin][order])


def _facts(
    source: str,
    cells: ForceCells,
    rows: BoundRows,
    notes: tuple[str, ...],
    measured_sigma_m: FloatArray | float | None = None,
) -> SinkageFacts:
    def compute() -> tuple[list[SlipBin], Growth]:
        found = sinkage_from_forces(cells, np.random.default_rng(_SEED))
        return found.bins(), found.growth()

    bins, growth = kept("sinkage", (cells, _SEED), compute)
    sigma_m = None if measured_sigma_m is None else np.broadcast_to(measured_sigma_m, len(bins))
    agreement = agreement_of(bins, sigma_m)
    return SinkageFacts(source, cells.radius_m, bins, growth, len(rows), inconsistent(rows), notes, agreement)


def _lug_height(wheel: WheelSection | None) -> float:
    return (wheel.lug_height_m or 0.0) if wheel is not None else 0.0


def _lugged(wheel: WheelSection | None) -> bool:
    return wheel is not None and wheel.tread == "lugged"


def _lugs(wheel: WheelSection | None) -> tuple[str, ...]:
    if not _lugged(wheel):
        return ()
    if _lug_height(wheel):
        return ("torque acts at the radius and a part of the height of the lugs: the band holds none to all of it",)
    return ("the tyre has lugs: torque acts beyond the radius, so that the sinkage comes out somewhat too large",)


def _not_driven(runs: Sequence[ProcessedRun]) -> Fault:
    slips = np.concatenate([run.slip[run.used] for run in runs])
    return Fault(
        "nowhere is the wheel driven for a second with a torque",
        ", ".join(run.run.id or "run" for run in runs),
        f"slips {np.min(slips):.2f} to {np.max(slips):.2f}" if len(slips) else "no usable sample",
        f"slips above {LEAST_SLIP:g}",
        "record a run that accelerates; `wheelsoil process RUN` says why samples are excluded",
    )


def agreement_sentence(found: Agreement) -> str:
    """Say how the sinkage from forces compares with the measured one."""
    outside = found.rows - found.inside
    within = f"in the band in {found.inside} of {found.rows} rows"
    text = f"measured sinkage: rms {1e3 * found.rms_m:.3g} mm from the median, {within}"
    if not outside:
        return text
    slips = ", ".join(f"{slip:.2f}" for slip in found.outside_slips)
    text += f", outside in {outside} of {found.rows} (slips {slips})"
    if not found.refuted:
        return text
    return (
        f"{text}: more than chance allows, so that the model behind the band does not hold here. Do not rely on "
        "sinkage from forces for this wheel and soil; take the measured one"
    )


def growth_sentence(growth: Growth) -> str:
    """Say how the sinkage grows with slip."""
    if growth.reason:
        return f"growth of sinkage with slip: {note_text(growth.reason)}"
    if growth.contradicted:
        least, most = (_signed(end) for end in growth.measured.interval95)
        return (
            f"the measured sinkage grows by {_signed(growth.measured.value)} mm ({least} to {most}) from no slip to "
            "full slip, which contradicts the forces: what they say of its growth is withdrawn"
        )
    low, high = growth.from_forces.interval95
    if low <= 0 <= high:
        return "over all shapes of the stress, the sinkage may grow with slip or not"
    trend, sign = ("grows", 1.0) if low > 0 else ("falls", -1.0)
    open_ones = [
        name
        for name, found in (
            ("stays at the bottom", growth.if_peak_stays),
            ("moves forward with slip", growth.if_peak_moves),
        )
        if min(sign * end for end in found.interval95) <= 0
    ]
    need = f", but if its peak {' or '.join(open_ones)} it need not" if open_ones else ""
    return f"over all shapes of the stress, the sinkage {trend} with slip{need}"


def unknown_sentence(facts: SinkageFacts) -> str:
    """Say in which rows forces give no number, why, and what would; empty where they do in all."""
    if facts.withdrawn:
        return "no number is given: the measured sinkage contradicts those from forces"
    without = [slip_bin.slip for slip_bin in facts.bins if not slip_bin.tells]
    if not without:
        return ""
    low, high = (share * facts.radius_m for share in WITHOUT_FORCES)
    slips = ", ".join(f"{slip:.2f}" for slip in without)
    known = f"{1e3 * low:.3g} to {1e3 * high:.3g} mm"
    return (
        f"not identifiable in {len(without)} of {len(facts.bins)} rows (slips {slips}): the band is as wide as what is "
        f"known of wheels without their forces ({known}). Next: measure the depth of the rut at these slips"
    )


def growth_rows(growth: Growth) -> list[tuple[str, str, str]]:
    """Return what is assumed, the growth from no slip to full slip in mm, and its interval, where it is known."""
    named = (
        ("over all shapes of the stress", growth.from_forces),
        ("if the stress peaks at the bottom", growth.if_peak_stays),
        ("if its peak moves forward with slip", growth.if_peak_moves),
        ("measured", growth.measured),
    )[3 if growth.contradicted else 0 :]
    return [
        (what, _signed(found.value), " .. ".join(map(_signed, found.interval95)))
        for what, found in named
        if np.isfinite(found.value)
    ]


def _signed(metres: float) -> str:
    return f"{1e3 * metres:+.3g}"


def sinkage_as_json(facts: SinkageFacts) -> dict[str, Any]:
    """Return the facts as plain values for programs; the contract is `SCHEMA`."""
    growth = facts.growth
    return {
        "schema": SCHEMA,
        "source": facts.source,
        "wheel": {"radius_m": facts.radius_m},
        "bins": [
            {
                "slip": slip_bin.slip,
                "vertical_load_n": slip_bin.vertical_load_n,
                "samples": slip_bin.samples,
                "sinkage_m": facts.number_m(slip_bin),
                "interval95_m": None if facts.withdrawn else slip_bin.sinkage_m.interval95,
                "if_peak_stays_m": None if facts.withdrawn else slip_bin.if_peak_stays_m,
                "if_peak_moves_m": None if facts.withdrawn else slip_bin.if_peak_moves_m,
                "noise_sigma_m": slip_bin.noise_m,
                "measured_m": slip_bin.measured_m,
            }
            for slip_bin in facts.bins
        ],
        "growth": {
            "unit": "m from no slip to full slip",
            **{
                name: {"value": estimate.value, "interval95": estimate.interval95}
                if name == "measured" or not growth.contradicted
                else None
                for name, estimate in (
                    ("from_forces", growth.from_forces),
                    ("if_peak_stays", growth.if_peak_stays),
                    ("if_peak_moves", growth.if_peak_moves),
                    ("measured", growth.measured),
                )
            },
            "reason": note_text(growth.reason) if growth.reason else "",
            "withdrawn": growth.contradicted,
        },
        "withdrawn": facts.withdrawn,
        "no_number": unknown_sentence(facts),
        "agreement": None if facts.agreement is None else vars(facts.agreement),
        "bound": {"rows": facts.checked, "inconsistent": list(facts.inconsistent)},
        "band": vars(ShapeRanges()),
        "notes": facts.notes,
    }
