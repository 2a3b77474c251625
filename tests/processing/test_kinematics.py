import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from processing import Segment
from processing.pipeline import runs_of, slip_of
from processing.pipeline.assembly import standstills
from processing.pipeline.kinematics import segment, slip_sigma

speed = st.floats(0.0, 30.0)
sigma = st.floats(1e-3, 0.1)


def _slip(rim: float, ground: float, least: float = 0.5) -> float:
    return float(slip_of(np.array([rim]), np.array([ground]), least)[0])


@given(speed, speed)
def test_exchanging_the_speeds_changes_the_sign_only(rim: float, ground: float) -> None:
    np.testing.assert_array_equal(_slip(rim, ground), 0.0 - _slip(ground, rim))


@given(speed, speed)
def test_slip_stays_within_one_and_has_the_sign_of_the_difference(rim: float, ground: float) -> None:
    slip = _slip(rim, ground)
    if max(rim, ground) < 0.5:
        assert np.isnan(slip)
    else:
        assert -1 <= slip <= 1
        assert np.sign(slip) == np.sign(rim - ground)


def test_the_definitions_of_driving_and_braking() -> None:
    assert _slip(2.0, 1.0) == 0.5  # Eq. 6
    assert _slip(1.0, 2.0) == -0.5  # (r omega - V)/V
    assert _slip(3.0, 0.0) == 1.0  # spinning on the spot
    assert _slip(0.0, 3.0) == -1.0  # locked


@given(st.floats(0.6, 10.0), st.floats(0.6, 10.0), sigma, sigma)
def test_sigma_is_the_first_order_propagation(rim: float, ground: float, rim_sigma: float, ground_sigma: float) -> None:
    step = 1e-5
    by_rim = (_slip(rim + step, ground) - _slip(rim - step, ground)) / (2 * step)
    by_ground = (_slip(rim, ground + step) - _slip(rim, ground - step)) / (2 * step)
    expected = np.hypot(by_rim * rim_sigma, by_ground * ground_sigma)
    arrays = [np.array([value]) for value in (rim, ground, rim_sigma, ground_sigma)]
    if abs(rim - ground) > 2 * step:
        np.testing.assert_allclose(slip_sigma(*arrays, 0.5)[0], expected, rtol=1e-3)


def test_sigma_agrees_with_drawn_noise() -> None:
    rng = np.random.default_rng(1)
    rim, ground = 3.0 + 0.02 * rng.standard_normal(40_000), 2.0 + 0.03 * rng.standard_normal(40_000)
    one = np.ones(1)
    expected = slip_sigma(3.0 * one, 2.0 * one, 0.02 * one, 0.03 * one, 0.5)[0]
    np.testing.assert_allclose(np.std(slip_of(rim, ground, 0.5)), expected, rtol=0.02)


def test_no_slip_without_speed_and_none_without_a_value() -> None:
    values = slip_of(np.array([0.1, np.nan, 2.0]), np.array([0.2, 1.0, np.nan]), 0.5)
    assert np.isnan(values).all()


RATE = 100.0
NOTHING = np.full(3000, np.nan)


def _cycle() -> dict[str, np.ndarray]:
    """Return 30 s: stand, drive, coast, brake, stand."""
    time = np.arange(3000) / RATE
    speed = np.interp(time, [0, 5, 12, 18, 24, 30], [0, 0, 4, 3.5, 0, 0])
    force = np.select([time < 5, time < 12, time < 18, time < 24], [0.0, 900.0, 20.0, -1500.0], 0.0)
    return {"time": time, "speed": speed, "acceleration": np.gradient(speed, time), "force": force}


def _share(kind: np.ndarray, cycle: dict[str, np.ndarray], low: float, high: float, expected: Segment) -> float:
    inside = (cycle["time"] > low) & (cycle["time"] < high)
    return float(np.mean(kind[inside] == expected))


