"""ProcessedRun: everything the model needs of one run, on one time base, with units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq import ON_TIME_BASE, ROLES, BoolArray, Brakes, FloatArray, IntArray, Note, RunInfo, Severity, Use, data_frame
from processing.notes import RunCode
from processing.options import FORCE_ROLES, LOOK, NEEDED_ROLES, SLIP_ROLES

if TYPE_CHECKING:
    import pandas as pd


class Segment(IntEnum):
    """What the vehicle is doing."""

    UNKNOWN = 0
    STANDSTILL = 1
    DRIVE = 2
    COAST = 3
    BRAKE = 4


class Reason(IntEnum):
    """Why a sample is excluded; 0 = it is used. The first reason that holds is kept.

    The last two are of a whole run that no soil is fitted to, on a page that shows it beside the others.
    """

    USED = 0
    GAP = 1
    INVALID_FIX = 2
    NOT_MEASURED = 3
    STANDSTILL = 4
    TOO_SLOW = 5
    FILTER_EDGE = 6
    NEGATIVE_LOAD = 7
    SLIP_OUT_OF_RANGE = 8
    TRANSDUCER = 9
    BY_HAND = 10
    SLIP_NOT_MEASURED = 11
    STEERED = 12
    SENSOR_FAULT = 13
    FIRM_GROUND = 14
    SET_ASIDE = 15


GROUND_SPEED = "ground_speed"


@dataclass(frozen=True)
class SensorFacts:
    """What one channel looked like before it was filtered.

    Attributes
    ----------
    samples, late : int
        Usable samples; samples excluded because their stamps ran backward.
    rate_hz, longest_gap_s : float
        Samples over duration, without pauses; longest time without a usable sample (NaN without samples).
    gaps : int
        Holes that were not bridged.
    latency_s : float
        Declared, and removed.
    sigma : float
        One-sigma of one filtered sample, SI.
    sigma_source : str
        ``"declared"``, ``"estimated"`` from what the filter takes out, or ``"standstill"`` where that showed more.
    distrusted : int
        Samples excluded because the transducer's status was not 0.
    systematic_sigma : float
        One-sigma of what a zero leaves uncertain, the same in every sample, SI; NaN where no zero was taken off.
    """

    samples: int
    late: int
    rate_hz: float
    gaps: int
    longest_gap_s: float
    latency_s: float
    sigma: float
    sigma_source: str
    distrusted: int = 0
    systematic_sigma: float = float("nan")


LEVEL_DEG = 0.3
"""Tilt of ground that is taken for level: the soil holds that share of the load at a wheel that stands."""
RUT_SHARE = 0.01
"""One-sigma, of the load, of the pull that a rut keeps at a wheel that stands with released brakes."""


@dataclass(frozen=True)
class Standstill:
    """Medians over one standstill: what the zeros of the sensors look like. Nothing is subtracted.

    Medians, because torque builds up before the wheel moves and fades after it has stopped.

    Attributes
    ----------
    levels, sigmas : mapping role -> float
        Median of drawbar pull, torque, load and ground speed, and its one-sigma, SI.
    brakes : "held", "released" or "unknown"
        As the brake's channel shows or, without one, as vehicle.toml declares.
    """

    start_s: float
    duration_s: float
    levels: dict[str, float]
    sigmas: dict[str, float]
    brakes: Brakes = "unknown"

    @property
    def released(self) -> bool:
        """Whether it shows zeros: a wheel that a brake holds carries an unknown force and its torque."""
        return self.brakes == "released"


@dataclass(frozen=True)
class AppliedZero:
    """The zero that was taken off a role, in SI and the transducer's own axes, in the middle of the run.

    Attributes
    ----------
    offset, rotating : float
        Stationary part; amplitude of the part that turns with the wheel (NaN where it was not seen).
    systematic_sigma : float
        See `SensorFacts`.
    methods, recordings : tuple of str
        Of the determination used, or of both that it was interpolated between.
    ages_s : tuple of float
        Start of the run less time of each determination.
    lifted : bool
        Whether the wheel was lifted, in each; else it stood, and the ground's force was taken out by what is known.
    of_role : bool
        Whether offset and role are one quantity: in vehicle axes. In wheel axes what stays of a force is what turns.
    """

    offset: float
    rotating: float
    systematic_sigma: float
    methods: tuple[str, ...]
    recordings: tuple[str, ...]
    ages_s: tuple[float, ...]
    lifted: bool = True
    of_role: bool = True

    @property
    def is_known(self) -> bool:
        """Whether it tells what is left of the role's zero: nothing but its uncertainty."""
        return self.lifted and self.of_role and self.systematic_sigma > 0.0


