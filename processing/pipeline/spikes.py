"""Values that jump from their neighbours and back as nothing on wheels does.

The jump of a speed is more than what a vehicle, or a rim, gains and loses in between, and than a receiver's dead band
or one tooth of a ring. That of another channel is several times its usual size, as much as the force of a wheel that
hops at 12 Hz changes: less where samples are close, or where no shock acts, more where something is shaken. It is
also far above the noise, alone among its neighbours (but for one other spike), and not in another force at the same
time: that is a shock, as long as its impulse throws the wheel up at some m/s only. Equal values in a row are one: a
receiver repeats them.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np

from daq import TRANSDUCER_ROLES, BoolArray, IntArray
from processing.options import SLIP_ROLES
from processing.pipeline.sensor_faults import IMPOSSIBLE_MPS2, Series, held_values, usual_step_s

_POSSIBLE = {
    "ground_speed": (1.5, IMPOSSIBLE_MPS2, inf),
    "wheel_speed": (1.5, 50.0, inf),
    **dict.fromkeys(TRANSDUCER_ROLES, (0.75, 75.0, 4.0)),
    **dict.fromkeys(("wheel_acceleration_x", "longitudinal_acceleration"), (4.0, 0.0, 4.0)),
}
_POSSIBLE_OF_OTHERS = 0.75, 10.0, 4.0
"""Jump that is possible at once, per second and at the most: of speeds in m/s, else in usual sizes."""
_NOISE_SHARE, _ABOVE_NOISE, _SIZE_SHARE, _LOOK = 0.9, 6.0, 0.98, 1 << 12
_LEAST_VALUES, _MOST_SPIKES, _AROUND, _ABOVE_NEAR = 30, 0.03, 3, 4.0
_SHOCK_S, _AT_ONCE_NS = 0.1, 10_000_000


def spikes(series: Mapping[str, Series], radius_m: float) -> dict[str, BoolArray]:
    """Find the spikes of each channel, shape (n,); none of them is empty."""
    jumps = {role: _jumps(role, samples, radius_m) for role, samples in series.items()}
    found = {role: jump > 0 for role, jump in jumps.items()}
    for role in (name for name in TRANSDUCER_ROLES if name in series and found[name].any()):
        others = [series[name][0][jumps[name] > 0] for name in TRANSDUCER_ROLES if name in series and name != role]
        at_ns = np.sort(np.concatenate([np.zeros(0, np.int64), *others]))
        first, last = np.searchsorted(at_ns, series[role][0] + np.array([[-_AT_ONCE_NS], [_AT_ONCE_NS]]))
        found[role] &= (jumps[role] > 1) | (first == last)
    return found


def _jumps(role: str, series: Series, radius_m: float) -> IntArray:
    """Return 1 where a channel jumps and comes back, 2 where no shock jumps so far, else 0; shape (n,)."""
    held, raw = held_values(series), series[1]
    values = raw[held.start]
    before, after = np.roll(values, 1), np.roll(values, -1)
    height = np.maximum(values - np.maximum(before, after), np.minimum(before, after) - values)
    height[[0, -1]] = 0.0
    if len(raw) < _LEAST_VALUES or height.max() <= 0:
        return np.zeros(len(raw), np.int64)
    usual_s = max(usual_step_s(np.diff(series[0]) * 1e-9), 1e-9)
    step_s = np.maximum(usual_s, np.maximum(held.until_s, np.roll(held.until_s - held.between_s, 1)))
    size = float(np.quantile(np.abs(values[:: max(1, len(values) // _LOOK)]), _SIZE_SHARE))
    least, per_s, most = _POSSIBLE.get(role, _POSSIBLE_OF_OTHERS)
    possible = {"ground_speed": 1.0, "wheel_speed": 1 / radius_m}.get(role, size) * np.clip(per_s * step_s, least, most)
    looked = raw if role in SLIP_ROLES else values
    middle = np.arange(1, len(looked) - 1, max(1, len(looked) // _LOOK))
    noise = np.quantile(np.abs(looked[middle] - (looked[middle - 1] + looked[middle + 1]) / 2), _NOISE_SHARE)
    found = height > np.maximum(possible, _ABOVE_NOISE * noise)
    found &= (values != 0) | (role != "ground_speed")  # a drop has its own rule
    for k in np.flatnonzero(found):
        around = np.append(raw[max(held.start[k] - _AROUND, 0) : held.start[k] + 1], raw[held.stop[k] :][:_AROUND])
        apart = np.abs(around - np.median(around))
        found[k] = abs(values[k] - np.median(around)) > _ABOVE_NEAR * np.sort(apart)[-3]
    found &= held.count[found].sum() <= _MOST_SPIKES * len(raw)
    return np.repeat(found * (1 + (height > size * _SHOCK_S / usual_s)), held.count)
