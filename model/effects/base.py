"""What an effect (a hypothesis about the measured wheel) is: its parameters, what the data must hold, and its hooks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from daq import FloatArray, SensorSection, VehicleConfig
from model.wheel_soil import Conditions, Dual, Number, Patch, Reaction, SoilState, Wheel, WheelState

Values = Mapping[str, Number]
Abscissa = Literal["", "slip", "load", "speed", "time", "prediction", "acceleration", "rim acceleration"]
_BY_SIGN = re.compile(r"\{([\w ]+)/([\w ]+)\}")


@dataclass(frozen=True)
class Needs:
    """What the data must hold for an effect to be identified.

    Without `roles` or `conditions`, or on a tyre that has no lugs, an effect is not considered at all. Without the
    rest it is considered, since it may be there, but never named.

    Attributes
    ----------
    roles : tuple of str
        Optional roles of vehicle.toml. Where a run lacks one, the effect is no hypothesis at all, and is not listed.
    conditions : tuple of str
        Fields of `Conditions` beyond slip and load that its formula takes.
    channels : tuple of "drawbar_pull", "driving_torque"
        Measured forces without which nothing of it shows.
    two_loads, both_directions, several_passes, several_runs : what the runs must differ in
    pressures : the inflation pressure must be stated
    standstill, braking : the wheel must stand with released brakes, or be braked, for some time
    zero_of : role whose zero it is: a reading of the lifted wheel serves as well as a standstill
    largest_slip : the driven wheel must reach more than this slip; 0: it need not be driven
    lugs : it cannot be on a tyre that is declared smooth
    """

    roles: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    two_loads: bool = False
    both_directions: bool = False
    several_passes: bool = False
    several_runs: bool = False
    pressures: bool = False
    standstill: bool = False
    zero_of: str = ""
    braking: bool = False
    largest_slip: float = 0.0
    lugs: bool = False


@dataclass(frozen=True)
class FirstEstimate:
    """A quantity of the processing that estimates the parameter of an effect by itself.

    Attributes
    ----------
    quality : field of a run's quality
    notable : size from which on a diagnosis starts from it, too
    """

    quality: str
    notable: float


@dataclass(frozen=True)
class Parameter:
    """A number to be estimated.

    Attributes
    ----------
    neutral : the value at which the effect is not there
    start : where an estimate starts
    lower, upper : bounds of an estimate
    prior_scale : one-sigma of what is plausible before any data; in wheel radii where `in_radii`
    side : 1, -1 or 0
        The only plausible side of neutral (a half-normal prior): above or below it; 0 for both.
    in_radii : the prior scale is a share of the wheel's radius
    usual : (mean, one-sigma), optional
        What it usually is in nature, where that is not neutral.
    """

    name: str
    unit: str
    neutral: float
    start: float
    lower: float
    upper: float
    prior_scale: float
    source: str = ""
    side: Literal[-1, 0, 1] = 0
    in_radii: bool = False
    usual: tuple[float, float] | None = None

    @property
    def one_sided(self) -> bool:
        """Whether the prior is half-normal."""
        return self.side != 0

    def scale(self, wheel: Wheel) -> float:
        """Return the prior's one-sigma for a wheel, in the parameter's unit."""
        return self.prior_scale * (wheel.radius_m if self.in_radii else 1.0)

    def towards(self, wheel: Wheel) -> float:
        """Return the scale with the sign of the plausible side: a coefficient of 1 in `CauseColumn`."""
        return self.scale(wheel) * (self.side or 1)


@dataclass(frozen=True)
class Correction:
    """A number of vehicle.toml that mends an effect.

    Attributes
    ----------
    key : of ``[wheel]``, or of ``[sensors.ROLE]`` where a role is given
    per_unit : what a size of 1 adds to it
    share_of : property of the section that the size is a share of, where it is one
    form : how it is written
    """

    key: str
    per_unit: float = 1.0
    role: str = ""
    share_of: str = ""
    form: str = ".3g"

    @property
    def section(self) -> str:
        """Table of vehicle.toml."""
        return f"[sensors.{self.role}]" if self.role else "[wheel]"

    def line(self, vehicle: VehicleConfig, size: float) -> str:
        """Return the line of vehicle.toml that mends an effect of a size; a comment where it declares no number now.

        None is below 0: where a sensor would be early, others are late.
        """
        section = vehicle.sensors.get(self.role, SensorSection()) if self.role else vehicle.wheel
        now = getattr(section, self.share_of or self.key, None) if section else 0.0
        if not isinstance(now, int | float):
            share = f" of {self.share_of}" if self.share_of else ""
            return f"# {self.key}: add {size * (1.0 if share else self.per_unit):{self.form}}{share} to what it is"
        new = f"{now + size * (now if self.share_of else self.per_unit):z{self.form}}"
        others = f": check {self.key} of the other sensors, too" if self.role else ""
        return f"{self.key} = " + (f"0  # these runs ask for {new}, which cannot be{others}" if float(new) < 0 else new)


@dataclass(frozen=True)
class Remedy:
    """How an effect is mended by hand.

    Attributes
    ----------
    what : what to do, in a sentence
    corrections : numbers of vehicle.toml that mend it
    paste : commands and lines of a file, where no number depends on its size
    scales : a calibration of the only channel that it shows in mends it; this has a sentence of its own
    """

    what: str = "Check the sensor of this cause, and repeat the diagnosis."
    corrections: tuple[Correction, ...] = ()
    paste: str = ""
    scales: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of vehicle.toml that it corrects."""
        return tuple(correction.key for correction in self.corrections)


