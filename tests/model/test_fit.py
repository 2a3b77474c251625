"""The fit: recovery, intervals, what cannot be separated, and bad data. The truth has another quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from daq import ConfigError, DataError
from model import FitCode
from model.effects import EFFECTS
from model.fit import FitOptions, Observations, fit_observations
from model.fit.fit import _tempering, judge_alike
from model.fit.intervals import blocks_of, correlation_time, sandwich
from model.wheel_soil import SOILS, Conditions, Quadrature, Wheel, WheelSoilModel, prior_of
from wheelsoil.wording.notes import texts_of

WHEEL = Wheel(0.47, 0.318)
TRUTH = {"vasilev": {"H_m": 0.02}, "lyasko": {"m1": 0.1, "m2": 0.05}, "ding": {"n1": 0.35}, "wong": {}}
TRUTH["stress_peak_shift"] = {"stress_peak_shift.c1": 0.18, "stress_peak_shift.c2": 0.32}


def coloured(rng: np.random.Generator, n: int, sigma: float, tau_s: float, dt: float = 0.02) -> np.ndarray:
    a = np.exp(-dt / tau_s)
    white = rng.normal(size=n + 500) * sigma * np.sqrt(1 - a * a)
    return lfilter([1.0], [1.0, -a], white)[500:]


def measured(seed: int, law: str, *, noise: float = 1.0, reading: str = "balanced", soil: str = "clay") -> Observations:
    """Return two noisy 40 s runs at 50 Hz, filtered at 8 Hz, with slip that is itself measured."""
    rng = np.random.default_rng(seed)
    effects = () if law == "wong" else (EFFECTS[law],)
    model = WheelSoilModel(WHEEL, SOILS[soil], effects, reading, Quadrature(40, 4))
    sos = butter(2, 8, fs=50, output="sos")
    n, parts = 2000, []
    for run in range(2):
        t = np.arange(n) * 0.02
        slip = np.clip(0.3 + 0.55 * np.sin(2 * np.pi * t / 13.3 + rng.uniform(0, 6)), -0.4, 0.9)
        speed = np.maximum(1.5 + np.sin(2 * np.pi * t / 13.3 + 1), 0.5)
        load = 8000 + 1500 * run + coloured(rng, n, 300, 0.3)
        rim = speed / np.where(slip > 0, 1 - slip, 1 / (1 + slip))
        true = model.predict(Conditions(slip, load), TRUTH[law])
        speed_m = sosfiltfilt(sos, speed + noise * (coloured(rng, n, 0.035, 0.5) + rng.normal(size=n) * 0.02))
        rim_m = sosfiltfilt(sos, rim)
        part = {
            "slip": np.where(rim_m > speed_m, 1 - speed_m / rim_m, rim_m / speed_m - 1),
            "slip_sigma": noise * np.where(rim_m > speed_m, 0.037 / rim_m, 0.037 * rim_m / speed_m**2),
            "vertical_load_n": sosfiltfilt(sos, load + noise * coloured(rng, n, 60, 0.1)),
            "vertical_load_sigma_n": np.full(n, 50.0 * noise),
            "drawbar_pull_n": sosfiltfilt(sos, true.drawbar_pull_n + noise * coloured(rng, n, 46, 0.1)),
            "driving_torque_nm": sosfiltfilt(sos, true.driving_torque_nm + noise * coloured(rng, n, 14, 0.1)),
            "sinkage_m": np.full(n, np.nan),
            "time_s": t,
            "run": np.full(n, run),
        }
        parts.append({k: v[::2] for k, v in part.items()})
    return Observations(**{k: np.concatenate([p[k] for p in parts]) for k in parts[0]}, names=("a", "b"))


def test_fitted_parameters_are_drawn_with_their_correlation() -> None:
    data, channels = measured(0, "stress_peak_shift"), ("dp", "t")
    options = FitOptions(channels=channels, models=("wong",), chosen=("stress_peak_shift",))
    fit = next(one for one in fit_observations(data, WHEEL, SOILS["clay"], options).models if one.correlation)
    names, found = list(fit.normal.units), fit.normal.covariance
    sizes = {pair: size for pair, size in fit.correlation.items() if pair[0] != pair[1] and set(pair) <= set(names)}
    assert any(abs(size) > 0.1 for size in sizes.values())
    for pair, size in sizes.items():
        first, second = (names.index(name) for name in pair)
        assert found[first, second] == pytest.approx(size * np.sqrt(found[first, first] * found[second, second]))


@pytest.mark.parametrize("reading", ["balanced", "literal"])
@pytest.mark.parametrize("law", ["vasilev", "lyasko", "ding"])
def test_truth_is_found_without_noise(law: str, reading: str) -> None:
    # the filter still smooths a nonlinear curve, so that not even noise-free data lie on it exactly
    fit = fit_observations(
        measured(0, law, noise=1e-6, reading=reading), WHEEL, SOILS["clay"], FitOptions(reading, models=(law,))
    ).models[0]
    expected = sum(TRUTH[law].values())
    name = "p" if law == "lyasko" else next(iter(TRUTH[law]))
    assert fit.estimate(name).value == pytest.approx(expected, rel=0.03)
    assert fit.criteria["dp"].R2 > 0.999


@pytest.mark.slow
def test_intervals_contain_the_truth_about_as_often_as_they_say() -> None:
    """A quick look; the measurement is in test_recovery.py (slow)."""
    law, name, hits = "vasilev", "H_m", 0
    truth = TRUTH[law][name]
    for seed in range(20):
        low, high = (
            fit_observations(measured(seed, law), WHEEL, SOILS["clay"], FitOptions(models=(law,)))
            .models[0]
            .estimate(name)
            .interval
        )
        hits += low <= truth <= high
    assert hits >= 16  # of 20 at 0.95: fewer has a chance of 0.0003


def test_wheels_of_one_drive_do_not_count_as_independent() -> None:
    """A second wheel that measures exactly what the first does tells nothing: as a drive of its own it would."""
    one = measured(0, "vasilev")
    both = {n: np.concatenate([v, v]) for n, v in vars(one).items() if isinstance(v, np.ndarray)}
    both["run"] = np.concatenate([one.run, one.run + 2])
    apart = Observations(**both, names=("a", "b", "c", "d"))
    options = FitOptions(models=("vasilev",))
    alone, together, wrong = (
        fit_observations(data, WHEEL, SOILS["clay"], options).models[0].estimate("H_m")
        for data in (one, replace(apart, drives=(5, 7, 5, 7)), apart)
    )
    assert together.value == pytest.approx(alone.value, rel=1e-3)
    assert together.sigma == pytest.approx(alone.sigma, rel=0.02)
    assert wrong.sigma < 0.8 * alone.sigma


def test_a_wheel_that_lost_samples_shares_the_blocks_of_the_others_all_the_same() -> None:
    """What wheels measure at one time is in one block, though one of them has fewer samples before."""
    time_s = np.arange(1000) * 0.04
    late = time_s[(time_s < 2) | (time_s > 5)]
    times, run = np.concatenate([time_s, late]), np.repeat([0, 1], [len(time_s), len(late)])
    noise = np.random.default_rng(0).standard_normal(1000)
    error = np.concatenate([noise, noise[np.isin(time_s, late)]])
    label = blocks_of(error, times, run, independent=False, drive=np.zeros(len(run), int)).label
    np.testing.assert_array_equal(label[run == 1], label[:1000][np.isin(time_s, late)])


def test_every_slip_sinkage_law_beats_wong_where_there_is_slip_sinkage() -> None:
    campaign = fit_observations(measured(1, "lyasko"), WHEEL, SOILS["clay"])
    r0 = {m.name: m.criteria["dp"].R0_N for m in campaign.models}
    assert all(r0["wong"] > 1.3 * r0[law] for law in ("vasilev", "lyasko", "ding")), r0
    assert campaign.slip_threshold == 0.2


def test_a_channel_that_was_not_fitted_and_gets_worse_is_reported() -> None:
    """Slip sinkage can stand for a stress peak that lies elsewhere, at the cost of the torque."""
    data, soil = measured(1, "stress_peak_shift", soil="sandy"), SOILS["sandy"]
    blind, seeing = (
        fit_observations(data, WHEEL, soil, FitOptions(channels=channels, models=("wong", "vasilev"))).model("vasilev")
        for channels in (("dp",), ("dp", "t"))
    )
    [note] = blind.worse
    assert note.code is FitCode.FOLLOWED_WORSE and note.values["channel"] == "t"
    assert note.values["R0"] == blind.criteria["t"].R0_N > 2 * note.values["R0_wong"]
    assert not seeing.worse
    true = fit_observations(measured(1, "lyasko"), WHEEL, SOILS["clay"], FitOptions(models=("wong", "lyasko")))
    assert not any(model.worse for model in true.models)


def test_m1_and_m2_are_said_to_be_inseparable_with_the_number() -> None:
    fit = fit_observations(measured(2, "lyasko"), WHEEL, SOILS["clay"], FitOptions(models=("lyasko",))).models[0]
    assert abs(fit.correlation["m1", "m2"]) > 0.99
    assert any("m1 and m2" in w and "-0.99" in w for w in texts_of(fit.warnings))
    p = fit.estimate("p")
    assert p.derived and p.interval[0] < p.value < p.interval[1]


def test_literal_reading_shows_the_load_it_carries() -> None:
    data = measured(3, "lyasko", reading="literal")
    literal = fit_observations(data, WHEEL, SOILS["clay"], FitOptions("literal", models=("lyasko",))).models[0]
    balanced = fit_observations(data, WHEEL, SOILS["clay"], FitOptions(models=("lyasko",))).models[0]
    assert 1.02 < literal.load_ratio.median < 1.3
    assert balanced.load_ratio.highest == pytest.approx(1.0, abs=1e-9)


def test_a_freed_soil_widens_the_interval_and_stays_near_the_laboratory() -> None:
    data = measured(4, "vasilev")
    fixed = fit_observations(data, WHEEL, SOILS["clay"], FitOptions(models=("vasilev",))).models[0]
    prior = prior_of(SOILS["clay"])
    options = FitOptions(models=("vasilev",), channels=("dp", "t"), soil_prior=prior)
    freed = fit_observations(data, WHEEL, SOILS["clay"], options).models[0]
    assert freed.estimate("H_m").sigma > fixed.estimate("H_m").sigma
    tan_phi = freed.estimate("tan_phi")
    assert abs(tan_phi.value - SOILS["clay"].tan_phi) < 3 * 0.06 * SOILS["clay"].tan_phi
    assert tan_phi.sigma <= 1.05 * 0.06 * SOILS["clay"].tan_phi
    stiffness = freed.estimate("frictional_modulus")  # five powers of ten larger than the others
    assert 0.01 < stiffness.sigma / stiffness.value < 0.105


@pytest.mark.parametrize("law", ["vasilev", "lyasko", "ding"])
def test_a_load_that_the_soil_hardly_carries_is_fitted_from_nearer_to_neutral(law: str) -> None:
    """With any slip sinkage at the usual start the axle would be under ground, where the model has no answer."""
    soil, slip = SOILS["sandy"], np.linspace(0.02, 0.9, 60)
    load, nothing, zero = np.full(60, 3.55e4), np.full(60, np.nan), np.zeros(60)
    truth = WheelSoilModel(WHEEL, soil, reading="literal", quadrature=Quadrature(40, 4))
    start = WheelSoilModel(WHEEL, soil, [EFFECTS[law]], "literal")
    usual = {p.name: p.start for p in EFFECTS[law].parameters}
    assert np.isnan(start.predict(Conditions(slip, load), usual).drawbar_pull_n).any()
    pull = truth.predict(Conditions(slip, load)).drawbar_pull_n - 30.0 * slip
    data = Observations(
        slip, load, pull, nothing, nothing, zero, zero, np.arange(60.0), np.zeros(60, int), ("a",), independent=True
    )
    fit = fit_observations(data, WHEEL, soil, FitOptions("literal", models=(law,))).models[0]
    assert fit.criteria["dp"].R0_N < 20 and fit.criteria["dp"].samples == 54


def test_a_sum_of_two_held_coefficients_has_no_interval() -> None:
    """Data that ask for a wheel that rises with slip drive m1 and m2 to their lower bounds."""
    data = measured(1, "wong")
    lifted = replace(data, drawbar_pull_n=data.drawbar_pull_n + 3000 * np.maximum(data.slip, 0.0))
    fit = fit_observations(lifted, WHEEL, SOILS["clay"], FitOptions(models=("lyasko",))).models[0]
    p = fit.estimate("p")
    assert (fit.stop_reason, p.value, p.at_bound) == ("at_bounds", -1.0, True)
    assert np.isnan([p.sigma, *p.interval]).all()


@pytest.mark.parametrize(
    "odd", [{"friction_angle_rad": 0.015}, {"cohesive_modulus": 243e3, "frictional_modulus": -1e5}]
)
def test_any_soil_that_a_terrain_file_may_hold_can_be_freed(odd: dict[str, float]) -> None:
    soil = replace(SOILS["clay"], **odd)
    options = FitOptions(models=("vasilev",), soil_prior=prior_of(soil))
    fit = fit_observations(measured(4, "vasilev"), WHEEL, soil, options).models[0]
    assert {"H_m", *(name for name in odd if name != "friction_angle_rad")} <= {e.name for e in fit.estimates}


def test_an_interval_does_not_depend_on_the_unit() -> None:
    rng = np.random.default_rng(8)
    n, unit = 600, np.array([1.0, 1e7])
    jacobian, error = rng.normal(size=(n, 1, 2)), rng.normal(size=n)
    blocks = blocks_of(error, np.arange(n) * 0.1, np.zeros(n, int), independent=False)
    found = []
    for scale in (np.ones(2), unit):
        j = jacobian * scale
        found.append(sandwich(j, j[:, 0] * error[:, None], blocks).covariance)
    np.testing.assert_allclose(found[0], found[1] * np.outer(unit, unit), rtol=1e-9)


def test_the_prior_counts_against_independent_samples() -> None:
    series, slow = measured(1, "wong"), blocks_of(np.zeros(4), np.arange(4.0), np.zeros(4, int), independent=True)
    times_s = np.array([np.nan, 1e-9, 4.0 * np.median(np.diff(series.time_s))])
    found = [_tempering(replace(slow, correlation_time_s=time_s), series) for time_s in times_s]
    assert found == pytest.approx([1.0, 1.0, 0.25])
    assert _tempering(replace(slow, correlation_time_s=9.0), replace(series, independent=True)) == 1.0


def test_correlation_time_of_a_first_order_process() -> None:
    rng = np.random.default_rng(5)
    n, tau = 100_000, 0.4
    x = coloured(rng, n, 1.0, tau)
    found = correlation_time(x, np.arange(n) * 0.02, np.zeros(n, int))
    assert found == pytest.approx(2 * tau, rel=0.15)  # integral of exp(-|t|/tau), cut where it falls below .05


def test_sandwich_of_a_mean_knows_the_correlation() -> None:
    """Variance of the mean of n correlated samples is about sigma^2 2 tau / (n dt), not sigma^2 / n."""
    variances, n = [], 4000
    for seed in range(40):
        x = coloured(np.random.default_rng(seed), n, 1.0, 0.2)
        blocks = blocks_of(x, np.arange(n) * 0.02, np.zeros(n, int), independent=False)
        found = sandwich(np.ones((n, 1, 1)), (x - x.mean())[:, None], blocks)
        variances.append(found.covariance[0, 0])
    assert np.mean(variances) == pytest.approx(2 * 0.2 / (n * 0.02), rel=0.2)


def test_sandwich_of_independent_rows_is_the_textbook_variance_and_degrees() -> None:
    rng = np.random.default_rng(7)
    n = 400
    x = rng.normal(size=n)
    blocks = blocks_of(x, np.zeros(n), np.zeros(n, int), independent=True)
    found = sandwich(np.ones((n, 1, 1)), (x - x.mean())[:, None], blocks)
    assert found.covariance[0, 0] == pytest.approx(np.var(x) / n, rel=0.01)
    assert found.degrees == pytest.approx(n - 1)


def test_models_are_judged_on_the_same_samples() -> None:
    """Where one law sinks to the axle, its rivals' easier samples would not count for them either."""
    data = measured(11, "lyasko")
    fits = fit_observations(data, WHEEL, SOILS["clay"], FitOptions(models=("wong", "vasilev"))).models
    counted = (data.slip >= 0.2) & (data.slip < 0.7)
    for without in (0, 1):
        predicted = [{c: data.measured(c) + 10.0 * (i + 1) for c in ("dp", "t")} for i in range(2)]
        predicted[without]["dp"][data.slip >= 0.7] = np.nan
        judged = judge_alike(fits, data, predicted, 0.2, 0.47)
        assert [m.criteria["dp"].samples for m in judged] == [counted.sum()] * 2
        np.testing.assert_allclose([m.criteria["dp"].R0_N for m in judged], [10.0, 20.0])


