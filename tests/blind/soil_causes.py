"""Physical causes, in the engine's formula or in another of the literature's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from blind.driving import GRAVITY_MPS2
from blind.ground import UNIT_WEIGHT_N_M3, Ground
from blind.hooks import Hidden, also, at_hub, braking_part, driving_part, sinks, softer
from blind.rim import Column, janosi
from blind.wheel import Moments, Physics

from daq import FloatArray


def _ding(physics: Physics, n1: float) -> Physics:
    before = physics.ground
    return also(
        physics,
        ground=lambda soil, m: replace(
            changed := before(soil, m), exponent=changed.exponent + n1 * driving_part(physics.slip(m))
        ),
    )


def _mirror_of_shear(q: float) -> Callable[[FloatArray, Column], FloatArray]:
    return lambda j, modulus: janosi(j, modulus) * (1 - q * -np.expm1(-np.abs(j) / 0.15))


def hump_shear(q: float, rest: float = 0.5) -> Callable[[FloatArray, Column], FloatArray]:
    """Between Janosi and the hump of Wong and Oida (its residual share, peak at K_w = 2 K)."""
    e = np.exp(1.0)

    def shear(j: FloatArray, modulus: Column) -> FloatArray:
        x = np.abs(j) / (2 * np.asarray(modulus))
        hump = rest * (1 + (1 / (rest * (1 - 1 / e)) - 1) * np.exp(1 - x)) * -np.expm1(-x)
        return (1 - q) * janosi(j, modulus) + q * np.sign(j) * hump

    return shear


def passive_earth(m: Moments, z: FloatArray, soil: Ground) -> FloatArray:
    """Rankine's passive earth pressure on the sunk face, N."""
    tan = np.asarray(soil.friction)
    sin = tan / np.sqrt(1 + tan**2)
    kp = (1 + sin) / (1 - sin)
    push = UNIT_WEIGHT_N_M3 * z**2 * kp / 2 + 2 * np.asarray(soil.cohesion) * np.sqrt(kp) * z
    return m.vehicle.width_m * push * m.rolls


def _hegedus(m: Moments, z: FloatArray, soil: Ground) -> FloatArray:
    """Hegedus' bulldozing resistance of a blade at the angle of approach, N."""
    tan = np.asarray(soil.friction)
    phi = np.arctan(tan)
    z = np.maximum(z, 1e-6)
    approach = np.arccos(1 - np.minimum(z / m.vehicle.radius_m, 0.97))
    lift = z / np.tan(np.pi / 4 - phi / 2)
    push = np.sin(approach + phi) / (2 * np.sin(approach) * np.cos(phi))
    return m.vehicle.width_m * push * (2 * z * soil.cohesion + UNIT_WEIGHT_N_M3 * z * lift) * m.rolls


