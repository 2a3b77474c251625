"""How far the noise of a campaign is from what the engine expects of noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from blind.ground import Patchiness
from blind.sensors import Suite

from daq.channels import Channel


@dataclass(frozen=True)
class World:
    """Noise of a campaign; the defaults are the study's own.

    Attributes
    ----------
    scatter : float
        Factor on how the soil varies, from run to run and within a run.
    length_m : float
        Correlation length of the soil within a run; 0: drawn.
    speed_memory_s : float
        Of the GNSS speed's error; 0: the receiver's.
    tails : float
        Degrees of freedom of Student's distribution that every noise has; 0: normal.
    lost : float
        Share of frames that are lost, one by one.
    """

    scatter: float = 1.0
    length_m: float = 0.0
    speed_memory_s: float = 0.0
    tails: float = 0.0
    lost: float = 0.0

    def ground(self, patchiness: Patchiness) -> Patchiness:
        """Return how the soil varies within a run."""
        length = self.length_m or patchiness.length_m
        return Patchiness(self.scatter * patchiness.stiffness, self.scatter * patchiness.friction, length)

    def instruments(self, suite: Suite) -> Suite:
        """Return the suite with this world's noise."""
        return replace(suite, speed_memory_s=self.speed_memory_s or suite.speed_memory_s, tails=self.tails)

    def received(self, channels: dict[str, Channel], rng: np.random.Generator) -> dict[str, Channel]:
        """Return the channels without the frames that are lost; channels of one frame are lost together."""
        if not self.lost:
            return channels
        kept: dict[bytes, np.ndarray] = {}
        out = {}
        for role, channel in channels.items():
            keep = kept.setdefault(channel.time_ns.tobytes(), rng.random(len(channel.time_ns)) >= self.lost)
            out[role] = Channel(channel.name, channel.unit, channel.time_ns[keep], channel.values[keep])
        return out


OWN = World()
BEYOND = World(scatter=2.0, length_m=12.0, speed_memory_s=4.0, tails=4.0, lost=0.02)
"""Outside the engine's beliefs: its priors are 2.5 % and 1.2 % of scatter, 3 m, 1 s, and normal noise."""
