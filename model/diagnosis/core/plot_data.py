"""Samples of a diagnosis for figures: measured, simulated, and what each candidate changes."""

from __future__ import annotations

from dataclasses import dataclass, field

from daq import FloatArray, IndexArray


@dataclass(frozen=True)
class WheelOrders:
    """How much a channel swings with the turning wheel, by order; arrays of shape (k,).

    Attributes
    ----------
    order : array
        Cycles a turn.
    swing : array
        Peak amplitude in the channel's unit (N, N m): root of the runs' mean square, weighted by their information.
        It holds the noise.
    by_chance : array
        What noise alone stays below at any one order in 95 of 100 campaigns.
    """

    order: FloatArray
    swing: FloatArray
    by_chance: FloatArray


@dataclass(frozen=True)
class PlotData:
    """Samples of a campaign or rows of a table, for figures; arrays of shape (n,).

    Attributes
    ----------
    runs : tuple of str
        Names; ``run`` indexes them.
    since_first_run_s, campaign_time : array
        Since the first run of the campaign began; the campaign's clock from -1/2 to 1/2. NaN for rows of tables.
    measured, base, extended : mapping channel -> array
        What was measured; what the simulation says with its re-calibrated soil; what the extended model says.
    base_sigma : mapping channel -> array
        One-sigma of measured less base by the noise model.
    signatures : mapping effect key -> mapping channel -> array
        What each candidate changes at its estimated size, less what the soil can imitate; of what would fit almost as
        well as a named cause, at its size in place of that.
    implied : mapping effect key -> mapping channel -> array
        What each candidate says as if it were the one, of channels that were not used too.
    unused_channels : tuple of str
        Channels that were measured and not used: nothing was chosen or fitted by them.
    wheel_orders : mapping channel -> WheelOrders
        Of the channels that are said to swing once a turn of the wheel.
    """

    campaign: str
    runs: tuple[str, ...]
    run: IndexArray
    time_s: FloatArray
    since_first_run_s: FloatArray
    campaign_time: FloatArray
    slip: FloatArray
    ground_speed_mps: FloatArray
    vertical_load_n: FloatArray
    line_position: FloatArray
    measured: dict[str, FloatArray]
    base: dict[str, FloatArray]
    extended: dict[str, FloatArray]
    base_sigma: dict[str, FloatArray]
    signatures: dict[str, dict[str, FloatArray]]
    implied: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    unused_channels: tuple[str, ...] = ()
    wheel_orders: dict[str, WheelOrders] = field(default_factory=dict)
