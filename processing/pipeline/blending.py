r"""Ground speed from a receiver, slow, and an accelerometer, quick: a complementary filter without delay.

With f the reading of the accelerometer, theta the pitch and G a Gaussian kernel under which a straight line is fitted,

.. math:: \hat V = s + G * (V - s), \qquad s = \int (f - g \sin\theta) \, dt .

Below the corner of G the speed is the receiver's, above it the accelerometer's. A zero b of the accelerometer makes a
ramp b t of s, which the line takes out whole, so that none has to be learnt at standstill; a slow drift is as harmless.
The kernel is short: what a receiver does wrong slowly (its gain, a slow filter) stays as the models of these errors
have it, and pitch need not be good to a tenth of a degree. A delay tau of the receiver that is not declared stays
whole: what the kernel takes out of V - s is then -tau (f' - G * f'), with f' = f - g sin(theta); s is delayed alike.

Of the noise of the receiver the white part w falls with the bandwidth, slow noise stays; the accelerometer's, sigma_a
with that of g theta, comes through its integral. With k of the common filter and K of G:

.. math:: \sigma^2 = \max(\sigma_V^2 - 1.2 w^2, 0) + w^2 \frac{k}{\sqrt{k^2 + K^2}}
          + (\sqrt 2 - 1) \, 2 k K \sigma_a^2 .

The last term is the integral of 2 sqrt(pi) k sigma_a^2 (1 - G)^2 / (2 pi f)^2 over all f.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt

import numpy as np

from daq import BRIDGED_INTERVALS, STANDARD_GRAVITY_MPS2, FloatArray
from processing.pipeline.filters import WHITE_NOISE_MARGIN, Smoothed, smooth
from processing.pipeline.resampling import OnBase
from processing.processed_run import Reason
from processing.robust import robust_spread

BLEND_S = 0.3
"""Standard deviation of G."""
_LEAST_RATIO = 2.0
"""Of BLEND_S to the kernel of the common filter, below which nothing is gained."""
_NODES_S = BLEND_S / 6
_PASSES = 3
"""Of the delay: the second corrects the first's linearisation."""
_MOST_LATE_S = 0.5
_LEAST_CHANGE = 1e-6
"""(m/s2)^2: of a vehicle that stands."""


def blended(
    speed: OnBase, accelerometer: OnBase, pitch: OnBase, time_s: FloatArray, rate_hz: float, kernel_s: float
) -> OnBase:
    """Return the ground speed with what the accelerometer knows of its quick changes.

    Where one of the two others is not known the speed stays as it was, and its reason is theirs; where they never are
    known together, it is returned as it is. The three are m/s, m/s2 and rad on `time_s`, shape (n,); `kernel_s` is the
    standard deviation of the common filter's kernel.
    """
    if kernel_s * _LEAST_RATIO > BLEND_S:
        return speed
    moving = accelerometer.values - STANDARD_GRAVITY_MPS2 * np.sin(pitch.values)
    known = np.isfinite(moving) & np.isfinite(speed.values)
    nodes = np.flatnonzero(known)
    step = max(1, round(_NODES_S * rate_hz))
    nodes = nodes[nodes % step == 0]

    def slow_of(values: FloatArray) -> Smoothed:
        return smooth(time_s, time_s[nodes], values[nodes], BLEND_S, BRIDGED_INTERVALS * step / rate_hz)

    late_s = 0.0
    for _ in range(_PASSES):
        read = np.interp(time_s - late_s, time_s, np.where(known, moving, 0.0))
        quick = np.cumsum(read) / rate_hz
        slow = slow_of(speed.values - quick)
        both = slow.covered & known
        taken_out = (speed.values - quick - slow.values)[both]
        change = (read - slow_of(read).values)[both]
        late_s -= float(change @ taken_out) / max(float(change @ change), _LEAST_CHANGE)
        late_s = min(max(late_s, -_MOST_LATE_S), _MOST_LATE_S)
    if not both.any():
        return speed
    reason = speed.reason
    for other in (accelerometer, pitch):
        reason = np.where(reason == Reason.USED, other.reason, reason)
    reason = np.where((reason == Reason.USED) & ~both, np.uint8(Reason.FILTER_EDGE), reason)
    noise = hypot(accelerometer.facts.sigma, STANDARD_GRAVITY_MPS2 * pitch.facts.sigma)
    return OnBase(
        np.where(both, quick + slow.values, speed.values),
        np.where(both, read + slow.slope, speed.slope),
        reason,
        replace(speed.facts, sigma=_sigma(speed.facts.sigma, taken_out, noise, kernel_s)),
    )


def _sigma(speed_mps: float, taken_out_mps: FloatArray, acceleration_mps2: float, kernel_s: float) -> float:
    """Return the one-sigma of a blended sample; `taken_out_mps` is what the blending took out of the speed."""
    whole = kernel_s / hypot(kernel_s, BLEND_S)
    kept = 1.0 - 2.0 * kernel_s / hypot(kernel_s, BLEND_S / sqrt(2.0)) + whole
    white = min(robust_spread(taken_out_mps) ** 2 / kept, speed_mps**2)
    slow = max(speed_mps**2 - WHITE_NOISE_MARGIN * white, 0.0)
    return sqrt(slow + white * whole + (sqrt(2.0) - 1.0) * 2.0 * kernel_s * BLEND_S * acceleration_mps2**2)
