"""Channel: one signal's samples with their own time stamps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


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
    time_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    labels: dict[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.time_ns.shape != self.values.shape or self.values.ndim != 1:
            raise ValueError(
                f"channel {self.name!r}: time {self.time_ns.shape} and values {self.values.shape} "
                "must be equal 1-D shapes"
            )

    def __len__(self) -> int:
        return len(self.values)