@dataclass(frozen=True)
class QualityReport:
    """What was kept, what was not, and what the sensors' clocks looked like.

    Attributes
    ----------
    shares : mapping str -> float
        Share of samples per `Reason` name (sums to 1).
    residual_latency_s, residual_latency_sigma_s : float
        Ground speed against wheel speed after declared latencies are removed; positive: ground speed is late.
        NaN where it cannot be estimated.
    speed_scale, speed_scale_sigma : float
        Ground speed over rim speed on hardly slipping samples; NaN where it cannot be estimated.
    clock : mapping str -> float
        GNSS time against host clock: offset_s, drift_ppm, residual_s (empty without GNSS time).
    notes : tuple of Note
        See `processing.notes.RunCode`.
    sensors : mapping role -> SensorFacts
    zeros : mapping role -> AppliedZero
        Empty where none was taken off.
    transducer_status : mapping str -> int
        Status samples that are not 0, by what the value table calls them.
    missing : mapping role -> Note
        Of the speeds, load and drawbar pull those that the run does not carry, and why; known where the purpose was to
        look.
    """

    shares: dict[str, float] = field(default_factory=dict)
    residual_latency_s: float = float("nan")
    residual_latency_sigma_s: float = float("nan")
    speed_scale: float = float("nan")
    speed_scale_sigma: float = float("nan")
    clock: dict[str, float] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    sensors: dict[str, SensorFacts] = field(default_factory=dict)
    standstills: tuple[Standstill, ...] = ()
    zeros: dict[str, AppliedZero] = field(default_factory=dict)
    transducer_status: dict[str, int] = field(default_factory=dict)
    missing: dict[str, Note] = field(default_factory=dict)


@dataclass(frozen=True)
class ProcessedRun:
    """One run on one time base; SI units, radians; every array has shape (n,).

    A quantity that was not measured is all NaN, and so is the slip where a speed was not.
    ``*_sigma`` is the one-sigma of one sample.
    Signs: load positive up on the wheel, drawbar pull positive forward, torque positive driving
    (``dbc/README.md``). Slip: Eq. 6 for driving, (r omega - V)/V for braking.
    A used sample has finite values of every quantity that the run carries, but for position and sinkage, which may
    come and go. Arrays may be read-only.

    Attributes
    ----------
    cutoff_hz : float
        Of the zero-phase filter that every channel passed.
    time_s : since the first sample; ``start_ns`` is its UTC time.
    reason : uint8, see `Reason`; ``segment`` : uint8, see `Segment`.
    latitude_deg, longitude_deg : NaN without position.
    extras : mapping str -> float64 array
        Values and one-sigma of channels that no model takes, by the names of their columns; only those measured.
    outboard_mass_kg : float
        As vehicle.toml declares it, 0 where it does not: its inertia is taken off the drawbar pull, its weight is not.
    outboard_inertia_kgm2 : float
        The same of the torque.
    outboard_role : str
        What the acceleration of that mass is of: the slope of ``ground_speed``, or an accelerometer, whose reading has
        the weight along a slope in it.
    axle, axles : int
        Of the wheel, from the front, and how many the vehicle has.
    least_speed_mps : float
        Larger of rim and ground speed below which no slip was formed.
    rolling_radius_m : float, optional
        Of the slip, where it is not `wheel_radius_m`.
    """

    run: RunInfo
    rate_hz: float
    cutoff_hz: float
    wheel_radius_m: float
    start_ns: int
    time_s: FloatArray
    slip: FloatArray
    slip_sigma: FloatArray
    ground_speed_mps: FloatArray
    ground_speed_sigma_mps: FloatArray
    wheel_speed_radps: FloatArray
    wheel_speed_sigma_radps: FloatArray
    vertical_load_n: FloatArray
    vertical_load_sigma_n: FloatArray
    drawbar_pull_n: FloatArray
    drawbar_pull_sigma_n: FloatArray
    driving_torque_nm: FloatArray
    driving_torque_sigma_nm: FloatArray
    sinkage_m: FloatArray
    sinkage_sigma_m: FloatArray
    ground_acceleration_mps2: FloatArray
    wheel_acceleration_radps2: FloatArray
    distance_m: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    segment: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    quality: QualityReport
    extras: dict[str, FloatArray] = field(default_factory=dict)
    outboard_mass_kg: float = 0.0
    outboard_inertia_kgm2: float = 0.0
    outboard_role: str = GROUND_SPEED
    axle: int = 1
    axles: int = 1
    least_speed_mps: float = 0.0
    rolling_radius_m: float | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def used(self) -> BoolArray:
        """Samples that have no reason to be excluded."""
        return np.asarray(self.reason == Reason.USED)

    @property
    def passage(self) -> int:
        """How many wheels, with this one, have driven over the soil: the vehicle drives forward in every pass."""
        return (self.run.pass_number - 1) * self.axles + self.axle

    @property
    def has_accelerometer(self) -> bool:
        """Whether an accelerometer compensates the outboard mass: its inertia, and its weight along a slope."""
        return self.outboard_role != GROUND_SPEED

    @property
    def outboard_acceleration_mps2(self) -> FloatArray:
        """What the outboard mass is multiplied by in the drawbar pull."""
        return self.extras[ROLES[self.outboard_role].field] if self.has_accelerometer else self.ground_acceleration_mps2

    @property
    def rolling_m(self) -> float:
        """Radius that the slip is formed with."""
        return self.rolling_radius_m or self.wheel_radius_m

    @property
    def rim_speed_mps(self) -> FloatArray:
        """Wheel speed times the rolling radius."""
        return self.rolling_m * self.wheel_speed_radps

    def column(self, name: str) -> NDArray[Any]:
        """Return a column by its name, extras too; NaN for a quantity that was not measured."""
        if name in _EXTRAS:
            return self.extras.get(name, np.broadcast_to(np.float64(np.nan), self.time_s.shape))
        return np.asarray(getattr(self, name))

    def to_frame(self) -> pd.DataFrame:
        """Return the run as a frame: one row a sample, units in ``attrs["units"]``, the run's name in ``attrs["run"]``.

        Returns
        -------
        pandas.DataFrame
            Shape (n, columns). Columns as `wheelsoil process -o` writes them, for instance ``drawbar_pull_n``;
            quantities that were not measured are left out; ``segment`` and ``reason`` are names.
        """
        units = units_of(self)
        frame = data_frame(block_of(self, units, slice(None)), units)
        frame.attrs["run"] = self.run.id
        return frame


