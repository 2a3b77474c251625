"""Campaigns and single-wheel tables, the options of their diagnosis, and which effects their data can identify."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import pi

from daq import OUTPUTS, Note, StaticTest
from model.effects.base import Effect, Needs
from model.effects.catalogue import EFFECTS, at_wheel
from model.fit.observations import Observations
from model.notes import LackCode
from model.wheel_soil.conditions import Wheel
from model.wheel_soil.soils import Soil, SoilPrior
from model.wheel_soil.wheel_soil_model import Reading
from processing import ProcessedRun

ONE_LOAD = 0.08
"""Spread of loads, over their mean, below which they are one load."""


BLOCK_S = 0.2
"""Length of a sample, where no filter is slow."""


@dataclass(frozen=True)
class OfVehicle:
    """Which of several wheels of one vehicle a campaign is of.

    The wheels have the ground, the receiver and the drives in common.

    Attributes
    ----------
    campaign : str
        Name of what all of them are of: the folder's.
    wheel : str
        Its id.
    block_s : float
        Least length of a sample.
    coasted : int
        Wheels that were tested coasting; they share the receiver and the road.
    """

    campaign: str
    wheel: str
    block_s: float = BLOCK_S
    coasted: int = 1


@dataclass(frozen=True)
class Campaign:
    """Processed runs of one wheel on one terrain.

    Attributes
    ----------
    name : str
        For messages: the folder's.
    soil : Soil
        The laboratory's.
    soil_prior : SoilPrior
        How sure the laboratory is.
    tyre : "smooth", "lugged" or ""
        As vehicle.toml declares it.
    outboard_mass_kg : float
        As vehicle.toml declares it. Its inertia is in the drawbar pull of the runs, by the slope of the measured speed.
    outboard_inertia_kgm2 : float
        The same, in the torque, by the slope of the wheel speed.
    static : tuple of StaticTest
        Readings of the lifted wheel, alone or under known forces.
    of_vehicle : OfVehicle, optional
        Where it is diagnosed together with the vehicle's other wheels.
    commanded_slip : bool
        The slip is a test rig's, in place of one of the speeds.
    """

    name: str
    runs: tuple[ProcessedRun, ...]
    wheel: Wheel
    soil: Soil
    soil_prior: SoilPrior
    tyre: str = ""
    outboard_mass_kg: float = 0.0
    outboard_inertia_kgm2: float = 0.0
    static: tuple[StaticTest, ...] = ()
    of_vehicle: OfVehicle | None = None
    commanded_slip: bool = False

    @property
    def ground(self) -> str:
        """Name of the soil that it is on: wheels of one vehicle are on one."""
        return self.of_vehicle.campaign if self.of_vehicle else self.name


_WEDGE = 3.0**0.5
"""Length of the soil that a lug moves in front of it, in lug heights: Rankine's tan(45 deg + phi/2) at phi = 30 deg."""


@dataclass(frozen=True)
class Lugs:
    """Declared lugs of a wheel.

    Attributes
    ----------
    height_m : float
        From the rim to the tip, above 0.
    count : int
        Around the wheel; 0: not known.
    """

    height_m: float
    count: int = 0

    def sheared_m(self, radius_m: float) -> float:
        """Return by how much the soil should shear outside the rim: all of the height where lugs hold what is between.

        A lug moves a wedge of soil in front of it (Rankine); few lugs leave part of the rim's circumference to itself.
        """
        if not self.count:
            return self.height_m
        held = self.count * _WEDGE * self.height_m / (2.0 * pi * radius_m)
        return self.height_m * min(1.0, held)


@dataclass(frozen=True)
class Bench:
    """Rows of single-wheel tests on one soil, independent of each other.

    Attributes
    ----------
    name : str
        Of the table.
    rows : Observations
        With ``independent`` set; sinkage where it was measured.
    sigmas : mapping channel ("dp", "t", "z") -> one-sigma of a repeat, N, N m, m
        Empty where the table states none: then it is estimated from repeats.
    wheel, soil, soil_prior, tyre
        See `Campaign`.
    lugs : Lugs, optional
        As vehicle.toml or the table declares them.
    lines : tuple of int
        Line of each row in the table's file; empty where they are of no file.
    """

    name: str
    rows: Observations
    wheel: Wheel
    soil: Soil
    soil_prior: SoilPrior
    sigmas: dict[str, float] = field(default_factory=dict)
    tyre: str = ""
    lugs: Lugs | None = None
    lines: tuple[int, ...] = ()

    @property
    def ground(self) -> str:
        """Name of its soil."""
        return self.name


@dataclass(frozen=True)
class DiagnosisOptions:
    """Options of a diagnosis.

    Attributes
    ----------
    reading : "balanced" or "literal"
        Of the simulation under test.
    effects : tuple of str
        Keys of the library to consider.
    channels : of "dp", "t", "z"
        Measured channels to use where they are there.
    most_causes : int
        Largest set of causes that is weighed.
    name_at : float
        Probability from which on a family is named; see `model.diagnosis.core.naming`.
    seed : int
        Of the resampling of runs and of simulated thresholds.
    next_run : bool
        Rank manoeuvres even where the verdict does not ask for it.
    error_of_form : float, optional
        Of single-wheel tables: share of load, load x radius and radius by which a right model may be off.
    average : bool
        Of driven runs: fit the most probable sets for predictions under doubt where the verdict does not decide. It
        takes as long again.
    """

    reading: Reading = "balanced"
    effects: tuple[str, ...] = tuple(EFFECTS)
    channels: tuple[str, ...] = tuple(OUTPUTS)
    most_causes: int = 3
    name_at: float = 0.9
    seed: int = 0
    next_run: bool = False
    error_of_form: float | None = None
    average: bool = False


