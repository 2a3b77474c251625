"""What more data would do to a set of causes, on made-up cross products."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_grams import columns_of_runs, grams_of
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import Note
from model.diagnosis import NextRun
from model.diagnosis.core.bayes_factors import best_first
from model.diagnosis.planning.next_run import Member, split
from model.diagnosis.time_series.evidence import log_evidence


def alike(seed: int):
    """Return runs in which slope and torque_zero look the same, and a run in which they do not."""
    rng = np.random.default_rng(seed)
    columns = columns_of_runs(rng)
    columns[:, :, 6] = columns[:, :, 5]
    more = columns_of_runs(rng, runs=1)
    return rng, columns, more


def members(*keys: str, size: float = 1.0) -> tuple[Member, ...]:
    return tuple(Member(key, np.array([size])) for key in keys)


def test_a_run_that_parts_look_alikes_is_worth_more_than_one_like_the_others() -> None:
    _, columns, more = alike(0)
    grams = grams_of(columns, columns[:, :, 0])
    same = grams_of(columns[:1], columns[:1, :, 0]).matrices[0]
    other = grams_of(more, more[:, :, 0]).matrices[0]
    pair = members("slope", "torque_zero")
    like, unlike = split(grams, same, pair), split(grams, other, pair)
    assert like.expected_log_bayes_factor == pytest.approx(0.0, abs=1e-6) and like.parted == ()
    assert unlike.expected_log_bayes_factor > 2 and unlike.parted == ("slope", "torque_zero")


def test_the_expectation_is_what_simulated_data_give() -> None:
    """Mean difference of log evidences, at large size, where the Occam factors of both are alike and small."""
    rng, columns, more = alike(1)
    size = 3.0
    grams = grams_of(columns, columns[:, :, 0])
    added = grams_of(more, more[:, :, 0]).matrices[0]
    found = split(grams, added, members("slope", "torque_zero", size=size)).nats[0, 1]
    everything = np.concatenate([columns, more])
    gained = []
    for _ in range(60):
        residual = rng.normal(size=everything.shape[:2]) + size * everything[:, :, 5]
        residual += everything[:, :, :3] @ rng.normal(size=3)
        both, before = grams_of(everything, residual), grams_of(columns, residual[:-1])
        gained.append(
            log_evidence(both, ("slope",))
            - log_evidence(both, ("torque_zero",))
            - log_evidence(before, ("slope",))
            + log_evidence(before, ("torque_zero",))
        )
    assert np.mean(gained) == pytest.approx(found, rel=0.15)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 2.0))
def test_more_data_never_hurt_and_larger_effects_part_better(seed: int, size: float) -> None:
    _, columns, more = alike(seed)
    grams, added = grams_of(columns, columns[:, :, 0]), grams_of(more, more[:, :, 0]).matrices[0]
    keys = ("vasilev", "slope", "torque_zero")
    small, large = (split(grams, added, members(*keys, size=s)) for s in (size, 2 * size))
    assert (small.nats >= 0).all() and np.diag(small.nats) == pytest.approx(0)
    assert 0 <= small.expected_log_bayes_factor <= large.expected_log_bayes_factor + 1e-9


def test_a_look_alike_in_the_set_keeps_the_worth_of_a_run_small() -> None:
    """A run that parts one member from two that stay alike says nothing of those two."""
    rng, columns, _ = alike(2)
    more = columns_of_runs(rng, runs=1)
    more[:, :, 6] = more[:, :, 5]
    columns[:, :, 3] = columns[:, :, 5]
    grams, added = grams_of(columns, columns[:, :, 0]), grams_of(more, more[:, :, 0]).matrices[0]
    found = split(grams, added, members("vasilev", "slope", "torque_zero", size=2.0))
    assert found.nats[0, 1] > 5 and found.nats[1, 2] < 1e-6
    assert found.expected_log_bayes_factor < found.nats[0, 1] / 3 + np.log(2)


def test_a_set_of_one_has_nothing_to_part() -> None:
    _, columns, more = alike(3)
    found = split(grams_of(columns, columns[:, :, 0]), grams_of(more, more[:, :, 0]).matrices[0], members("slope"))
    assert found.expected_log_bayes_factor == 0 and found.parted == ()


def test_of_steps_that_tell_enough_the_cheapest_comes_first() -> None:
    worth = {"dear": (60.0, 2.0), "cheap": (9.0, 0.5), "cheaper": (30.0, 0.3), "too little": (3.0, 0.1)}
    worth |= {"least": (2.0, 0.1)}
    runs = [NextRun(Note(name), (), *numbers) for name, numbers in reversed(worth.items())]
    assert [run.step.code for run in best_first(runs)] == ["cheaper", "cheap", "dear", "too little", "least"]
    near = [NextRun(Note("dear"), (), 3.01, 2.0), NextRun(Note("cheap"), (), 3.0, 1.0)]
    assert [run.step.code for run in best_first(near)] == ["cheap", "dear"]


def test_steps_that_tell_nothing_are_ranked_too() -> None:
    """Rounding leaves a little less than nothing of what tells nothing."""
    runs = [NextRun(Note(name), (), worth, 1.0) for name, worth in (("none", -1e-17), ("less", -0.5), ("some", 1.0))]
    assert [run.step.code for run in best_first(runs)] == ["some", "none", "less"]
