from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.fit.covariance import covariance
from wheelsoil.wording.notes import note_text, texts_of

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(1, 5))
def test_covariance_is_the_inverse_of_the_normal_matrix(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(20, count)) * 10.0 ** rng.uniform(-6, 6, size=count)
    found = covariance(jacobian, 2.5)
    unit = np.linalg.norm(jacobian, axis=0)
    expected = 2.5 * np.linalg.inv((jacobian / unit).T @ (jacobian / unit)) / np.outer(unit, unit)
    assert found.matrix == pytest.approx(expected, rel=1e-9)
    assert np.diag(found.correlation) == pytest.approx(np.ones(count))
    assert found.condition_number == pytest.approx(np.linalg.cond(jacobian / unit), rel=1e-9)
    assert found.rank == count


@given(seeds)
def test_a_held_parameter_does_not_widen_the_others(seed: int) -> None:
    jacobian = np.random.default_rng(seed).normal(size=(9, 3))
    found = covariance(jacobian, held=np.array([False, True, False]))
    alone = covariance(jacobian[:, [0, 2]])
    assert found.matrix[np.ix_([0, 2], [0, 2])] == pytest.approx(alone.matrix)
    assert np.isnan(found.matrix[1]).all()


@given(seeds, st.floats(-8, 8))
def test_what_is_not_determined_has_an_infinite_variance_whatever_its_unit(seed: int, exponent: float) -> None:
    rng = np.random.default_rng(seed)
    first, third = rng.normal(size=(2, 12))
    jacobian = np.column_stack([first, -3 * first * 10.0**exponent, third])
    found = covariance(jacobian, names=["a", "b", "c"])
    assert found.rank == 2
    assert np.isinf(found.condition_number)
    assert np.isinf(np.sqrt(np.diag(found.matrix))).tolist() == [True, True, False]
    assert found.matrix[2, 2] > 0
    assert "a and b: not determined singly" in note_text(found.warnings[0])


def test_fewer_rows_than_parameters() -> None:
    found = covariance(np.array([[1.0, 2.0]]), names=["a", "b"])
    assert found.rank == 1
    assert np.isinf(np.sqrt(np.diag(found.matrix))).all()


def test_a_combination_with_its_numbers() -> None:
    t = np.linspace(0, 1, 40)
    found = covariance(np.column_stack([t, 100 * (t + 0.003 * t**2)]), 1e-4, names=["a", "b"])
    (text,) = texts_of(found.warnings)
    assert "only a + " in text
    ratio = float(text.split("only a + ")[1].split()[0])
    combination = np.array([1.0, ratio])
    left = float(text.split("(sd ")[1].split(";")[0])
    assert np.sqrt(combination @ found.matrix @ combination) == pytest.approx(left, rel=0.1)
    assert left < 0.01 * np.sqrt(np.diag(found.matrix))[0]


def test_three_that_hang_together_are_named_once() -> None:
    t = np.linspace(1, 2, 40)
    found = covariance(np.column_stack([np.ones_like(t), t**0.01, t**0.02, np.sin(50 * t)]), names=list("abcd"))
    assert len(found.warnings) == 1
    assert note_text(found.warnings[0]).startswith("a, b and c: not determined singly, only together")


def test_a_group_that_no_pair_shows() -> None:
    rng = np.random.default_rng(3)
    parts = np.linalg.qr(rng.normal(size=(60, 4)))[0]
    last = parts.sum(axis=1) + 0.02 * rng.normal(size=60)
    found = covariance(np.column_stack([parts, last]), names=list("abcde"))
    pairs = np.abs(found.correlation - np.eye(5)).max()
    assert pairs < 0.99
    assert any("a combination of the others" in text for text in texts_of(found.warnings))


def test_well_separated_parameters_raise_no_warning() -> None:
    assert covariance(np.eye(3)).warnings == ()
