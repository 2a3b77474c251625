"""Motion of the vehicle: standstill and accelerate-coast-brake cycles, with the vertical load on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq import ConfigError, FloatArray

GRAVITY_MPS2 = 9.80665
_REFERENCE_WAVENUMBER_PER_M = 0.1  # of ISO 8608

SHORTEST_RUN_S = 15.0
_STANDSTILL_S = 3.0
_LAUNCH_S = 2.0
_LAUNCH_SLIP = 0.12
_STOP_S = 2.5
_CYCLE_S = 9.5
_BRAKE_FROM = 0.69

Knots = FloatArray
"""Times in s, and values: shape (2, n)."""


@dataclass(frozen=True)
class VehicleSetup:
    """The vehicle around an instrumented wheel; the defaults are the rear wheel of the paper's 3.6 t vehicle.

    Attributes
    ----------
    mass_kg, static_load_n : of the empty vehicle, and the share of it on the instrumented wheel
    added_load_share : share of an added mass that the instrumented wheel carries
    load_transfer : 1 of a rear wheel, which gains load when the vehicle accelerates, -1 of a front wheel
    outboard_mass_kg, outboard_inertia_kgm2 : on the soil side of the transducer
    unsprung_mass_kg, body_frequency_hz, damping_ratio, contact_stiffness_n_per_m : float
        Of the quarter vehicle that rides over the road; the stiffness is that of soil and tyre in series.
    roughness_m3 : ISO 8608 displacement density at 0.1 cycles/m (class C 256e-6, D 1024e-6)
    inflation_kpa : of the tyre, unless a run states another
    """

    mass_kg: float = 3600.0
    static_load_n: float = 8000.0
    added_load_share: float = 0.4
    centre_of_gravity_height_m: float = 0.9
    wheelbase_m: float = 2.7
    load_transfer: float = 1.0
    outboard_mass_kg: float = 75.0
    outboard_inertia_kgm2: float = 8.0
    unsprung_mass_kg: float = 110.0
    body_frequency_hz: float = 1.4
    damping_ratio: float = 0.35
    contact_stiffness_n_per_m: float = 70e3
    roughness_m3: float = 512e-6
    inflation_kpa: float = 340.0


class WheelLoad:
    """Load between wheel and soil, positive up on the wheel, stretch after stretch of a run.

    A rear wheel gains load m a h/(2 L) when the vehicle accelerates, a front wheel loses it. The road acts through a
    linear quarter vehicle, so that the load swings at body and wheel frequency and rests at standstill. The generator
    draws the road, one number for each sample.
    """

    def __init__(self, setup: VehicleSetup, rate_hz: float, added_load_kg: float, rng: np.random.Generator) -> None:
        self._static_n = static_load_n(setup, added_load_kg)
        mass = setup.mass_kg + added_load_kg
        self._n_per_mps2 = setup.load_transfer * mass * (setup.centre_of_gravity_height_m / (2 * setup.wheelbase_m))
        self._road = RoadLoad(setup, self._static_n, rate_hz)
        self._rng = rng

    def next_n(self, ground_speed_mps: FloatArray, ground_acceleration_mps2: FloatArray) -> FloatArray:
        """Return the load of the next samples, shape (n,)."""
        swing = self._road.next_n(ground_speed_mps, self._rng.standard_normal(len(ground_speed_mps)))
        return self._static_n + self._n_per_mps2 * ground_acceleration_mps2 + swing


def static_load_n(setup: VehicleSetup, added_load_kg: float) -> float:
    """Return the load of the instrumented wheel at standstill."""
    return setup.static_load_n + setup.added_load_share * added_load_kg * GRAVITY_MPS2


class RoadLoad:
    """The load's swing about its mean from a road of ISO 8608's shape, stretch after stretch.

    Such a road's vertical velocity is white noise of density (2 pi n0)^2 Gd(n0) V at speed V.

    Notes
    -----
    Source: ISO 8608:2016 (road profiles, waviness 2); the quarter vehicle is the textbook's two-mass model.
    """

    def __init__(self, setup: VehicleSetup, static_n: float, rate_hz: float) -> None:
        from scipy.signal import bilinear_zpk, tf2zpk, zpk2sos

        unsprung = setup.unsprung_mass_kg
        sprung = max(static_n / GRAVITY_MPS2 - unsprung, unsprung)
        spring = sprung * (2 * np.pi * setup.body_frequency_hz) ** 2
        damper = 2 * setup.damping_ratio * np.sqrt(spring * sprung)
        contact = setup.contact_stiffness_n_per_m
        both = unsprung + sprung
        numerator = contact * np.array([unsprung * sprung, both * damper, both * spring, 0.0])
        denominator = np.array(
            [unsprung * sprung, both * damper, both * spring + contact * sprung, contact * damper, contact * spring]
        )
        zeros, poles, gain = tf2zpk(numerator, denominator)
        self._sections = zpk2sos(*bilinear_zpk(zeros, poles, gain, rate_hz))
        self._state = np.zeros((len(self._sections), 2))
        self._density = (2 * np.pi * _REFERENCE_WAVENUMBER_PER_M) ** 2 * setup.roughness_m3
        self._rate_hz = rate_hz

    def next_n(self, ground_speed_mps: FloatArray, white: FloatArray) -> FloatArray:
        """Return the swing of the next samples, shape (n,); `white` is standard normal."""
        from scipy.signal import sosfilt

        road_velocity = white * np.sqrt(self._density * ground_speed_mps * self._rate_hz / 2)
        swing, self._state = sosfilt(self._sections, road_velocity, zi=self._state)
        return np.asarray(swing, np.float64)


@dataclass(frozen=True)
class Motion:
    """Prescribed kinematics of the instrumented wheel, shape (n,) each.

    Attributes
    ----------
    time_s : since the start of the run, evenly spaced
    ground_speed_mps, ground_acceleration_mps2 : of the wheel's centre
    wheel_angle_rad, distance_m : since the start of the run, not wrapped
    slip : 1 - V/(r omega) driving, (r omega - V)/V braking; zero at standstill
    """

    time_s: FloatArray
    ground_speed_mps: FloatArray
    ground_acceleration_mps2: FloatArray
    wheel_speed_radps: FloatArray
    wheel_acceleration_radps2: FloatArray
    wheel_angle_rad: FloatArray
    distance_m: FloatArray
    slip: FloatArray


@dataclass(frozen=True)
class DrivingStyle:
    """Limits that the random cycles keep.

    Attributes
    ----------
    peak_slip, ordinary_peak_slip : (low, high)
        Range of the highest slip of one cycle of the run, and of the others.
    brake_slip : (low, high)
        Range of the strongest braking slip of a cycle (negative).
    highest_rim_speed_mps : r omega that the low gear allows: where the slip is high the vehicle is slow
    """

    peak_slip: tuple[float, float] = (0.86, 0.91)
    ordinary_peak_slip: tuple[float, float] = (0.45, 0.75)
    brake_slip: tuple[float, float] = (-0.42, -0.25)
    lowest_speed_mps: float = 0.6
    highest_speed_mps: float = 4.5
    highest_deceleration_mps2: float = 2.5
    highest_rim_speed_mps: float = 6.0


@dataclass(frozen=True)
class Steering:
    """A slalom, and where wheel and antenna are: x + iy, m ahead and to the left of the middle of the rear axle.

    That middle has the drive's speed V and does not slide. With the angle delta of the front wheels the yaw rate is
    r = V tan(delta)/L (kinematic bicycle), and a place z moves at V + i r z. Rear wheels point forward, each front
    wheel where it goes. No lateral force of the soil is modelled: the vehicle goes where its wheels point. Position
    and course are those of the line about which it winds.
    """

    amplitude_rad: float
    wheelbase_m: float
    wheel_m: complex
    antenna_m: complex = 1.2 + 0.5j
    period_s: float = 10.0

    def curvature_per_m(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r/V, the rate of that, and the angle of the front wheels in rad."""
        pace = 2 * np.pi / self.period_s
        angle = np.asarray(self.amplitude_rad * np.sin(pace * time_s))
        rate = self.amplitude_rad * pace * np.cos(pace * time_s) / np.cos(angle) ** 2
        return np.tan(angle) / self.wheelbase_m, rate / self.wheelbase_m, angle


