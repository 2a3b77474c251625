"""A bench table with the files that it needs beside it, read with all faults at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from daq.bench_tables import WheelTable, read_wheel_table
from daq.config import TerrainConfig, VehicleConfig, WheelSection, load_toml
from daq.errors import ConfigError, Fault
from daq.open import Collected
from daq.table_options import parse_rename, parse_where
from model.soils import Soil
from model.wheel import Wheel
from wheelsoil.fitting import known_soil, load_terrain, wheel_of


@dataclass(frozen=True)
class BenchFiles:
    """The rows, the wheel that made them and the soil; `terrain` is None where only a preset was given."""

    rows: WheelTable
    wheel: Wheel
    wheel_section: WheelSection
    soil: Soil
    terrain: TerrainConfig | None


def read_bench(
    path: Path,
    *,
    vehicle: Path | None,
    terrain: Path | None = None,
    soil: str | None = None,
    rename: Iterable[str] | None = None,
    where: Iterable[str] | None = None,
) -> BenchFiles:
    """Read a bench table and its files.

    Parameters
    ----------
    path : Path
        The table.
    vehicle : Path, optional
        A file with ``[wheel]``; it is an error to give none.
    terrain : Path, optional
    soil : str, optional
        A preset instead of it.
    rename, where : iterable of str, optional
        See `daq.table_options`.

    Raises
    ------
    ConfigError, DataError
        Everything that is wrong with any of them.
    """
    if vehicle is None:
        raise ConfigError(
            Fault("the wheel is not known", next_step="give --vehicle FILE with [wheel] radius_m and width_m")
        )
    collected = Collected()
    with collected.catch():
        described = load_toml(vehicle, VehicleConfig)
        wheel = wheel_of(described, str(vehicle))
    with collected.catch():
        lab = load_terrain(terrain)
        ground = known_soil(soil, lab)
    with collected.catch():
        rows = read_wheel_table(path, rename=parse_rename(rename or ()), where=parse_where(where or ()))
    collected.stop_if_any()
    assert described.wheel is not None
    return BenchFiles(rows, wheel, described.wheel, ground, lab)
