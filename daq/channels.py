"""The table of channels that a vehicle can carry, and the samples of one of them.

A signal of a DBC becomes a channel by its role in vehicle.toml. What is known of a channel (quantity, unit, names, use)
stands in `CHANNELS` and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto
from math import inf
from typing import TYPE_CHECKING

from daq import FloatArray, IntArray, Quantity, data_frame, unit_suffix, unit_text

if TYPE_CHECKING:
    import pandas as pd


class Use(Enum):
    """What a channel is for."""

    INPUT = auto()
    """Given to the wheel-soil model."""
    OUTPUT = auto()
    """Predicted by the wheel-soil model."""
    EXTRA = auto()
    """Processed and exported; no model takes it."""
    AID = auto()
    """Used to place or to prepare the others."""
    FLAG = auto()
    """Says what other channels are worth; its labels are values."""


@dataclass(frozen=True)
class ChannelDefinition:
    """One row of the table of channels.

    Attributes
    ----------
    role : str
        Name in ``[signals]`` of vehicle.toml, in findings and in JSON.
    quantities : tuple of Quantity
        What its signal may measure; the first one is what it is converted to.
    key : str
        Short name on the command line and in a fit or diagnosis; only inputs and outputs have one.
    required : bool
        Whether a used sample must have it, where the run carries it at all.
    in_degrees : bool
        Whether an angle stays in degrees, as positions do.
    of_wheel : bool
        Whether each wheel has its own, not the whole vehicle.
    possible : tuple of float
        Least and largest size that a run can reach, in `unit`; a value beyond has another unit than is declared.
    """

    role: str
    quantities: tuple[Quantity, ...]
    use: Use
    key: str = ""
    required: bool = False
    in_degrees: bool = False
    of_wheel: bool = False
    possible: tuple[float, float] = (0.0, inf)

    @property
    def name(self) -> str:
        """Plain name: "drawbar pull"."""
        return self.role.replace("_", " ")

    @property
    def unit(self) -> str:
        """Unit inside the program and in tables: "Nm"."""
        return "deg" if self.in_degrees else self.quantities[0].value

    @property
    def unit_text(self) -> str:
        """Unit as people write it: "N m"."""
        return unit_text(self.unit)

    @property
    def suffix(self) -> str:
        """Unit at the end of a name: "nm"."""
        return unit_suffix(self.unit)

    @property
    def field(self) -> str:
        """Name of its values in arrays and tables: ``driving_torque_nm``."""
        return f"{self.role}_{self.suffix}"

    @property
    def sigma_field(self) -> str:
        """Name of the one-sigma of its values: ``driving_torque_sigma_nm``."""
        return f"{self.role}_sigma_{self.suffix}"

    @property
    def on_time_base(self) -> bool:
        """Whether it is filtered onto the common time base of a processed run."""
        return self.use in (Use.INPUT, Use.OUTPUT, Use.EXTRA)


CHANNELS = (
    ChannelDefinition("ground_speed", (Quantity.SPEED,), Use.INPUT, "v", required=True),
    ChannelDefinition(
        "wheel_speed", (Quantity.ANGULAR_SPEED, Quantity.SPEED), Use.INPUT, "omega", required=True, of_wheel=True
    ),
    ChannelDefinition("vertical_load", (Quantity.FORCE,), Use.INPUT, "w", required=True, of_wheel=True),
    ChannelDefinition("drawbar_pull", (Quantity.FORCE,), Use.OUTPUT, "dp", required=True, of_wheel=True),
    ChannelDefinition("driving_torque", (Quantity.MOMENT,), Use.OUTPUT, "t", required=True, of_wheel=True),
    ChannelDefinition("sinkage", (Quantity.LENGTH,), Use.OUTPUT, "z", of_wheel=True, possible=(0.0, 1.0)),
    ChannelDefinition("tyre_pressure", (Quantity.PRESSURE,), Use.EXTRA, of_wheel=True, possible=(5e3, 5e6)),
    ChannelDefinition("wheel_acceleration_x", (Quantity.ACCELERATION,), Use.EXTRA, of_wheel=True, possible=(0.0, 20.0)),
    ChannelDefinition("longitudinal_acceleration", (Quantity.ACCELERATION,), Use.EXTRA, possible=(0.0, 20.0)),
    ChannelDefinition("lateral_acceleration", (Quantity.ACCELERATION,), Use.EXTRA, possible=(0.0, 20.0)),
    ChannelDefinition("yaw_rate", (Quantity.ANGULAR_SPEED,), Use.EXTRA, possible=(0.0, 2.0)),
    ChannelDefinition("pitch", (Quantity.ANGLE,), Use.EXTRA, possible=(0.0, 0.7)),
    ChannelDefinition("steering_angle", (Quantity.ANGLE,), Use.EXTRA, possible=(0.0, 1.0)),
    ChannelDefinition("ground_speed_valid", (Quantity.RATIO,), Use.FLAG),
    ChannelDefinition("latitude", (Quantity.ANGLE,), Use.AID, in_degrees=True, possible=(0.0, 90.0)),
    ChannelDefinition("longitude", (Quantity.ANGLE,), Use.AID, in_degrees=True, possible=(0.0, 180.0)),
    ChannelDefinition("course", (Quantity.ANGLE,), Use.AID),
    ChannelDefinition("gnss_time", (Quantity.TIME,), Use.AID),
    ChannelDefinition("wheel_angle", (Quantity.ANGLE,), Use.AID, of_wheel=True),
    ChannelDefinition("brake", (Quantity.PRESSURE, Quantity.RATIO), Use.AID),
    ChannelDefinition("slip", (Quantity.RATIO,), Use.AID, of_wheel=True),
    ChannelDefinition("transducer_status", (Quantity.RATIO,), Use.FLAG, of_wheel=True),
)
"""Every channel. A wheel speed given as a speed is that of the rim: omega = v / r. A slip is a commanded one."""

ROLES = {channel.role: channel for channel in CHANNELS}
"""Every channel by its role. A command asks only for the roles it needs."""
INPUTS = {channel.key: channel for channel in CHANNELS if channel.use is Use.INPUT}
"""What a wheel-soil model is given, by key."""
OUTPUTS = {channel.key: channel for channel in CHANNELS if channel.use is Use.OUTPUT}
"""What a wheel-soil model predicts, by key."""
ON_TIME_BASE = tuple(channel for channel in CHANNELS if channel.on_time_base)
"""Channels of which a processed run has values and one-sigma."""
TRANSDUCER_ROLES = tuple(c.role for c in CHANNELS if c.quantities[0] in (Quantity.FORCE, Quantity.MOMENT))
"""What the wheel force transducer measures; its status and its zeros apply to these."""
REACTIONS = {key: channel for key, channel in OUTPUTS.items() if channel.role in TRANSDUCER_ROLES}
"""Outputs that the transducer measures, by key. At standstill on level ground with released brakes they are zero,
except for the part of the pull that the rut holds."""


@dataclass(frozen=True)
class Channel:
    """Samples of one signal as they were received; rate and gaps are the sender's.

    Attributes
    ----------
    name : str
        ``"Message.Signal"`` for a decoded signal, or the role it was given.
    unit : str
        Unit of `values` as the DBC writes it (``""`` where there is none).
    time_ns : int64 array, shape (n,)
        UTC nanoseconds, non-decreasing.
    values : float64 array, shape (n,)
        Physical values; NaN where the frame did not carry the signal.
    labels : mapping int -> str
        Value table of the DBC (raw value to name), empty where there is none.
    """

    name: str
    unit: str
    time_ns: IntArray
    values: FloatArray
    labels: dict[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.time_ns.shape != self.values.shape or self.values.ndim != 1:
            raise ValueError(
                f"channel {self.name!r}: time {self.time_ns.shape} and values {self.values.shape} "
                "must be equal 1-D shapes"
            )

    def __len__(self) -> int:
        return len(self.values)

    def to_frame(self) -> pd.DataFrame:
        """Return ``time_ns`` and the values as a frame; the unit is in ``attrs["units"]``.

        Returns
        -------
        pandas.DataFrame
            Shape (n, 2). A channel in the unit of its role is a column like ``drawbar_pull_n``, any other one has the
            name of its signal.
        """
        known = ROLES.get(self.name)
        name = known.field if known and known.unit == self.unit else self.name
        return data_frame({"time_ns": self.time_ns, name: self.values}, {"time_ns": "ns", name: self.unit})