@pytest.mark.parametrize(("independent", "expected"), [(True, 50.0), (False, 20.0)])
def test_m0_is_of_each_row_of_a_table_and_of_the_curve_of_runs(independent: bool, expected: float) -> None:
    data = measured(11, "lyasko")
    fits = fit_observations(data, WHEEL, SOILS["clay"], FitOptions(models=("wong",))).models
    slip, pull = np.full(len(data), 0.5), np.full(len(data), 100.0)
    table = replace(data, slip=slip, drawbar_pull_n=pull, independent=independent)
    predicted = pull + np.where(np.arange(len(data)) % 2, 50.0, -10.0)
    (judged,) = judge_alike(fits, table, [{"dp": predicted, "t": data.driving_torque_nm}], 0.2, 0.47)
    assert judged.criteria["dp"].M0_percent == pytest.approx(expected, rel=0.02)


def test_a_bound_gives_a_limit_and_p_below_zero_is_flagged() -> None:
    """An offset that looks like the opposite of slip sinkage: no law may claim to explain it."""
    data = measured(9, "wong")
    campaign = fit_observations(
        replace(data, drawbar_pull_n=data.drawbar_pull_n + 80), WHEEL, SOILS["clay"], FitOptions()
    )
    for law, name in (("vasilev", "H_m"), ("ding", "n1")):
        held = campaign.model(law).estimate(name)
        assert held.at_bound and held.interval[0] == 0 and 0 < held.interval[1] < 0.5
        assert any("held by its bound 0" in w for w in texts_of(campaign.model(law).warnings))
    assert any("below 0" in w for w in texts_of(campaign.model("lyasko").warnings))


