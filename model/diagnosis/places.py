"""Samples of runs of different length as one padded array, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.samples import Samples

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """Where each sample stands in an array of runs padded to one length; arrays of shape (n,)."""

    run: NDArray[np.intp]
    place: NDArray[np.intp]
    runs: int
    longest: int

    def padded(self, x: FloatArray, fill: float = 0.0) -> FloatArray:
        """Return (c, n, ...) as (runs, longest, c, ...)."""
        moved = np.moveaxis(x, 0, 1)
        out = np.full((self.runs, self.longest, *moved.shape[1:]), fill)
        out[self.run, self.place] = moved
        return out

    def flat(self, x: FloatArray) -> FloatArray:
        """Return (runs, longest, ...) as (n, ...)."""
        return np.asarray(x[self.run, self.place])


def places_of(samples: Samples) -> Places:
    """Return the places of a campaign's samples."""
    counts = np.bincount(samples.run, minlength=samples.runs)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]]) if samples.runs else np.zeros(0, np.intp)
    place = np.arange(len(samples)) - first[samples.run]
    return Places(samples.run, place, samples.runs, int(counts.max(initial=0)))


def steps_of(x: FloatArray, run: NDArray[np.intp]) -> FloatArray:
    """Return the step to each sample from the one before in its run; 0 for the first."""
    step = np.diff(x, prepend=x[:1])
    step[np.diff(run, prepend=-1) != 0] = 0.0
    return np.maximum(np.nan_to_num(step), 0.0)
