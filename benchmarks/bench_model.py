"""The wheel-soil model: microseconds a sample, and a whole fit."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.table import Row, at_most, judged
from benchmarks.timing import median_cpu_seconds
from daq import RunInfo
from model.effects import EFFECTS
from model.fit import FitOptions, fit_models
from model.wheel_soil import (
    SOILS,
    Conditions,
    Patch,
    Quadrature,
    Wheel,
    WheelSoilModel,
    entry_angle,
    resultants,
    speed_ratio,
)
from processing import ProcessedRun, QualityReport, Segment

SAMPLES = 20_000
WHEEL = Wheel(0.47, 0.318)


def rows() -> list[Row]:
    """Measure the forward model in two modes and the fit of one 60 s run."""
    return [_given_sinkage(), _with_balance(), *_whole_fit()]


def _given_sinkage() -> Row:
    rng = np.random.default_rng(0)
    soil = SOILS["clay"]
    patch = Patch(
        entry_angle(rng.uniform(0.05, 0.2, (SAMPLES, 1)), WHEEL.radius_m),
        speed_ratio(rng.uniform(0, 1, (SAMPLES, 1))),
        WHEEL.radius_m,
        WHEEL.width_m,
        soil.cohesion_pa,
        soil.tan_phi,
        soil.shear_modulus_m,
        soil.stiffness(WHEEL.width_m),
        soil.sinkage_exponent,
    )
    exact = resultants(patch, Quadrature(48, 4))
    got = resultants(patch)
    error = max(
        float(np.max(np.abs(a - b) / exact.load())) for a, b in ((got.load(), exact.load()), (got.pull(), exact.pull()))
    )
    us = median_cpu_seconds(lambda: resultants(patch), 9) / SAMPLES * 1e6
    return _forward("sinkage given", us, error)


def _with_balance() -> Row:
    rng = np.random.default_rng(0)
    conditions = Conditions(rng.uniform(0, 0.95, SAMPLES), rng.uniform(6e3, 12e3, SAMPLES))
    model = WheelSoilModel(WHEEL, SOILS["clay"], (EFFECTS["lyasko"],))
    values = {"m1": 0.1, "m2": 0.05}
    got = model.predict(conditions, values)
    exact = WheelSoilModel(WHEEL, SOILS["clay"], (EFFECTS["lyasko"],), quadrature=Quadrature(48, 4)).predict(
        conditions, values
    )
    error = float(np.max(np.abs(got.drawbar_pull_n - exact.drawbar_pull_n) / conditions.vertical_load_n))
    us = median_cpu_seconds(lambda: model.predict(conditions, values), 9) / SAMPLES * 1e6
    return _forward("sinkage by the balance", us, error)


def _forward(what: str, us: float, error: float) -> Row:
    """Return the row of the forward model, whose quadrature is held against a finer one."""
    as_text = f"{us:.2f} us/sample, error {error:.0e} of W"
    return judged(f"forward model, driving, {what}", as_text, error, at_most(1e-6, "of W"), "48 nodes in 4 panels")


def _whole_fit() -> list[Row]:
    run = processed_run()
    found = []
    for label, options in (
        ("drawbar pull", FitOptions()),
        ("drawbar pull and torque", FitOptions(channels=("dp", "t"))),
    ):
        seconds = median_cpu_seconds(partial(fit_models, [run], WHEEL, SOILS["clay"], options))
        found.append(Row(f"fit of one 60 s run, four models, {label}", f"{seconds:.2f} s"))
    return found


def processed_run() -> ProcessedRun:
    """Return a noisy 60 s run at 100 Hz as processing leaves it."""
    n, rng = 6000, np.random.default_rng(1)
    time = np.arange(n) * 0.01
    slip = np.clip(0.3 + 0.55 * np.sin(2 * np.pi * time / 13), -0.4, 0.9)
    load = 8e3 + 400 * np.sin(2 * np.pi * time / 3)
    speed = 1.8 + np.sin(2 * np.pi * time / 13 + 1)
    model = WheelSoilModel(WHEEL, SOILS["clay"], (EFFECTS["lyasko"],), quadrature=Quadrature(32, 4))
    true = model.predict(Conditions(slip, load), {"m1": 0.1, "m2": 0.05})
    nan, zero = np.full(n, np.nan), np.zeros(n)
    return ProcessedRun(
        run=RunInfo(id="bench"),
        rate_hz=100.0,
        cutoff_hz=8.0,
        wheel_radius_m=WHEEL.radius_m,
        start_ns=0,
        time_s=time,
        slip=slip + rng.normal(size=n) * 0.005,
        slip_sigma=np.full(n, 0.005),
        ground_speed_mps=speed,
        ground_speed_sigma_mps=zero,
        wheel_speed_radps=speed / 0.47,
        wheel_speed_sigma_radps=zero,
        vertical_load_n=load,
        vertical_load_sigma_n=zero,
        drawbar_pull_n=true.drawbar_pull_n + rng.normal(size=n) * 40,
        drawbar_pull_sigma_n=zero,
        driving_torque_nm=true.driving_torque_nm + rng.normal(size=n) * 14,
        driving_torque_sigma_nm=zero,
        sinkage_m=nan,
        sinkage_sigma_m=nan,
        ground_acceleration_mps2=zero,
        wheel_acceleration_radps2=zero,
        distance_m=np.cumsum(speed) * 0.01,
        latitude_deg=nan,
        longitude_deg=nan,
        segment=np.where(slip > 0, Segment.DRIVE, Segment.BRAKE).astype(np.uint8),
        reason=np.zeros(n, np.uint8),
        quality=QualityReport(),
    )