PHYSICAL = (
    Hidden(
        "vasilev",
        "slip_sinkage",
        "H_m",
        0.03,
        (0, 0.3),
        "Z = Z0 + H s, load-consistent",
        sinks(lambda z, s, H: z + H * driving_part(s)),
        length=True,
    ),
    Hidden(
        "lyasko",
        "slip_sinkage",
        "p",
        0.2,
        (0, 1.5),
        "Z = Z0 (1 + m1 s)/(1 - m2 s), m1 = 2 m2, p = m1 + m2",
        sinks(lambda z, s, p: z * (1 + 2 / 3 * p * driving_part(s)) / (1 - min(p, 1.5) / 3 * driving_part(s))),
    ),
    Hidden("ding", "slip_sinkage", "n1", 0.15, (0, 1.5), "N = n + n1 s in the stress law, Z from the balance", _ding),
    Hidden(
        "saturating_sinkage",
        "slip_sinkage",
        "",
        0.03,
        (0, 0.3),
        "Z = Z0 + H (1 - exp(-s/.35))/(1 - exp(-1/.35))",
        sinks(lambda z, s, H: z + H * np.expm1(-driving_part(s) / 0.35) / np.expm1(-1 / 0.35)),
        length=True,
        variant=True,
    ),
    Hidden(
        "skid_sinkage",
        "skid_sinkage",
        "H2_m",
        0.2,
        (0, 0.75),
        "Z = Z0 + H2 s_b^2",
        sinks(lambda z, s, H: z + H * braking_part(s) ** 2),
        length=True,
    ),
    Hidden(
        "skid_hyperbola",
        "skid_sinkage",
        "",
        0.3,
        (0, 1.5),
        "Z = Z0 (1 + m |s_b|)/(1 - m |s_b|)",
        sinks(lambda z, s, m: z * (1 + m * braking_part(s)) / (1 - min(m, 1.5) * braking_part(s))),
        variant=True,
    ),
    Hidden(
        "stress_peak_shift",
        "stress_peak_shift",
        "",
        0.2,
        (0, 0.85),
        "theta_m = (a + a s) theta_1, s > 0",
        lambda physics, a: also(physics, peak=lambda s: np.minimum(a + a * driving_part(s), 0.9)),
    ),
    Hidden(
        "peak_at_rest",
        "stress_peak_shift",
        "c1",
        0.2,
        (0, 0.85),
        "theta_m = c1 theta_1",
        lambda physics, a: also(physics, peak=lambda s: a),
    ),
    Hidden(
        "peak_with_slip",
        "stress_peak_shift",
        "c2",
        0.3,
        (0, 0.85),
        "theta_m = c2 s theta_1, s > 0",
        lambda physics, a: also(physics, peak=lambda s: a * driving_part(s)),
    ),
    Hidden(
        "interface_friction",
        "interface_friction",
        "ln_mu",
        -0.3,
        (-1.2, 0),
        "tan delta = mu tan phi",
        lambda physics, x: also(physics, interface=float(np.exp(x))),
    ),
    Hidden(
        "bulldozing",
        "bulldozing",
        "fraction",
        0.1,
        (0, 1.5),
        "Dp -= a b (gamma Z^2 Kp/2 + 2 c sqrt(Kp) Z)",
        at_hub(lambda m, z, soil, a: (-a * passive_earth(m, z, soil), 0.0)),
    ),
    Hidden(
        "hegedus",
        "bulldozing",
        "",
        0.1,
        (0, 1.5),
        "Hegedus' blade at the angle of approach, a share of it",
        at_hub(lambda m, z, soil, a: (-a * _hegedus(m, z, soil), 0.0)),
        variant=True,
    ),
    Hidden(
        "exit_angle",
        "exit_angle",
        "lambda",
        0.05,
        (0, 0.6),
        "theta_2 = -acos(1 - lambda Z/r), theta_m = 0",
        lambda physics, x: also(physics, exit_share=x),
    ),
    Hidden(
        "constant_exit",
        "exit_angle",
        "",
        0.15,
        (0, 0.6),
        "theta_2 constant",
        lambda physics, x: also(physics, exit_angle=lambda s: -x),
        variant=True,
    ),
    Hidden(
        "rate_stiffness",
        "rate_stiffness",
        "exponent",
        0.1,
        (0, 0.8),
        "k (max(V, .2)/2 m/s)^m",
        softer(lambda m, x: (np.maximum(m.speed, 0.2) / 2) ** x),
    ),
    Hidden(
        "rate_logarithm",
        "rate_stiffness",
        "",
        0.1,
        (0, 0.4),
        "k (1 + m ln(V/2 m/s))",
        softer(lambda m, x: np.maximum(1 + x * np.log(np.maximum(m.speed, 0.2) / 2), 0.1)),
        variant=True,
    ),
    Hidden(
        "multi_pass",
        "multi_pass",
        "per_pass",
        0.15,
        (-0.28, 2),
        "k (1 + a)^(log2 pass)",
        softer(lambda m, a: (1 + a) ** np.log2(m.passes)),
        both=True,
    ),
    Hidden(
        "saturating_passes",
        "multi_pass",
        "",
        0.3,
        (0, 3),
        "k (1 + a (1 - exp(-(pass - 1)/.8)))",
        softer(lambda m, a: 1 - a * np.expm1(-(m.passes - 1) / 0.8)),
        variant=True,
    ),
    Hidden(
        "track_drift",
        "track_drift",
        "log_stiffness_half_span",
        0.15,
        (-1, 1),
        "k exp(a x), x on -1..1",
        softer(lambda m, a: np.exp(a * m.line)),
        both=True,
    ),
    Hidden(
        "track_linear",
        "track_drift",
        "",
        0.15,
        (-0.8, 0.8),
        "k (1 + a x)",
        softer(lambda m, a: 1 + a * m.line),
        both=True,
        variant=True,
    ),
    Hidden(
        "shear_softening",
        "shear_softening",
        "fraction",
        0.2,
        (0, 0.9),
        "tau (1 - q (1 - exp(-|j|/.15 m)))",
        lambda physics, q: also(physics, shear=_mirror_of_shear(q)),
    ),
    Hidden(
        "hump",
        "shear_softening",
        "",
        0.2,
        (0, 1),
        "between Janosi and Wong-Oida's hump, residual .5",
        lambda physics, q: also(physics, shear=hump_shear(q)),
        variant=True,
    ),
    Hidden(
        "grouser",
        "grouser",
        "height_m",
        0.02,
        (0, 0.12),
        "shear radius and arm r + h",
        lambda physics, h: also(physics, lug=h, lug_arm=h),
        length=True,
    ),
    Hidden(
        "half_grouser",
        "grouser",
        "",
        0.03,
        (0, 0.16),
        "shear radius and arm r + h/2",
        lambda physics, h: also(physics, lug=0.5 * h, lug_arm=0.5 * h),
        length=True,
        variant=True,
    ),
    Hidden(
        "tyre_flattening",
        "tyre_flattening",
        "radius_gain",
        0.1,
        (0, 0.6),
        "contact radius r (1 + a W/10 kN 340 kPa/p)",
        lambda physics, a: also(
            physics, radius=lambda m: m.vehicle.radius_m * (1 + a * m.load / 1e4 * 340 / m.inflation)
        ),
    ),
    Hidden(
        "tyre_root",
        "tyre_flattening",
        "",
        0.1,
        (0, 0.6),
        "contact radius r (1 + a sqrt(W/10 kN 340 kPa/p))",
        lambda physics, a: also(
            physics, radius=lambda m: m.vehicle.radius_m * (1 + a * np.sqrt(m.load / 1e4 * 340 / m.inflation))
        ),
        variant=True,
    ),
    Hidden(
        "slope",
        "slope",
        "angle_rad",
        0.1,
        (-0.28, 0.28),
        "Dp -= direction m_o g sin a",
        at_hub(lambda m, z, soil, a: (-m.direction * m.vehicle.outboard_kg * GRAVITY_MPS2 * np.sin(a), 0.0)),
        both=True,
    ),
    Hidden(
        "wheel_inertia",
        "wheel_inertia",
        "scale",
        1.0,
        (0, 8),
        "Dp -= q 75 kg dV/dt, T += q 8 kg m2 domega/dt",
        at_hub(lambda m, z, soil, q: (-q * 75 * m.acceleration, q * 8 * m.alpha)),
    ),
)