@dataclass(frozen=True)
class Coverage:
    """What some data hold, as `model.effects.base.Needs` asks for it.

    Attributes
    ----------
    conditions : set of str
        Fields of `Conditions` that are known in every row.
    channels, unused_channels : set of str
        Measured forces ("drawbar_pull", "driving_torque") that are used; that were measured and are not used.
    load_spread : float
        Of the loads, over their mean.
    tyre : "smooth", "lugged" or ""
        As declared.
    lifted : set of str
        Forces that were read of the lifted wheel.
    roles : set of str
        Of channels that no model takes and every run carries.
    commanded_slip : bool
        No error of a speed is in the slip.
    """

    conditions: frozenset[str]
    channels: frozenset[str]
    unused_channels: frozenset[str]
    load_spread: float
    both_directions: bool
    several_passes: bool
    several_runs: bool
    pressures: bool
    standstill: bool
    driven: bool
    braked: bool
    largest_slip: float
    tyre: str
    lifted: frozenset[str] = frozenset()
    roles: frozenset[str] = frozenset()
    commanded_slip: bool = False


_SPEEDS = frozenset(("wheel_speed", "ground_speed"))


def hypotheses_of(coverage: Coverage, keys: Iterable[str], reading: Reading) -> list[type[Effect]]:
    """Return the effects of these keys that are hypotheses about such a vehicle in a reading."""
    effects = [EFFECTS[key] for key in keys if key in EFFECTS]
    return [e for e in effects if e.reading in ("any", reading) and coverage.roles.issuperset(e.needs.roles)]


def considered(
    coverage: Coverage, keys: Sequence[str], reading: Reading, vehicle: OfVehicle | None = None
) -> tuple[type[Effect], ...]:
    """Return the effects of these keys that can be there at all, and whose inputs are known.

    Of one of several wheels also those that may act there alone.
    """
    found = [e for e in hypotheses_of(coverage, keys, reading) if not ruled_out(e, coverage)]
    return (*found, *(at_wheel(e, vehicle.wheel) for e in found if vehicle and e.goes_with_a_wheel()))


def not_identifiable(coverage: Coverage) -> dict[str, Note]:
    """Return, for families of which no form can be identified, a note on why."""
    reasons: dict[str, list[Note | None]] = {}
    for effect in EFFECTS.values():
        if not coverage.roles.issuperset(effect.needs.roles):
            continue
        why = ruled_out(effect, coverage) or next(_unmet(effect.needs, coverage), None)
        reasons.setdefault(effect.name, []).append(why if effect.reading == "any" else None)
    return {family: each[0] for family, each in reasons.items() if each[0] is not None and None not in each}


def ruled_out(effect: type[Effect], coverage: Coverage) -> Note | None:
    """Return why an effect is not considered; None where it is."""
    if coverage.commanded_slip and _SPEEDS.intersection(effect.shows):
        return Note(LackCode.SLIP_COMMANDED)
    missing = tuple(name for name in effect.needs.conditions if name not in coverage.conditions)
    if missing:
        return Note(LackCode.INPUT_UNKNOWN, values={"conditions": missing})
    return Note(LackCode.SMOOTH_TYRE) if effect.needs.lugs and coverage.tyre == "smooth" else None


def _unmet(needs: Needs, coverage: Coverage) -> Iterator[Note]:
    """Yield why an effect that is considered is never named."""
    if needs.both_directions and not coverage.both_directions:
        yield Note(LackCode.ONE_DIRECTION)
    if needs.several_passes and not coverage.several_passes:
        yield Note(LackCode.SAME_PASS)
    if needs.pressures and not coverage.pressures:
        yield Note(LackCode.PRESSURE_UNKNOWN)
    if needs.two_loads and not coverage.load_spread >= ONE_LOAD:
        yield Note(LackCode.ONE_LOAD, values={"spread": coverage.load_spread, "least": ONE_LOAD})
    if needs.several_runs and not coverage.several_runs:
        yield Note(LackCode.ONE_RUN_NO_DRIFT)
    if needs.braking and not coverage.braked:
        yield Note(LackCode.HARDLY_BRAKED)
    if needs.largest_slip and not coverage.driven:
        yield Note(LackCode.HARDLY_DRIVEN)
    if needs.largest_slip and coverage.largest_slip < needs.largest_slip:
        yield Note(LackCode.LOW_SLIP, values={"slip": needs.largest_slip})
    for channel in needs.channels:
        if channel in coverage.unused_channels:
            yield Note(LackCode.CHANNEL_UNUSED, values={"role": channel})
        elif channel not in coverage.channels:
            yield Note(LackCode.CHANNEL_MISSING, values={"role": channel})
    if needs.standstill and not coverage.standstill and needs.zero_of not in coverage.lifted:
        yield Note(LackCode.NOT_AT_STANDSTILL)
