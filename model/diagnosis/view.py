"""One campaign as it is looked at, and the clock of the stages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.campaign import Campaign
from model.diagnosis.columns import Columns
from model.diagnosis.linearise import Linear, Simulation
from model.diagnosis.noise import Noise
from model.diagnosis.samples import Samples
from model.diagnosis.whitening import RunGrams

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """One campaign as it was looked at.

    Attributes
    ----------
    campaign : Campaign
    samples : Samples
        With the likeliest load, see `model.diagnosis.loads`.
    simulation : Simulation
    linear : Linear
        About the last point.
    columns : Columns
    noise : Noise
    grams : RunGrams
        Of this campaign alone.
    speed_variance : array, shape (n,)
        Of what is left of the ground speed's error about the point.
    """

    campaign: Campaign
    samples: Samples
    simulation: Simulation
    linear: Linear
    columns: Columns
    noise: Noise
    grams: RunGrams
    speed_variance: FloatArray


@dataclass
class Clock:
    """Seconds by stage."""

    stages_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside for a stage."""
        start = perf_counter()
        yield
        self.stages_s[name] = self.stages_s.get(name, 0.0) + perf_counter() - start
