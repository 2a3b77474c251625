"""Options of a simulated campaign, validated at the start; the soil may come from a model file."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from math import degrees, isfinite
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from daq import ConfigError, Fault, SoilSection, TerrainConfig, UncertaintySection, load_toml, nearest
from model import ExtendedModel
from model.effects import EFFECTS, parted
from model.simulation import SHORTEST_RUN_S
from model.wheel_soil import LABORATORY_SPREAD, SOILS, Reading, Soil, Wheel, soil_from_terrain
from wheelsoil.workflows.fit import presets_near
from wheelsoil.workflows.model_files import load_model

LAYOUTS: dict[int, tuple[str, ...]] = {1: ("",), 2: ("FL", "RL"), 4: ("FL", "FR", "RL", "RR")}
"""Instrumented wheels by their number: ids of front and rear, left and right; a single one is the rear left."""
DEFAULT_START = datetime(2026, 5, 4, 8, tzinfo=UTC)
LONGEST_RUN_S = 86_400.0

_OF_THE_SET = (0, 5)
"""Stream of random numbers by which a set of a model file is drawn; see `wheelsoil.simulation.campaign`."""
_OF_THE_MODEL = ("soil", "sinkage", "radius", "width")


@dataclass(frozen=True)
class SimulationOptions:
    """A simulated campaign; the same options give the same frames.

    Attributes
    ----------
    soil : str
        Name of a preset of `model.wheel_soil.soils.SOILS`, or path of a terrain.toml.
    effects : mapping effect -> mapping parameter -> value
        Effects of wheel, soil and sensors beyond Wong's model; see `parse_effect`.
    reading : "balanced" or "literal"
    duration_s : float
        Duration of each run.
    added_load_kg : tuple of float
        Added masses, used in turn; the direction alternates from run to run.
    pass_number : tuple of int
        Number of the pass over the track, used in turn.
    inflation_kpa : tuple of float
        Tyre pressures stated in runs.toml, used in turn; if empty, the usual pressure acts and none is stated.
    wheels : 1, 2 or 4
        Instrumented ones, see `LAYOUTS`; two and more are written as ``[[wheel]]``.
    faulty_wheel : str
        Id of the only one whose sensors the measurement effects are of; empty: those of all.
    draw_soil : bool
        Draw the true soil from the laboratory's uncertainty instead of using the values of terrain.toml.
    wheel_axes : bool
        The transducer sends forces in axes that rotate with the wheel.
    tilt_deg : float, optional
        Of the ground, uphill on "out"; drawn up to `LEVEL_DEG` either way if not given.
    steering_deg : float
        Largest angle of the front wheels in a slalom of ten seconds a period; 0: straight on. See `Steering`.
    brakes : "held" or "released", optional
        At every standstill; drawn if not given, held in `HELD_IN` of the campaigns.
    lifted : bool
        Record the lifted wheel before and after the runs.
    rut : int
        Readings of the rut's depth in runs.toml, of the whole campaign.
    noise : float
        Factor on every sensor's noise and ripple; 0 for ideal sensors.
    transducer_rate_hz : float
        Of each message of the transducers: a divisor of 1000.
    start : datetime
        Time of the first run.
    known_terrain : TerrainConfig, optional
        The soil, if it is neither a preset nor in a terrain.toml; see `with_model`.
    model_file : str
        File of that soil, for the command line that reproduces the frames.
    model_set : str
        Which of the file's sets of causes was drawn; empty where it has none.

    Raises
    ------
    ConfigError
        Lists every error.
    """

    soil: str = "clay"
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    reading: Reading = "balanced"
    runs: int = 6
    duration_s: float = 40.0
    seed: int = 0
    added_load_kg: tuple[float, ...] = (0.0, 300.0, 500.0)
    pass_number: tuple[int, ...] = (1,)
    inflation_kpa: tuple[float, ...] = ()
    wheel: Wheel = field(default_factory=lambda: Wheel(0.47, 0.318))
    wheels: int = 1
    faulty_wheel: str = ""
    draw_soil: bool = False
    wheel_axes: bool = False
    tilt_deg: float | None = None
    steering_deg: float = 0.0
    brakes: Literal["held", "released"] | None = None
    lifted: bool = False
    rut: int = 0
    noise: float = 1.0
    transducer_rate_hz: float = 1000.0
    start: datetime = DEFAULT_START
    known_terrain: TerrainConfig | None = None
    model_file: str = ""
    model_set: str = ""

    def __post_init__(self) -> None:
        faults = [
            Fault(f"{name} is out of range", found=f"{value:g}", expected=expected)
            for name, value, good, expected in self._bounds()
            if not (isfinite(value) and good)
        ]
        if self.reading not in get_args(Reading):
            expected = " or ".join(get_args(Reading))
            faults.append(Fault("unknown reading of the sinkage laws", found=self.reading, expected=expected))
        if not self.added_load_kg:
            faults.append(Fault("no added load is given", next_step="give at least one, e.g. 0"))
        if not self.pass_number:
            faults.append(Fault("no pass number is given", next_step="give at least one, e.g. 1"))
        faults += self._faults_of_wheels()
        if self.start.tzinfo is None:
            faults.append(Fault("the start has no time zone", found=str(self.start), next_step="add Z for UTC"))
        for name, values in self.effects.items():
            faults += _effect_faults(name, values, self.reading)
        if faults:
            raise ConfigError(*faults)
        _ = self.laboratory_soil  # raises for an unknown soil

    def _faults_of_wheels(self) -> list[Fault]:
        if self.wheels not in LAYOUTS:
            expected = ", ".join(map(str, LAYOUTS))
            return [Fault("number of instrumented wheels is out of range", found=str(self.wheels), expected=expected)]
        expected = ", ".join(filter(None, LAYOUTS[self.wheels])) or "none: there is one wheel"
        wheels = {name: parted(name)[1] for name in self.effects} | {"--faulty-wheel": self.faulty_wheel}
        known = ("", *LAYOUTS[self.wheels])
        faults = [
            Fault(f"no wheel is called {wheel!r}", name, expected=expected)
            for name, wheel in wheels.items()
            if wheel not in known
        ]
        measured = [
            EFFECTS[name]
            for name, wheel in wheels.items()
            if name in EFFECTS and EFFECTS[name].kind == "measurement" and wheel in ("", self.faulty_wheel)
        ]
        if self.faulty_wheel and (shared := [effect.key() for effect in measured if not effect.goes_with_a_wheel()]):
            what = f"{' and '.join(shared)} of one wheel only: all have one receiver and one body"
            faults.append(Fault(what, next_step="omit --faulty-wheel: it is an error at all of them"))
        if self.faulty_wheel and not measured:
            step = "add one, for instance --effect torque_gain:relative=0.1"
            faults.append(Fault(f"no error of measurement is given for wheel {self.faulty_wheel}", next_step=step))
        alone = [name for name, given in (("--rut", self.rut), ("--lifted", self.lifted)) if given]
        if self.wheels > 1 and alone:
            step = f"omit {' and '.join(alone)}, or simulate one wheel"
            faults.append(
                Fault(
                    f"{' and '.join(alone)}: simulated of one wheel only", found=f"{self.wheels} wheels", next_step=step
                )
            )
        return faults

    def _bounds(self) -> list[tuple[str, float, bool, str]]:
        loads = [("added load", load, -1000 <= load <= 20_000, "-1000 to 20000 kg") for load in self.added_load_kg]
        passes = [("pass number", number, 1 <= number <= 1000, "1 to 1000") for number in self.pass_number]
        pressures = [("inflation", p, 10 <= p <= 2000, "10 to 2000 kPa") for p in self.inflation_kpa]
        rate = self.transducer_rate_hz
        return [
            ("number of runs", self.runs, 1 <= self.runs <= 1000, "1 to 1000"),
            (
                "duration",
                self.duration_s,
                SHORTEST_RUN_S <= self.duration_s <= LONGEST_RUN_S,
                f"{SHORTEST_RUN_S:g} to {LONGEST_RUN_S:g} s",
            ),
            ("seed", self.seed, self.seed >= 0, "0 or more"),
            ("number of rut readings", self.rut, 0 <= self.rut <= 1000, "0 to 1000"),
            ("tilt", self.tilt_deg or 0.0, abs(self.tilt_deg or 0.0) <= 20, "-20 to 20 deg"),
            ("steering", self.steering_deg, 0 <= self.steering_deg <= 20, "0 to 20 deg"),
            ("noise", self.noise, 0 <= self.noise <= 10, "0 to 10"),
            (
                "transducer rate",
                rate,
                50 <= rate <= 1000 and 1000 % rate == 0,
                "1000 Hz by a whole number, at least 50",
            ),
            ("wheel radius", self.wheel.radius_m, 0.02 <= self.wheel.radius_m <= 3, "0.02 to 3 m"),
            ("wheel width", self.wheel.width_m, 0.01 <= self.wheel.width_m <= 3, "0.01 to 3 m"),
            *loads,
            *passes,
            *pressures,
        ]

    @cached_property
    def _terrain(self) -> TerrainConfig | None:
        if self.known_terrain is not None:
            return self.known_terrain
        if self.soil in SOILS:
            return None
        if not self.soil.endswith(".toml"):
            raise ConfigError.of(
                f"no soil is called {self.soil!r}",
                expected=presets_near(self.soil),
                next_step="choose one of these, or give the path of a terrain.toml",
            )
        return load_toml(Path(self.soil), TerrainConfig)

    @cached_property
    def laboratory_soil(self) -> Soil:
        """The soil as terrain.toml states it."""
        return soil_from_terrain(self._terrain) if self._terrain else SOILS[self.soil]

    @cached_property
    def terrain(self) -> TerrainConfig:
        """Content of terrain.toml: the laboratory's soil and its uncertainty."""
        return self._terrain or terrain_config(self.laboratory_soil, LABORATORY_SPREAD)

    @property
    def command(self) -> str:
        """The command line that reproduces the frames, without the output folder."""
        default = SimulationOptions()
        own_wheel = self.wheel != default.wheel and not self.model_file
        words = [
            *("wheelsoil", "simulate", *(("--model", self.model_file) if self.model_file else ("--soil", self.soil))),
            *("--runs", str(self.runs), "--duration", f"{self.duration_s:g}", "--seed", str(self.seed)),
            *([] if self.model_file else ["--sinkage", self.reading]),
        ]
        for name, values in self.effects.items():
            words += ["--effect", f"{name}:" + ",".join(f"{key}={value!r}" for key, value in values.items())]
        loads = self.added_load_kg if self.added_load_kg != default.added_load_kg else ()
        passes = self.pass_number if self.pass_number != default.pass_number else ()
        words += [
            *(word for load in loads for word in ("--added-load", f"{load!r}")),
            *(word for number in passes for word in ("--pass-number", f"{number}")),
            *(word for pressure in self.inflation_kpa for word in ("--inflation", f"{pressure!r}")),
            *(["--radius", f"{self.wheel.radius_m!r}", "--width", f"{self.wheel.width_m!r}"] if own_wheel else []),
            *(["--wheels", f"{self.wheels}"] if self.wheels > 1 else []),
            *(["--faulty-wheel", self.faulty_wheel] if self.faulty_wheel else []),
            *["--draw-soil"] * self.draw_soil,
            *["--wheel-axes"] * self.wheel_axes,
            *([] if self.tilt_deg is None else ["--tilt", f"{self.tilt_deg:g}"]),
            *(["--steering", f"{self.steering_deg!r}"] if self.steering_deg else []),
            *([] if self.brakes is None else ["--brakes", self.brakes]),
            *["--lifted"] * self.lifted,
            *(["--rut", f"{self.rut}"] if self.rut else []),
            *([] if self.noise == default.noise else ["--noise", f"{self.noise!r}"]),
            *([] if self.transducer_rate_hz == 1000 else ["--transducer-rate", f"{self.transducer_rate_hz:g}"]),
            *([] if self.start == default.start else ["--start", self.start.isoformat()]),
        ]
        return shlex.join(words)