Column = FloatArray | IntArray | NDArray[np.str_]

UNITS = {
    "slip": "1",
    **{channel.field: channel.unit for channel in ON_TIME_BASE},
    "ground_acceleration_mps2": "m/s^2",
    "wheel_acceleration_radps2": "rad/s^2",
    "distance_m": "m",
    "latitude_deg": "deg",
    "longitude_deg": "deg",
}
"""Quantities of a processed run and their units: the channels, and what follows from them."""
_SIGMAS = {"slip": "slip_sigma"} | {channel.field: channel.sigma_field for channel in ON_TIME_BASE}
_EXTRAS = {name for c in ON_TIME_BASE if c.use is Use.EXTRA for name in (c.field, c.sigma_field)}
_NAMED: dict[str, type[Segment] | type[Reason]] = {"segment": Segment, "reason": Reason}


def units_of(run: ProcessedRun) -> dict[str, str]:
    """Return the names of the run's columns and their units.

    ``time_ns`` (UTC) and ``time_s`` (since the first sample) first; quantities that were not measured are left out;
    ``segment`` and ``reason`` are names.
    """
    units = {"time_ns": "ns", "time_s": "s"}
    for name, unit in UNITS.items():
        if not np.isnan(run.column(name)).all():
            units |= {column: unit for column in (name, _SIGMAS.get(name)) if column}
    return units | dict.fromkeys(_NAMED, "")


def block_of(run: ProcessedRun, names: Iterable[str], rows: slice) -> dict[str, Column]:
    """Return some rows of some columns; NaN for a quantity that was not measured."""
    return {name: _column(run, name, rows) for name in names}


def _column(run: ProcessedRun, name: str, rows: slice) -> Column:
    if name == "time_ns":
        return run.start_ns + np.round(run.time_s[rows] * 1e9).astype(np.int64)
    if name in _NAMED:
        words: NDArray[np.str_] = np.array([member.name.lower() for member in _NAMED[name]])
        return np.asarray(words[run.column(name)[rows]])
    return np.ascontiguousarray(run.column(name)[rows])


def is_refused(run: ProcessedRun) -> bool:
    """Return whether a run is impossible as it is declared; see `processing.referee`."""
    return any(map(is_refusal, run.quality.notes))


def is_refusal(note: Note) -> bool:
    """Return whether a note says that its run is impossible as it is declared."""
    return note.severity == Severity.FAULT and note.code in (RunCode.IMPLAUSIBLE, RunCode.WRONG_SIZE)


_NOT_WHOLE = (RunCode.ROLE_MISSING, RunCode.NOT_MEASURED, RunCode.NEVER_USABLE)


def purposes_served(run: ProcessedRun) -> tuple[str, ...]:
    """Return the purposes (see `ProcessOptions`) for which the same channels and other options give this very run.

    None where a channel has no usable value, or a speed or a force is missing: what becomes of it depends on the
    purpose.
    """
    facts, notes = run.quality.sensors, run.quality.notes
    usable = all(sensor.samples for sensor in facts.values()) and not any(note.code in _NOT_WHOLE for note in notes)
    if not usable or not {*SLIP_ROLES, *FORCE_ROLES} <= facts.keys():
        return ()
    return (LOOK, *(purpose for purpose, roles in NEEDED_ROLES.items() if facts.keys() >= set(roles)))