@dataclass(frozen=True)
class Signals:
    """What the sensors of a virtual test get to see of one run, on one regular time base, shape (n,) each; SI.

    Attributes
    ----------
    time_s : since the start of the run
    drawbar_pull_n, driving_torque_nm, vertical_load_n : at the transducer
    ground_speed_mps : for the ground-speed sensor only
    wheel_speed_radps : for the wheel-speed sensor only
    campaign_time : float array, from -1/2 to 1/2 over the campaign's clock
    body_pitch_rad : of the body under acceleration, positive nose up
    direction : 1 "out", -1 "back"
    """

    time_s: FloatArray
    drawbar_pull_n: FloatArray
    driving_torque_nm: FloatArray
    vertical_load_n: FloatArray
    ground_speed_mps: FloatArray
    wheel_speed_radps: FloatArray
    campaign_time: FloatArray
    body_pitch_rad: FloatArray
    direction: float


class Effect:
    """A change of the base model that vanishes at its parameters' neutral values.

    A subclass states the class variables and overrides only the hooks it needs. Hooks are plain numpy formulas on
    columns (n, 1) and get sensitivities by themselves (`model.wheel_soil.dual`): no ``if`` on a value, but its
    ``where``.
    A hook's ``values`` hold the effect's own parameters by their short names.

    Attributes
    ----------
    name, form : family and form; ``form`` is empty where the family has one form only
    kind : "physical" or "measurement"
    summary, source : what a report says of it, and where the formula is from; a report omits what is not stated
    own_symbols : a model knows its parameters as they are called ("H_m"), not as "wheel_radius.relative"
    shows : tuple of str
        Channels that it changes: "drawbar_pull", "driving_torque", "vertical_load", "ground_speed", "wheel_speed".
        Where drawbar pull and torque differ, a physical effect's wheel speed may too: it is not counted.
    needs : Needs
        What the data must hold.
    at_standstill : whether it shows when the wheel does not turn
    reading : "any" or "literal"
        "literal": an effect of the paper's literal reading only.
    total : what the sum of all parameters is called, where the data determine it better than each of them; else empty
    secant : the derivative at neutral misleads (the response grows as a root): a secant stands for it
    starts : tuple of float
        Where else a search starts, in prior scales, where wrong values confirm themselves.
    first_estimate : FirstEstimate or None
        First estimate of the only parameter.
    each_wheel : whether it is of one wheel or tyre; what goes with a transducer is, too
    of_tables : whether only rows of single-wheel tests identify it; runs consider it if nothing else is asked for
    remedy : Remedy, optional
        How it is mended by hand. A zero (`Needs.zero_of`) is determined anew and needs none.
    error_text : str
        What it does to a reading, as a sentence that names {channel}, {size} (of its first parameter, with interval) or
        {percent}, and {a/b} for a size above and below neutral; empty: it has none.
    abscissa : str
        Against what its figure shows the residual: of an error in the reading of pull or torque "slip" for a zero,
        "time" for a drift, "prediction" for a gain, "load" for a share of it; empty: slip, with the models.
    like_radius : its parameter by which a larger wheel radius looks the same, unless the tyre is declared; or ""
    of_radius : int
        Power of the wheel's true over its declared radius that 1 plus its only parameter then is; 0 where it is none.
    stage : int
        Place in the chain from the truth to a reading: a model takes its effects in this order, whatever order they
        are given in. Physical causes, tilts and speeds 0, gains 1, cross-talk 2, gain of the load 3, zeros 4, drift 5.
    """

    name: ClassVar[str] = ""
    form: ClassVar[str] = ""
    kind: ClassVar[Literal["physical", "measurement"]] = "physical"
    summary: ClassVar[str] = ""
    source: ClassVar[str] = ""
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    own_symbols: ClassVar[bool] = False
    shows: ClassVar[tuple[str, ...]] = ("drawbar_pull", "driving_torque")
    needs: ClassVar[Needs] = Needs()
    at_standstill: ClassVar[bool] = False
    reading: ClassVar[Literal["any", "literal"]] = "any"
    total: ClassVar[str] = ""
    secant: ClassVar[bool] = False
    starts: ClassVar[tuple[float, ...]] = ()
    first_estimate: ClassVar[FirstEstimate | None] = None
    each_wheel: ClassVar[bool] = False
    of_tables: ClassVar[bool] = False
    remedy: ClassVar[Remedy | None] = None
    error_text: ClassVar[str] = ""
    abscissa: ClassVar[Abscissa] = ""
    like_radius: ClassVar[str] = ""
    of_radius: ClassVar[int] = 0
    stage: ClassVar[int] = 0

    @classmethod
    def error_sentence(cls, *, above: bool, channel: str, size: str, percent: str) -> str:
        """Return `error_text` of a size above or below neutral; an error of `str.format` where it cannot be made."""
        text = _BY_SIGN.sub(r"\1" if above else r"\2", cls.error_text)
        return text.format(channel=channel, size=size, percent=percent)

    @classmethod
    def goes_with_a_wheel(cls) -> bool:
        """Return whether it may act at one of several wheels alone."""
        return cls.each_wheel or cls.of_the_transducer()

    @classmethod
    def of_the_transducer(cls) -> bool:
        """Return whether it goes with a transducer from campaign to campaign: a gain, a cross-talk or a zero."""
        forces = set(cls.shows) <= {"drawbar_pull", "driving_torque", "vertical_load"}
        return cls.kind == "measurement" and forces and 1 <= cls.stage <= 4 and len(cls.parameters) == 1

    @classmethod
    def is_usual(cls) -> bool:
        """Return whether soils usually have it: its parameters have usual values."""
        return all(p.usual for p in cls.parameters)

    def inputs(self, conditions: Conditions, values: Values) -> Conditions:
        """Return the true inputs of the model from the measured ones; the last in the chain is undone first."""
        return conditions

    def contact_radius(self, radius: Number, conditions: Conditions, values: Values) -> Number:
        """Return the radius of the contact in metres; the slip keeps the wheel's own."""
        return radius

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil's parameters under the given conditions."""
        return soil

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return Z in metres from the static Z0."""
        return static_sinkage

    def load_consistency(self, share: Number, values: Values) -> Number:
        """Return how much of the load-consistent solution counts: 0 in the literal reading, 1 in the balanced one."""
        return share

    def patch(self, patch: Patch, conditions: Conditions, values: Values) -> Patch:
        """Return the contact patch: angles of peak and exit, lugs, softening; its entry angle is known."""
        return patch

    def resultants(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what acts on the transducer, from what the stresses on the rim give."""
        return reaction

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads, from what acts on it."""
        return reaction

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return what the sensors get to see instead of the truth: for the virtual test, forward in time.

        Only measurement effects override it. `inputs` is the inverse for speeds and load, `observation` the same for
        drawbar pull and torque.
        """
        return signals

    @classmethod
    def moves_sinkage(cls) -> bool:
        """Whether the effect sets a sinkage other than the static one."""
        return cls.sinkage is not Effect.sinkage

    @classmethod
    def moves_static_sinkage(cls) -> bool:
        """Whether the effect changes the sinkage at which Eq. 7 holds."""
        hooks = ("inputs", "contact_radius", "soil", "patch", "load_consistency")
        return any(getattr(cls, hook) is not getattr(Effect, hook) for hook in hooks)

    @classmethod
    def is_active(cls, values: Values) -> bool:
        """Whether any parameter differs from neutral or is to be differentiated."""
        own = [(values[p.name], p.neutral) for p in cls.parameters]
        return any(isinstance(value, Dual) or bool(np.any(value != neutral)) for value, neutral in own)

    @classmethod
    def parameter_keys(cls) -> dict[str, str]:
        """Return the name by which a model knows each parameter."""
        return {p.name: p.name if cls.own_symbols else f"{cls.key()}.{p.name}" for p in cls.parameters}

    @classmethod
    def spelled(cls, name: str) -> str:
        """Return the name of a parameter; of the total, what it is the sum of."""
        return f"{name} = {' + '.join(p.name for p in cls.parameters)}" if cls.total and name == cls.total else name

    @classmethod
    def keyed(cls, values: Mapping[str, float]) -> dict[str, float]:
        """Return the effect's own values as a model takes them."""
        keys = cls.parameter_keys()
        return {keys[name]: value for name, value in values.items()}

    @classmethod
    def key(cls) -> str:
        """Return the short unique name: the form where there is one, else the family."""
        return cls.form or cls.name
