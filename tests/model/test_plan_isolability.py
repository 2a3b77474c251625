"""What runs can tell apart, against its definitions written out in full."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_grams import columns_of_runs, grams_of
from hypothesis import given, settings
from hypothesis import strategies as st

from model.diagnosis.findings.isolability import isolability
from model.diagnosis.findings.isolability import projected_without_soil as without_soil


def made(seed: int, alike: float = 0.0, soil_like: float = 0.0):
    """Return columns where "slope" looks like "vasilev", and "torque_zero" like the soil, as far as is asked for."""
    rng = np.random.default_rng(seed)
    columns = columns_of_runs(rng)
    columns[:, :, 5] = alike * columns[:, :, 3] + (1 - alike) * columns[:, :, 5]
    columns[:, :, 6] = soil_like * columns[:, :, 0] + (1 - soil_like) * columns[:, :, 6]
    return columns, grams_of(columns, rng.normal(size=columns.shape[:2]))


def full_projector(soil: np.ndarray) -> np.ndarray:
    return np.linalg.inv(np.eye(len(soil)) + soil @ soil.T)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31))
def test_projection_is_that_of_the_full_covariance(seed: int) -> None:
    columns, grams = made(seed)
    flat = columns.reshape(-1, columns.shape[2])
    projector = full_projector(flat[:, :3])
    np.testing.assert_allclose(without_soil(grams).information, flat[:, 3:7].T @ projector @ flat[:, 3:7], rtol=1e-8)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.3, 3.0))
def test_d_and_d_sep_follow_their_definitions(seed: int, size: float) -> None:
    columns, grams = made(seed)
    flat = columns.reshape(-1, columns.shape[2])
    projector = full_projector(flat[:, :3])
    found = isolability(grams, {"slope": [size]})
    delta = size * flat[:, 5]
    assert found.deviation[2] == pytest.approx(np.sqrt(delta @ projector @ delta), rel=1e-9)
    left = []
    for rival, one_sided in ((3, True), (4, True), (6, False)):
        x = flat[:, rival]
        for sign in (1.0, -1.0):
            b = sign * (x @ projector @ delta) / (x @ projector @ x)
            rest = sign * delta - (0.0 if one_sided and b < 0 else b) * x
            left.append(np.sqrt(rest @ projector @ rest))
    assert found.separation[2] == pytest.approx(min(left), rel=1e-9)


def test_a_look_alike_is_found_and_leaves_nothing() -> None:
    found = isolability(made(1, alike=0.98)[1])
    assert found.confounded() == (("slip_sinkage", "slope"),)
    assert found.separation[0] < 0.1 * found.deviation[0] and found.rivals[0] == "slope"
    assert not isolability(made(1)[1]).confounded()


def test_what_the_soil_can_imitate_is_mostly_gone() -> None:
    found = isolability(made(2, soil_like=0.95)[1])
    assert found.left[3] < 0.35 < 0.8 < found.left[2]


def test_forms_of_one_family_are_no_rivals_of_each_other() -> None:
    columns, _ = made(3)
    columns[:, :, 4] = columns[:, :, 3]
    found = isolability(grams_of(columns, columns[:, :, 0]))
    assert found.cosine[0, 1] == pytest.approx(1.0) and found.separation[0] > 0.8 * found.deviation[0]


def test_an_effect_without_a_signature_is_nothing_and_no_error() -> None:
    """A second pass that was never driven."""
    columns, _ = made(4)
    columns[:, :, 5] = 0.0
    found = isolability(grams_of(columns, columns[:, :, 0]))
    assert found.deviation[2] == found.left[2] == found.separation[2] == 0.0
    assert np.isfinite(found.cosine).all() and found.cosine[2, 0] == 0.0


def test_parameters_of_one_effect_count_together() -> None:
    columns, _ = made(5)
    named = {"lyasko": ("slip_sinkage", True), "slope": ("slope", False)}
    pair = columns[:, :, [0, 1, 2, 3, 4]]
    grams = grams_of(pair, columns[:, :, 5], named=named)
    both = type(grams.causes[0])(**{**vars(grams.causes[0]), "parameter": "m2"})
    merged = type(grams)(**{**vars(grams), "causes": (grams.causes[0], both)})
    found = isolability(merged, {"lyasko": [1.0, 2.0]})
    flat = pair.reshape(-1, 5)
    delta = flat[:, 3] + 2 * flat[:, 4]
    assert found.keys == ("lyasko",) and found.rivals == ("",)
    assert found.deviation[0] == pytest.approx(np.sqrt(delta @ full_projector(flat[:, :3]) @ delta), rel=1e-9)
