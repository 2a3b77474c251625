"""A model that a diagnosis left, as the truth of a simulated campaign."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from math import isfinite
from pathlib import Path

from daq.config import TerrainConfig
from daq.errors import ConfigError, Fault
from model.extended import ExtendedModel
from model.soils import LABORATORY_SPREAD
from wheelsoil.model_files import load_model
from wheelsoil.virtual_files import terrain_config
from wheelsoil.virtual_options import SimulationOptions

_OF_THE_MODEL = ("soil", "sinkage", "radius", "width")


def with_model(options: SimulationOptions, path: Path, given: Collection[str]) -> SimulationOptions:
    """Return the options with soil, wheel, reading and effects of a model file; effects that were given stay.

    Parameters
    ----------
    options : SimulationOptions
    path : Path
        Of the model file.
    given : collection of str
        Names of the options that were given on the command line.

    Raises
    ------
    ConfigError
        The file is wrong, or an option was given that the file decides.
    """
    clashes = [name for name in _OF_THE_MODEL if name in given]
    if clashes:
        raise ConfigError(
            Fault(
                "the model file says what soil, wheel and reading are",
                str(path),
                found=", ".join(f"--{name}" for name in clashes),
                next_step="leave these out, or edit the file",
            )
        )
    model = load_model(path)
    effects = {effect.key: {p.name: p.value for p in effect.parameters} for effect in model.effects}
    return replace(
        options,
        soil=model.soil.name,
        known_terrain=terrain_of(model),
        model_file=str(path),
        reading=model.reading,
        wheel=model.wheel,
        effects={**effects, **options.effects},
    )


def terrain_of(model: ExtendedModel) -> TerrainConfig:
    """Return what a laboratory would state of the model's soil; where the file has no sigma, the usual spread."""
    spread = {
        name: _relative(model.soil_sigmas.get(name), float(getattr(model.soil, name)), usual)
        for name, usual in LABORATORY_SPREAD.items()
    }
    return terrain_config(model.soil, spread)


def _relative(sigma: float | None, value: float, usual: float) -> float:
    relative = abs(sigma / value) if sigma is not None and value else usual
    return relative if isfinite(relative) else usual
