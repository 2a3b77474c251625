"""Joint campaigns: a shared size that each estimates differently is noticed, and one that they share is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gram_support import column, world

from model.diagnosis import Cause, ParameterEstimate
from model.diagnosis.findings.agreement import _along, disagreements, other_forms, runs_apart
from model.diagnosis.time_series.columns import Grams
from model.diagnosis.time_series.evidence import best_set

RUNS = {"clay": 3, "sand": 3}
COLUMNS = (column("a"), column("b"), column("c", "c1"), column("c", "c2"))


def cause(name: str = "a", key: str = "", *parameters: ParameterEstimate) -> Cause:
    shown = parameters or (ParameterEstimate("a", "m", 0.1, (0.0, 0.2), 0.0),)
    return Cause(name, key if key != name else "", "physical", key or name, 0.99, 1.0, shown)


def joint(rng: np.random.Generator, one: np.ndarray, other: np.ndarray) -> Grams:
    """Return the Grams of two campaigns of three runs each, with coefficients of their own."""
    drawn = world(4, COLUMNS, strength=(30, 40))
    first, second = drawn.grams(one, rng), drawn.grams(other, rng)
    matrices = np.concatenate([first.matrices[:3], second.matrices[3:]])
    return replace(first, matrices=matrices)


@pytest.mark.parametrize(("share", "open_"), [(0.9e-6, False), (1.1e-6, True)])
def test_a_combination_of_which_a_millionth_is_open_is_not_estimated(share: float, open_: bool) -> None:
    variance = _along(np.diag([4.0, 0.0]), np.sqrt([1.0 - share, share]))
    assert variance == (np.inf if open_ else pytest.approx(0.25))


def test_what_is_shared_is_seldom_disputed_and_what_differs_always() -> None:
    rng = np.random.default_rng(2)
    same = [bool(disagreements(joint(rng, s, s), RUNS, [cause()])) for s in [np.array([1.0, 0, 0, 0])] * 200]
    assert sum(same) <= 8, "1 % is asked for"
    for _ in range(20):
        [found] = disagreements(joint(rng, np.array([0.5, 0, 0, 0]), np.array([1.5, 0, 0, 0])), RUNS, [cause()])
        assert found.parameter == "a" and found.chance < 0.01
        clay, sand = found.own
        assert (clay.campaign, sand.campaign) == ("clay", "sand")
        assert clay.value == pytest.approx(0.05, abs=4 * clay.sigma)
        assert sand.value == pytest.approx(0.15, abs=4 * sand.sigma)


def test_the_variances_are_those_of_the_final_interval() -> None:
    rng = np.random.default_rng(3)
    grams = joint(rng, np.array([0.8, 0, 0, 0]), np.array([1.2, 0, 0, 0]))
    wide = ParameterEstimate("a", "m", 0.1, (0.0, 0.2), 0.1)
    assert disagreements(grams, RUNS, [cause()])
    assert not disagreements(grams, RUNS, [cause("a", "a", wide)])
    assert not disagreements(grams, RUNS, [cause("a", "a", replace(wide, sigma=0.0, interval95=(np.nan, np.nan)))])


def test_what_one_campaign_cannot_show_is_not_asked() -> None:
    grams = joint(np.random.default_rng(5), np.array([0.5, 0, 0, 0]), np.array([1.5, 0, 0, 0]))
    grams.matrices[3:, grams.columns_of("a"), :] = 0.0
    grams.matrices[3:, :, grams.columns_of("a")] = 0.0
    assert not disagreements(grams, RUNS, [cause()])


def test_a_campaign_of_another_form_is_told() -> None:
    rng = np.random.default_rng(6)
    same = joint(rng, np.array([0, 0, 1.5, 0]), np.array([0, 0, 1.5, 0]))
    other = joint(rng, np.array([0, 0, 1.5, 0]), np.array([0, 0, 0, 1.5]))
    assert not other_forms(same, RUNS, [cause("c", "c1")])
    found = other_forms(other, RUNS, [cause("c", "c1")])
    assert set(found) == {("c", "sand")}
    assert found["c", "sand"][0] == "c2"


def test_the_run_whose_zero_no_other_run_has_is_told_with_its_size() -> None:
    runs = {"first": 8, "second": 8}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        key, channel = (("drawbar_pull_zero", "dp"), ("torque_zero@RL", "t"))[seed % 2]
        columns = (column(key, scale=50.0), column("slope"), column("a"))
        grams = world(seed, columns, runs=16, strength=(30, 40)).grams(np.array([0.4, 0.0, 1.0]), rng)
        assert not list(runs_apart(grams, best_set(grams, frozenset(), 3), runs))
        at = grams.cause_columns.start
        turn = np.eye(grams.matrices.shape[-1])
        turn[at, 0] = 10.0  # of the column's scale, in one run of the second campaign
        matrices = grams.matrices.copy()
        matrices[11] = turn.T @ matrices[11] @ turn
        off = replace(grams, matrices=matrices)
        [note] = runs_apart(off, best_set(off, frozenset(), 3), runs)
        assert (note.values["run"], note.values["family"], note.values["channel"]) == ("run 11", key, channel)
        assert note.values["size"] == pytest.approx(500.0, rel=0.15) and note.values["campaign"] == "second"
        few = off.chosen(np.arange(16) >= 12)
        assert not list(runs_apart(few, best_set(few, frozenset(), 3), {"few": 4}))