def test_torque_tells_drive_coast_and_brake() -> None:
    c = _cycle()
    load = np.full(3000, 8000.0)
    kind = segment(c["speed"], c["speed"], c["acceleration"], NOTHING, c["force"], load, RATE)
    expected = [
        (0, 5.2, Segment.STANDSTILL),
        (5.6, 11.9, Segment.DRIVE),
        (12.4, 17.9, Segment.COAST),
        (18.1, 23.6, Segment.BRAKE),
        (24.2, 30, Segment.STANDSTILL),
    ]
    for low, high, which in expected:
        assert _share(kind, c, low, high, which) == 1.0, which


def test_without_torque_acceleration_tells() -> None:
    c = _cycle()
    kind = segment(c["speed"], c["speed"], c["acceleration"], np.zeros(3000), NOTHING, NOTHING, RATE)
    for low, high, which in ((6, 11.9, Segment.DRIVE), (12.4, 17.9, Segment.COAST), (18.4, 23.6, Segment.BRAKE)):
        assert _share(kind, c, low, high, which) == 1.0, which


def test_a_wheel_that_spins_on_the_spot_does_not_stand() -> None:
    kind = segment(np.full(3000, 3.0), np.zeros(3000), np.zeros(3000), np.ones(3000), NOTHING, NOTHING, RATE)
    assert set(kind) == {Segment.DRIVE}


@given(st.integers(0, 2**32))
@settings(max_examples=25, deadline=None)
def test_noise_about_a_threshold_makes_no_short_pieces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    force = 240.0 + 100.0 * rng.standard_normal(3000)
    kind = segment(np.full(3000, 3.0), np.full(3000, 3.0), np.zeros(3000), NOTHING, force, np.full(3000, 8e3), RATE)
    lengths = np.diff(runs_of(kind), axis=1).ravel()
    assert lengths[1:].min(initial=3000) >= 30


@given(st.integers(0, 2**32))
@settings(max_examples=25, deadline=None)
def test_unknown_where_a_speed_is_missing_but_for_frames_lost_at_rest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    c = _cycle()
    rim, ground = c["speed"].copy(), c["speed"].copy()
    for speeds in (rim, ground):
        start = int(rng.integers(0, 2900))
        speeds[start : start + int(rng.integers(1, 400))] = np.nan
    kind = segment(rim, ground, c["acceleration"], NOTHING, c["force"], np.full(3000, 8e3), RATE)
    unknown = np.isnan(rim) | np.isnan(ground)
    assert unknown[kind == Segment.UNKNOWN].all()
    assert (kind[unknown & (kind != Segment.UNKNOWN)] == Segment.STANDSTILL).all()
    for start, stop in runs_of(unknown):
        if unknown[start] and stop - start >= 0.5 * RATE:
            assert (kind[start:stop] == Segment.UNKNOWN).all()


def test_frames_lost_at_random_do_not_end_a_standstill() -> None:
    c = _cycle()
    lost = c["speed"].copy()
    lost[np.random.default_rng(0).random(3000) < 0.02] = np.nan
    one, other = (
        segment(x, c["speed"], c["acceleration"], NOTHING, c["force"], np.full(3000, 8e3), RATE)
        for x in (c["speed"], lost)
    )
    at_rest = one == Segment.STANDSTILL
    assert at_rest.any() and (other[at_rest] == Segment.STANDSTILL).all()


def test_runs_of_labels() -> None:
    np.testing.assert_array_equal(runs_of(np.array([1, 1, 2, 1], np.uint8)), [[0, 2], [2, 3], [3, 4]])
    assert runs_of(np.zeros(0, np.uint8)).shape == (0, 2)


def test_zeros_are_read_at_standstill_and_their_sigma_covers_the_truth() -> None:
    c = _cycle()
    kind = segment(c["speed"], c["speed"], c["acceleration"], NOTHING, c["force"], np.full(3000, 8e3), RATE)
    rng = np.random.default_rng(3)
    independent = np.interp(np.arange(3000), np.arange(0, 3000, 10), rng.standard_normal(300))
    pull = 37.0 + 40.0 * independent
    found = standstills(c["time"], kind, {"drawbar_pull": pull, "driving_torque": NOTHING}, 4.0)
    assert len(found) == 2
    for standing in found:
        assert set(standing.levels) == {"drawbar_pull"}
        assert abs(standing.levels["drawbar_pull"] - 37.0) < 4 * standing.sigmas["drawbar_pull"] < 60