@dataclass(frozen=True)
class Drive:
    """One run as it is to be driven: a `Motion` that is calculated stretch by stretch.

    Ground speed V and log ratio ln(r omega/V) are prescribed as smooth steps, so that both accelerations are
    continuous; slip follows from the ratio. What the instrumented wheel cannot pull, the others do. Wheel
    acceleration stays below about 10 rad/s2.

    Attributes
    ----------
    rate_hz : samples per second of the motion
    speed_knots, ratio_knots : of ground speed and of ln(r omega/V), as `smooth_steps` takes them
    steering : with it the knots are of the speed of the middle of the rear axle; None: straight on
    """

    duration_s: float
    wheel_radius_m: float
    rate_hz: float
    speed_knots: Knots
    ratio_knots: Knots
    steering: Steering | None = None

    @property
    def count(self) -> int:
        """Samples of the whole run."""
        return round(self.duration_s * self.rate_hz)

    def time_s(self, start: int, stop: int, step: int = 1) -> FloatArray:
        """Return the instants of some samples."""
        return np.arange(start, stop, step) / self.rate_hz

    def ground(self, time_s: FloatArray, place_m: complex | None = None) -> tuple[FloatArray, FloatArray]:
        """Return speed and acceleration over ground at any instants, of the wheel or another place on the vehicle."""
        speed, acceleration = smooth_steps(time_s, self.speed_knots)
        if self.steering is None:
            return speed, acceleration
        place = self.steering.wheel_m if place_m is None else place_m
        curvature, change, _ = self.steering.curvature_per_m(time_s)
        over = 1 + 1j * curvature * place
        ratio, rate = np.abs(over), change * (over.conj() * 1j * place).real / np.abs(over)
        return speed * ratio, acceleration * ratio + speed * rate

    def turning(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return yaw rate, lateral acceleration of the middle of the rear axle, and angle of the front wheels."""
        speed = smooth_steps(time_s, self.speed_knots)[0]
        curvature, _, angle = self.steering.curvature_per_m(time_s) if self.steering else np.zeros((3, len(time_s)))
        return speed * curvature, speed**2 * curvature, angle

    def motion(self, start: int = 0, stop: int | None = None, before: Motion | None = None) -> Motion:
        """Return a stretch of the run, or all of it; `before` is the motion that ends just before it."""
        time_s = self.time_s(start, self.count if stop is None else stop)
        speed, acceleration = self.ground(time_s)
        log_ratio, log_ratio_rate = smooth_steps(time_s, self.ratio_knots)
        ratio = np.exp(log_ratio)
        omega = speed * ratio / self.wheel_radius_m
        alpha = (acceleration + speed * log_ratio_rate) * ratio / self.wheel_radius_m
        slip = np.where(log_ratio >= 0, -np.expm1(-log_ratio), np.expm1(log_ratio))
        angle = (before.wheel_speed_radps[-1], before.wheel_angle_rad[-1]) if before else None
        distance = (before.ground_speed_mps[-1], before.distance_m[-1]) if before else None
        return Motion(
            time_s=time_s,
            ground_speed_mps=speed,
            ground_acceleration_mps2=acceleration,
            wheel_speed_radps=omega,
            wheel_acceleration_radps2=alpha,
            wheel_angle_rad=integrated(omega, self.rate_hz, angle),
            distance_m=integrated(speed, self.rate_hz, distance),
            slip=np.where(speed > 0, slip, 0.0),
        )


def drawn_drive(
    duration_s: float,
    wheel_radius_m: float,
    rng: np.random.Generator,
    *,
    rate_hz: float = 1000.0,
    coast_slip: float = -0.1,
    style: DrivingStyle | None = None,
) -> Drive:
    """Draw the number of cycles of one run of at least `SHORTEST_RUN_S`, their slip, speed and length.

    At `coast_slip` the wheel transmits no torque. `ConfigError` for a run that is too short for one cycle between two
    standstills.
    """
    if not duration_s >= SHORTEST_RUN_S:
        raise ConfigError.of(
            "the run is too short for one cycle between two standstills",
            found=f"{duration_s:g} s",
            expected=f"at least {SHORTEST_RUN_S:g} s",
            next_step="give a longer duration",
        )
    speed, ratio = _knots(duration_s, _log_ratio(coast_slip), rng, style or DrivingStyle())
    return Drive(duration_s, wheel_radius_m, rate_hz, np.array(speed).T, np.array(ratio).T)


def smooth_steps(time_s: FloatArray, knots: Knots) -> tuple[FloatArray, FloatArray]:
    """Return value and rate of cosine steps between knots; constant outside of them.

    Both are continuous; the rate is zero at every knot.
    """
    at, value = knots
    piece = np.clip(np.searchsorted(at, time_s, side="right") - 1, 0, len(at) - 2)
    length = at[piece + 1] - at[piece]
    fraction = np.clip((time_s - at[piece]) / length, 0.0, 1.0)
    height = value[piece + 1] - value[piece]
    return (
        value[piece] + height * (1 - np.cos(np.pi * fraction)) / 2,
        height * np.pi / 2 * np.sin(np.pi * fraction) / length,
    )


def integrated(rate: FloatArray, rate_hz: float, before: tuple[float, float] | None = None) -> FloatArray:
    """Return the integral by trapezoids, shape (n,): from the first sample on, or of a stretch after another.

    `before` is rate and integral of the sample before the first.
    """
    known, first = ([], 0.0) if before is None else ([before[0]], before[1])
    ends = np.concatenate([known, rate])
    steps = (ends[1:] + ends[:-1]) / (2 * rate_hz)
    return np.cumsum(np.concatenate([[first], steps]))[len(known) :]


@dataclass(frozen=True)
class _Cycle:
    start_s: float
    length_s: float
    peak_slip: float
    brake_slip: float
    low_speed_mps: float
    high_speed_mps: float


def _knots(
    duration_s: float, coast: float, rng: np.random.Generator, style: DrivingStyle
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Return the knots of ground speed and of ln(r omega/V)."""
    still = _STANDSTILL_S + rng.uniform(-0.4, 0.4)
    first = still + _LAUNCH_S
    last = duration_s - _STANDSTILL_S - _STOP_S
    cycles = _cycles(first, last, rng, style)
    speed = [(0.0, 0.0), (still, 0.0)]
    ratio = [(0.0, _log_ratio(_LAUNCH_SLIP)), (first, _log_ratio(_LAUNCH_SLIP))]
    for cycle in cycles:
        # drive to 0.56, coast to 0.69, brake to 0.88, coast to the next cycle
        at = [cycle.start_s + share * cycle.length_s for share in (0.0, 0.28, 0.56, _BRAKE_FROM, 0.785, 0.88)]
        speed += [(at[0], cycle.low_speed_mps), (at[2], cycle.high_speed_mps), (at[3], 0.92 * cycle.high_speed_mps)]
        ratio += [
            (at[1], _log_ratio(cycle.peak_slip)),
            (at[2], coast),
            (at[3], coast),
            (at[4], _log_ratio(cycle.brake_slip)),
            (at[5], coast),
        ]
    end = cycles[-1].start_s + cycles[-1].length_s
    speed += [(end, style.lowest_speed_mps), (end + _STOP_S, 0.0)]
    ratio += [(end + 0.5 * _STOP_S, coast + _log_ratio(-0.1))]
    return speed, ratio


def _cycles(first_s: float, last_s: float, rng: np.random.Generator, style: DrivingStyle) -> list[_Cycle]:
    span = last_s - first_s
    count = max(1, round(span / _CYCLE_S + rng.uniform(-0.5, 0.5)))
    peaks = rng.uniform(*style.ordinary_peak_slip, count)
    peaks[rng.integers(count)] = rng.uniform(*style.peak_slip)
    weights = 1 - np.log1p(-peaks)  # a high slip is approached slowly, as a driver does
    lengths = span * weights / weights.sum()
    starts = first_s + np.concatenate([[0.0], np.cumsum(lengths[:-1])])
    cycles = []
    for start, length, peak in zip(starts, lengths, peaks, strict=True):
        middle = float(np.clip(style.highest_rim_speed_mps * (1 - peak), 0.7, 3.0)) * rng.uniform(0.9, 1.1)
        low = max(style.lowest_speed_mps, 0.6 * middle)
        stops_from = style.lowest_speed_mps + 2 / np.pi * style.highest_deceleration_mps2 * (1 - _BRAKE_FROM) * length
        high = max(low, float(min(2 * middle - low, style.highest_speed_mps, stops_from)))
        brake = rng.uniform(*style.brake_slip)
        cycles.append(_Cycle(float(start), float(length), float(peak), float(brake), low, high))
    return cycles


def _log_ratio(slip: float) -> float:
    """Return ln(r omega/V) of a slip in the convention of both branches."""
    return float(-np.log1p(-slip) if slip >= 0 else np.log1p(slip))
