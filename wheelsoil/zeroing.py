"""Recordings of a lifted wheel to zero.toml, and zero.toml to the runs that it is taken off."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from math import isfinite
from pathlib import Path

import numpy as np

from daq.errors import ConfigError, Fault
from daq.open import Collected, open_runs
from daq.run import Run
from daq.units import Quantity, find_unit
from daq.zero_file import ZERO_FILE, ChannelZero, Determination, ZeroConfig, load_zeros, parse_zeros, zeros_toml
from processing.timebase import FloatArray
from processing.transducer_zero import Drift, Lifted, RunZeros, WeightCheck, check_weight, determine, drift_between
from wheelsoil.facts import sha256_of
from wheelsoil.transducer_signals import TransducerData, first_temperature_degc, transducer_data

_NOTABLE_RISE_K = 2.0


@dataclass(frozen=True)
class Found:
    """One determination, as `wheelsoil zero` tells it.

    Attributes
    ----------
    run : Run
    determination : Determination
    check : WeightCheck or None
    outliers : mapping str -> int
        Samples of each channel that did not count.
    remarks : tuple of str
    """

    run: Run
    determination: Determination
    check: WeightCheck | None
    outliers: dict[str, int]
    remarks: tuple[str, ...]


def find_zeros(
    paths: Sequence[Path],
    *,
    vehicle: Path | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    on_ground: bool = False,
    lenient_dbc: bool = False,
) -> list[Found]:
    """Determine the zero from each recording, in order of time.

    Raises
    ------
    WheelsoilError
        What is wrong with any of the recordings, of all of them at once.
    """
    collected = Collected()
    found = []
    for run in open_runs(paths, vehicle=vehicle, lenient_dbc=lenient_dbc):
        with collected.catch(str(run.path)):
            found.append(_find(run, from_s, to_s, on_ground=on_ground))
    collected.stop_if_any()
    return sorted(found, key=lambda one: one.determination.time_utc)


def _find(run: Run, from_s: float | None, to_s: float | None, *, on_ground: bool) -> Found:
    data = transducer_data(run, from_s=from_s, to_s=to_s)
    lifted = determine(data.signals, data.angle, data.speed, run.vehicle, on_ground=on_ground)
    one = _determination(run, data, lifted, on_ground=on_ground)
    forces = {
        signal.role: (one.channels[signal.name], signal.si_factor)
        for signal in data.signals
        if signal.role in ("drawbar_pull", "vertical_load") and signal.name in one.channels
    }
    check = check_weight(forces, run.vehicle)
    remarks = [*lifted.remarks, *(check.remarks if check else ())]
    if data.distrusted:
        remarks.append(f"{data.distrusted:,} samples left out because the transducer's status is not 0")
    remarks += _warming(data, lifted)
    return Found(run, one, check, lifted.outliers, tuple(remarks))


def _determination(run: Run, data: TransducerData, lifted: Lifted, *, on_ground: bool) -> Determination:
    part, transducer = lifted.part, run.vehicle.transducer
    middle_us = (data.start_ns + round((part.start_s + part.stop_s) / 2 * 1e9)) // 1000
    warm = _temperatures(data, lifted)
    return Determination(
        time_utc=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=middle_us),
        recording=run.path.name,
        sha256=sha256_of(*run.files),
        method=part.method,
        frame=transducer.frame,
        on_ground=on_ground,
        start_s=max(round(part.start_s, 3), 0.0),
        duration_s=round(part.stop_s - part.start_s, 3),
        revolutions=part.revolutions,
        speed_radps=round(part.mean_speed_radps, 4) if part.method == "spin" else None,
        angle_deg=round(float(np.degrees(part.angle_rad)) % 360, 2) if isfinite(part.angle_rad) else None,
        angle_offset_deg=transducer.angle_offset_deg,
        angle_direction=transducer.angle_direction,
        temperature_degc=round(float(np.median(warm)), 1) if len(warm) else None,
        channels={name: _rounded(zero) for name, zero in lifted.channels.items()},
    )


def _rounded(zero: ChannelZero) -> ChannelZero:
    """Take out digits that mean nothing."""
    numbers = {key: value for key, value in zero.model_dump(exclude_none=True).items() if key != "unit"}
    return zero.model_copy(update={key: float(f"{value:.7g}") for key, value in numbers.items()})


def _temperatures(data: TransducerData, lifted: Lifted) -> FloatArray:
    if data.temperature_degc is None:
        return np.zeros(0)
    time_s, values = data.temperature_degc
    return values[(time_s >= lifted.part.start_s) & (time_s < lifted.part.stop_s)]


def _warming(data: TransducerData, lifted: Lifted) -> list[str]:
    warm = _temperatures(data, lifted)
    if not len(warm) or not np.ptp(warm) > _NOTABLE_RISE_K:
        return []
    return [f"the transducer went from {warm[0]:.0f} to {warm[-1]:.0f} degC meanwhile: let it warm up first"]


def drifts(found: Sequence[Found]) -> tuple[list[Drift], list[str]]:
    """Return the drift from each determination to the next, and what cannot be compared."""
    rows: list[Drift] = []
    remarks: list[str] = []
    for before, after in pairwise(found):
        changes, doubts = drift_between(before.determination, after.determination)
        rows += changes
        remarks += doubts
    return rows, remarks


def all_compared(found: Sequence[Found]) -> bool:
    """Return whether there is a drift to tell from each determination to the next; False of a single one."""
    pairs = list(pairwise(found))
    return bool(pairs) and all(drift_between(one.determination, next_.determination)[0] for one, next_ in pairs)


def too_far(rows: Sequence[Drift], most: Mapping[Quantity, float]) -> list[Drift]:
    """Return the drifts that exceed what is allowed, in N and Nm."""
    out = []
    for row in rows:
        unit = find_unit(row.unit, tuple(most))
        if unit is not None and abs(row.change) * unit.factor > most[unit.quantity]:
            out.append(row)
    return out


def zero_path(run: Run, vehicle: Path | None, output: Path | None) -> Path:
    """Return the file that a determination goes to: beside vehicle.toml, under the name it gives."""
    if output is not None:
        return output
    folder = vehicle.parent if vehicle else run.path.parent
    return folder / (run.vehicle.transducer.zero_file or ZERO_FILE)


def check_place(path: Path) -> ZeroConfig:
    """Return what a zero file holds already; nothing where it is not there yet.

    Raises
    ------
    ConfigError
        It is wrong, is a folder, or its folder does not exist.
    """
    if path.is_dir():
        raise ConfigError(Fault("the output is a folder", str(path), next_step="name a file in it"))
    if not path.parent.is_dir():
        raise ConfigError(Fault("no such folder", str(path.parent), next_step="create it or choose another output"))
    return load_zeros(path) if path.exists() else ZeroConfig()


def append(path: Path, found: Sequence[Found]) -> ZeroConfig:
    """Add determinations to a zero file, in order of time; the file is replaced in one step.

    Raises
    ------
    ConfigError
        See `check_place`.
    """
    zeros = check_place(path).plus(*(one.determination for one in found))
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    draft.write_bytes(zeros_toml(zeros))
    draft.replace(path)
    return zeros


def zeros_for(run: Run, given: Path | None = None) -> RunZeros:
    """Return the determinations that a run is to be zeroed with.

    Parameters
    ----------
    run : Run
    given : Path, optional
        A zero file in place of the one that vehicle.toml names.

    Raises
    ------
    ConfigError
        It is wrong, or vehicle.toml names one that neither the recording carries nor lies beside it.
    """
    name = run.vehicle.transducer.zero_file
    attached = {**(run.recording.attachments if run.recording else {}), **run.attachments}
    if given is not None:
        zeros, source = load_zeros(given), str(given)
    elif not name:
        return RunZeros()
    elif name in attached:
        zeros, source = parse_zeros(attached[name], f"{run.path}: {name}"), name
    else:
        raise ConfigError(
            Fault(
                f"no {name!r} lies beside vehicle.toml, which names it as its zero file, and the run carries none",
                run.vehicle_source,
                next_step="determine it (wheelsoil zero), give --zero FILE, or take zero_file out of [transducer]",
            )
        )
    return RunZeros(zeros.zero, source, first_temperature_degc(run) if zeros.zero else None)