def parse_effect(text: str) -> tuple[str, dict[str, float]]:
    """Parse ``"name:parameter=value,..."``; a name alone gives every parameter its start value.

    If only some parameters are given, the others are neutral.

    Raises
    ------
    ConfigError
        There is no such effect, or the text has another form.
    """
    name, _, rest = text.partition(":")
    effect = EFFECTS.get(name)
    if effect is None:
        raise ConfigError(_unknown_effect(name))
    if not rest:
        return name, {p.name: p.start for p in effect.parameters}
    values: dict[str, float] = {p.name: p.neutral for p in effect.parameters}
    for part in rest.split(","):
        key, _, number = part.partition("=")
        try:
            values[key.strip()] = float(number)
        except ValueError:
            example = ",".join(f"{p.name}={p.start:g}" for p in effect.parameters)
            raise ConfigError.of(
                "an effect's parameters cannot be read", found=text, expected=f"{name}:{example}"
            ) from None
    return name, values


def _unknown_effect(name: str) -> Fault:
    forms = ", ".join(key for key, form in EFFECTS.items() if form.name == name)
    expected = f"a form of that family: {forms}" if forms else nearest(name, EFFECTS, most=len(EFFECTS))
    return Fault(f"no effect is called {name!r}", expected=expected)


def _effect_faults(name: str, values: Mapping[str, float], reading: Reading) -> list[Fault]:
    effect = EFFECTS.get(name)
    if effect is None:
        return [_unknown_effect(name)]
    known = {p.name: p for p in effect.parameters}
    faults = []
    if effect.reading == "literal" != reading:
        what = f"effect {name} is defined for --sinkage literal only"
        faults.append(Fault(what, found=reading, next_step="add --sinkage literal, or omit the effect"))
    faults += [
        Fault(f"effect {name} has no parameter {key!r}", expected=nearest(key, known))
        for key in values
        if key not in known
    ]
    faults += [Fault(f"effect {name} lacks its parameter {key!r}") for key in known if key not in values]
    return faults + [
        Fault(
            f"{name}: {key} is out of its bounds",
            found=f"{value:g}",
            expected=f"{known[key].lower:g} to {known[key].upper:g} {known[key].unit}",
        )
        for key, value in values.items()
        if key in known and not known[key].lower <= value <= known[key].upper
    ]