def test_what_one_slip_cannot_tell_is_infinite() -> None:
    data = measured(10, "lyasko")
    n = 12
    rows = replace(data[slice(0, n)], slip=np.full(n, 0.4), independent=True)
    fit = fit_observations(rows, WHEEL, SOILS["clay"], FitOptions(models=("lyasko",))).models[0]
    assert fit.estimate("m1").sigma > 1e3 and any("not determined singly" in w for w in texts_of(fit.warnings))


def test_bad_input_is_said_in_words() -> None:
    data = measured(6, "wong")
    soil = SOILS["clay"]
    with pytest.raises(DataError, match="too few driven samples"):
        fit_observations(data[data.slip < 0], WHEEL, soil)
    with pytest.raises(DataError, match="driving_torque_nm was not measured"):
        fit_observations(
            replace(data, driving_torque_nm=np.full(len(data), np.nan)), WHEEL, soil, FitOptions(channels=("t",))
        )
    with pytest.raises(ConfigError, match="does not resist"):
        fit_observations(data, WHEEL, replace(soil, cohesive_modulus=-2e5))
    with pytest.raises(ConfigError, match="lyasko"):
        fit_observations(data, WHEEL, soil, FitOptions(models=("liasko",)))
    with pytest.raises(DataError, match="above the axle"):
        fit_observations(replace(data, vertical_load_n=data.vertical_load_n * 1e3), WHEEL, soil)
    nothing = fit_observations(data, WHEEL, soil, FitOptions(slip_threshold=0.99)).models[0]
    reason = nothing.criteria["dp"].reason
    assert np.isnan(nothing.criteria["dp"].R0_N) and reason and reason.code == FitCode.NO_SLIP
