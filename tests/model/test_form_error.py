"""The error of form of a table without repeats: given, assumed, and what half and twice of it turn."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from bench_samples import REPEATS, bench
from hypothesis import given
from hypothesis import strategies as st

from model import LackCode
from model.diagnosis import Bench, Diagnosis, DiagnosisOptions, diagnose_bench
from model.diagnosis.core.hypotheses import Posterior, listed_sets
from model.diagnosis.core.naming import Judgement
from model.diagnosis.single_wheel import BenchProblem, diagnose, form_error
from model.diagnosis.single_wheel.form_error import HALF, TWICE, Judged, adequate_at, steady
from model.diagnosis.single_wheel.noise import FORM_SHARE, FormError
from wheelsoil.wording.verdict import sentence_of

FAMILIES = {"vasilev": "slip_sinkage", "grouser": "grouser", "exit_angle": "exit_angle"}
FEW = ("vasilev", "interface_friction")


def judged(verdict: str, families: tuple[str, ...] = ()) -> Judged:
    listed = listed_sets(FAMILIES, 1)
    share = np.array([0.1, 0.6, 0.2, 0.1])
    own = Judgement(verdict, families)  # type: ignore[arg-type]
    return Judged(own, own, Posterior(listed, np.log(share), share, calibrated=True))


VERDICTS = st.sampled_from(
    [
        judged("named", ("slip_sinkage",)),
        judged("named", ("grouser",)),
        judged("one_of", ("slip_sinkage", "grouser")),
        judged("unexplained"),
        judged("nothing_detectable"),
    ]
)


@given(VERDICTS, VERDICTS, VERDICTS)
def test_a_name_needs_half_and_twice_the_error(base: Judged, half: Judged, twice: Judged) -> None:
    found, why = steady(base, {HALF: half.judgement, TWICE: twice.judgement}.__getitem__)
    all_name = base.judgement == half.judgement == twice.judgement and base.judgement.verdict == "named"
    assert (found.verdict == "named") == all_name
    if all_name:
        assert why is None
    if base.judgement.verdict != "named":
        assert found == base.judgement
    # what is said is of the posterior whose probabilities stand beside it
    assert set(found.families) <= {f for f, p in base.posterior.families().items() if p > 0.05}


def test_what_turns_is_told() -> None:
    found, why = steady(
        judged("named", ("slip_sinkage",)),
        {HALF: Judgement("unexplained"), TWICE: Judgement("named", ("slip_sinkage",))}.__getitem__,
    )
    assert found.verdict == "one_of"
    assert why is not None
    assert why.code == LackCode.FORM_DECIDES
    assert dict(why.values) == {"half": ("unexplained", ())}


def single(seed: int = 1) -> Bench:
    """Return a table without repeats whose sinkage grows with slip."""
    return bench(np.random.default_rng(seed), {"vasilev": {"H_m": 0.015}}, repeats=1, noise=0.3)


def sizes(one: Bench, form_error: FormError) -> dict[str, float]:
    problem = BenchProblem.of([one], ("dp", "z"), form_error=form_error)
    return {noise.channel: noise.form_scale / problem.size_of(noise.channel) for noise in problem.noises}


def test_the_share_is_of_load_and_radius() -> None:
    rng = np.random.default_rng(0)
    assert sizes(single(), FormError()) == pytest.approx({"dp": FORM_SHARE, "z": FORM_SHARE})
    assert sizes(single(), FormError(0.01, 2.0)) == pytest.approx({"dp": 0.02, "z": 0.02})
    assert sizes(bench(rng), FormError(0.04)) == pytest.approx({"dp": 0.04, "z": 0.04})
    repeated = bench(rng)
    assert sizes(repeated, FormError()) == pytest.approx(sizes(repeated, FormError(None, 2.0)))


def diagnosed(one: Bench, share: float | None = None) -> Diagnosis:
    return diagnose_bench([one], DiagnosisOptions(effects=FEW, channels=("dp", "z"), error_of_form=share))


@pytest.mark.slow
def test_an_assumed_error_is_said_and_is_what_gives_it() -> None:
    assumed, given_one = diagnosed(single()), diagnosed(single(), FORM_SHARE)
    assert [c.probability for c in assumed.candidates] == [c.probability for c in given_one.candidates]
    assert {one.basis for one in assumed.grounds.form_errors} == {"assumed"}
    assert {one.basis for one in given_one.grounds.form_errors} == {"given"}
    assert "is assumed to be 2.5 % of load" in sentence_of(assumed)
    assert "is given as 2.5 % of load" in sentence_of(given_one)
    assert not any("repeats" in note.code for note in assumed.notes)


@pytest.mark.parametrize("basis", [pytest.param("repeats", marks=pytest.mark.slow), "stated"])
def test_repeats_and_sigma_columns_say_the_error_of_form(basis: str) -> None:
    repeated = bench(np.random.default_rng(2))
    stated = Bench(**{**vars(single()), "sigmas": REPEATS})
    found = diagnosed({"repeats": repeated, "stated": stated}[basis])
    assert {used.basis for used in found.grounds.form_errors} == {basis}
    assert "error of form" not in sentence_of(found)


def test_what_half_and_twice_the_error_leave_is_the_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnose, "_again", lambda *_: Judgement("unexplained"))
    found = diagnosed(single())
    assert found.verdict == "one_of" and found.grounds.form_matters is not None


@pytest.mark.slow
def test_a_verdict_that_turns_is_never_a_name() -> None:
    """The verdict with an error of form that decides is never a name."""
    for share in (0.005, 0.02, 0.08, 0.3):
        found = diagnosed(single(), share)
        if found.grounds.form_matters is not None:
            assert found.verdict != "named"
            assert "depends on it" in sentence_of(found)
    assert diagnosed(single(), 0.3).verdict != "named"


def test_the_error_that_is_offered_is_that_of_the_most_probable_sets_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The set that fits first with a larger error need not be among those that fit least badly with the usual one."""
    problem = BenchProblem.of([single()], ("dp",))

    def one(name: str, score: float, misfit: float, power: float) -> SimpleNamespace:
        return SimpleNamespace(
            hypothesis=(name,), families=frozenset({name}), score=score, misfit=misfit, optima=((misfit, power),)
        )

    sets = (one("slip_sinkage", -44.0, 590.0, 2.0), *(one(f"rival {i}", -80.0 - i, 550.0 + i, 1.0) for i in range(8)))

    def misfits(scaled: BenchProblem, optima: list[tuple[float, float]]) -> np.ndarray:
        factor = scaled.noises[0].form_scale / problem.noises[0].form_scale
        return np.array([misfit / factor**power for misfit, power in optima])

    monkeypatch.setattr(form_error, "misfits", misfits)
    monkeypatch.setattr(form_error, "threshold", lambda *_: 85.0)
    found = adequate_at(SimpleNamespace(problem=problem, sets=sets), np.random.default_rng(0))  # type: ignore[arg-type]
    assert found is not None
    assert found.code == LackCode.FORM_ADEQUATE
    assert found.values["families"] == ("slip_sinkage",)
    assert 1.0 <= found.values["factor"] / np.sqrt(590.0 / 85.0) < 1.1
    assert found.values["share"] == pytest.approx(FORM_SHARE * found.values["factor"])