def with_model(
    options: SimulationOptions, path: Path, given: Collection[str], faulty_wheel: str = ""
) -> SimulationOptions:
    """Return the options with soil, wheel, reading and effects of a model file; given effects override those.

    Of a file with several sets of causes one is drawn by its probability, with the options' seed. Of a file of one of
    several wheels the errors of its transducer are at that wheel, where several are simulated. `given` are the options
    of the command line; `faulty_wheel` is that of `SimulationOptions`.

    `ConfigError` where the file is invalid, or a given option contradicts it.
    """
    clashes = [name for name in _OF_THE_MODEL if name in given]
    if clashes:
        raise ConfigError.of(
            "the model file defines soil, wheel and --sinkage",
            path,
            found=", ".join(f"--{name}" for name in clashes),
            next_step="omit these options, or edit the file",
        )
    model = load_model(path).drawn(np.random.default_rng(np.random.SeedSequence(options.seed, spawn_key=_OF_THE_SET)))
    wheels = next((count for count, ids in LAYOUTS.items() if {*ids} == {*model.wheels}), options.wheels)
    ids = LAYOUTS[options.wheels if "wheels" in given else wheels]
    own = model.wheel_id if len(ids) > 1 else ""
    other = {*ids} != {*model.wheels} or len({size for size, _ in model.wheels.values()}) > 1
    if other if model.wheels else own and own not in ids:
        raise ConfigError.of(
            "the model file is of a vehicle that is not simulated",
            path,
            ", ".join(f"{name} {size.radius_m:g} x {size.width_m:g} m" for name, (size, _) in model.wheels.items())
            or f"wheel {own}",
            " or ".join(", ".join(ids) for ids in LAYOUTS.values() if all(ids)) + ", of one size",
            "omit --wheels, or take the model of one wheel: `wheelsoil diagnose FOLDER --wheel ID -o FILE`",
        )
    sensors = [key for key, each in EFFECTS.items() if each.kind == "measurement" and each.goes_with_a_wheel()]
    effects = {
        f"{effect.key}@{own}" if own and effect.key in sensors else effect.key: {
            p.name: p.value for p in effect.parameters
        }
        for effect in model.effects
        if effect.key not in options.effects
    }
    return replace(
        options,
        faulty_wheel=faulty_wheel,
        model_set=str(model.provenance.get("set", "")),
        soil=model.soil.name,
        known_terrain=terrain_of(model),
        model_file=str(path),
        reading=model.reading,
        wheel=model.wheel,
        wheels=wheels,
        effects={**effects, **options.effects},
    )


