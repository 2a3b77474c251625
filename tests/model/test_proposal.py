"""The search for a formula, on made-up columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_grams import grams_of
from short_campaign import driven, looked

from model.diagnosis.findings.proposal import TermColumn, chosen_terms, propose, propose_for
from model.diagnosis.findings.set_fit import fit_set
from model.diagnosis.time_series.evidence import posterior
from processing import ProcessedRun

NAMES = {f"{channel}: {text}": (f"{channel}: {text}", False) for channel in ("dp", "t") for text in ("s^2", "W", "V x")}
TERMS = {key: TermColumn(key.split(": ")[0], key.split(": ")[1], "kN" if "W" in key else "", 100.0) for key in NAMES}


def left_over(seed: int, **sizes: float):
    """Return runs with three soil columns and six terms, and what `sizes` (by position) leave in them."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(6, 60, 9)) * 0.5
    residual = rng.normal(size=(6, 60))
    for position, size in sizes.items():
        residual += size * columns[:, :, 3 + int(position[1:])]
    return grams_of(columns, residual, soil=3, named=NAMES)


def test_what_was_put_in_is_proposed_with_its_size_and_sign() -> None:
    found = propose(left_over(0, c0=-1.3, c4=0.9), TERMS)
    assert found is not None and found.gain > 20
    pull, torque = found.formula.split(", ")
    assert pull.startswith("drawbar pull - 1") and pull.endswith("N s^2")
    assert torque.startswith("driving torque + ") and torque.endswith("N m/(kN) W")
    assert abs(float(pull.split()[3]) - 130) < 25


def test_two_terms_in_one_channel_stand_together() -> None:
    found = propose(left_over(1, c0=-1.3, c1=0.9), TERMS)
    assert found is not None and found.formula.startswith("drawbar pull + (-") and found.formula.endswith(" W)")


def test_noise_is_hardly_ever_given_a_formula() -> None:
    assert sum(propose(left_over(seed), TERMS) is not None for seed in range(10, 30)) <= 1


def test_one_run_cannot_be_tested_on_another() -> None:
    assert propose(left_over(2, c0=5.0).chosen(np.arange(6) == 0), TERMS) is None


@pytest.mark.parametrize("seed", range(4))
def test_adding_term_by_term_finds_what_weighing_every_set_does(seed: int) -> None:
    grams = left_over(seed, c0=0.2 * seed, c4=0.15)
    assert set(chosen_terms(grams)) == set(posterior(grams).best())


def test_a_law_that_nobody_lists_is_written_down_from_simulated_runs() -> None:
    """Drawbar pull falls with slip only while speeding up, as no cause of the library does."""

    def altered(run: ProcessedRun) -> ProcessedRun:
        missing = 1200.0 * run.slip * run.ground_acceleration_mps2
        return replace(run, drawbar_pull_n=run.drawbar_pull_n - np.where(run.slip > 0, missing, 0.0))

    campaign = driven()
    seen = looked(replace(campaign, runs=tuple(altered(run) for run in campaign.runs)), "vasilev")
    found = propose_for(fit_set(seen, ()))
    assert found is not None and found.gain > 5
    assert found.formula.startswith("drawbar pull - ") and found.formula.endswith(" a")
    assert propose_for(fit_set(looked(campaign, "vasilev"), ())) is None