def terrain_of(model: ExtendedModel) -> TerrainConfig:
    """Return the terrain.toml of the model's soil; a sigma missing in the file is the usual laboratory spread."""
    spread = {
        name: _relative(model.soil_sigmas.get(name), float(getattr(model.soil, name)), usual)
        for name, usual in LABORATORY_SPREAD.items()
    }
    return terrain_config(model.soil, spread)


def _relative(sigma: float | None, value: float, usual: float) -> float:
    relative = abs(sigma / value) if sigma is not None and value else usual
    return relative if isfinite(relative) else usual


def terrain_config(soil: Soil, spread: Mapping[str, float]) -> TerrainConfig:
    """Return terrain.toml: the laboratory's values and their uncertainty.

    `spread` is the relative one-sigma per parameter, as `model.wheel_soil.LABORATORY_SPREAD`; zero: unknown.
    """
    return TerrainConfig(
        soil=SoilSection(
            name=soil.name,
            cohesion_kpa=_rounded(soil.cohesion_pa / 1e3),
            friction_angle_deg=_rounded(degrees(soil.friction_angle_rad)),
            shear_modulus_m=_rounded(soil.shear_modulus_m),
            sinkage_exponent=_rounded(soil.sinkage_exponent),
            cohesive_modulus_kn=_rounded(soil.cohesive_modulus / 1e3),
            frictional_modulus_kn=_rounded(soil.frictional_modulus / 1e3),
            unit_weight_kn_m3=_rounded(soil.unit_weight_n_m3 / 1e3),
        ),
        uncertainty=UncertaintySection(
            cohesion_kpa=spread["cohesion_pa"] or None,
            friction_angle_deg=spread["tan_phi"] or None,
            shear_modulus_m=spread["shear_modulus_m"] or None,
            sinkage_exponent=spread["sinkage_exponent"] or None,
            cohesive_modulus_kn=spread["cohesive_modulus"] or None,
            frictional_modulus_kn=spread["frictional_modulus"] or None,
        ),
    )


def _rounded(value: float) -> float:
    """Round to 12 digits, which removes the rounding errors of unit conversion."""
    return float(f"{value:.12g}")
