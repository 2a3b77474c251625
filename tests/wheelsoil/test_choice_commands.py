"""``--choice`` on the command line: what was done by hand is done again."""

import re
from pathlib import Path

import numpy as np
import pytest
from cli_support import invoke, ok, small_campaign

from model.diagnosis import samples_of
from wheelsoil.to_json import plain
from wheelsoil.wording.diagnosis_json import diagnosis_json
from wheelsoil.workflows import (
    Choice,
    ChosenRun,
    campaigns_of,
    diagnose_campaigns,
    diagnosis_options,
    fit_runs,
    load_choice,
    open_and_process,
)
from wheelsoil.workflows.recordings import sha256_of

KEEP = ((3.0, 6.5), (10.0, 13.0))
OTHERS = {
    "channels": ("dp", "t"),
    "soil_prior": True,
    "slip_threshold": 0.3,
    "min_speed_mps": 0.8,
    "sinkage": "literal",
    "cutoff_hz": 2.0,
}
"""Something else than the default, of everything."""


@pytest.fixture(scope="session")
def clay(tmp_path_factory):
    """Six short runs."""
    return small_campaign(tmp_path_factory.mktemp("choice") / "clay", runs=6, duration_s=15.0)


@pytest.fixture
def two(clay):
    return [clay / "run-1.mcap", clay / "run-3.mcap"]


@pytest.fixture
def write(tmp_path):
    def written(**options):
        path = tmp_path / "choice.toml"
        path.write_text(Choice(**options).to_toml(), encoding="utf-8")
        return path

    return written


def test_a_run_that_is_switched_off_is_as_if_it_were_not_given(clay, write):
    choice = write(runs=(ChosenRun("run-2.mcap", use=False), ChosenRun(id="run-4", use=False)))
    given = [clay / f"run-{i}.mcap" for i in (1, 3, 5, 6)]
    found = ok("fit", clay, "--choice", choice, "--json").json
    aside = found.pop("runs_set_aside")
    assert found == ok("fit", *given, "--json").json
    assert [(run["run"], run["reason"]) for run in aside] == [
        ("run-2", "switched off in choice.toml"),
        ("run-4", "switched off in choice.toml"),
    ]


def test_settings_of_the_file_are_those_of_the_options(two, write):
    same = ["--channels", "dp,t", "--soil-prior", "--slip-threshold", 0.3, "--min-speed", 0.8, "--sinkage", "literal"]
    by_options = ok("fit", *two, "--choice", write(cutoff_hz=2.0), *same, "--json").json
    assert ok("fit", *two, "--choice", write(**OTHERS), "--json").json == by_options
    assert by_options["reading"] == "literal"
    facts = ok("process", two[0], "--choice", write(**OTHERS), "--json").json
    assert facts[0]["cutoff_hz"] == 2.0


def test_an_option_beats_the_file(two, write):
    over = ["--channels", "dp", "--no-soil-prior", "--slip-threshold", 0.2, "--min-speed", 0.5, "--sinkage", "balanced"]
    expected = ok("fit", *two, "--choice", write(cutoff_hz=2.0), "--json").json
    assert ok("fit", *two, "--choice", write(**OTHERS), *over, "--json").json == expected
    facts = ok("process", two[0], "--choice", write(**OTHERS), "--cutoff", 3, "--json").json
    assert facts[0]["cutoff_hz"] == 3.0


def test_only_what_is_kept_is_fitted_and_the_reason_is_reported(two, write):
    path = write(runs=(ChosenRun("run-1.mcap", "run-1", keep=KEEP),))
    choice = load_choice(path)
    processed = open_and_process(two, choice.process_options("fit"), choice=choice)
    seen = fit_runs(processed, choice.fit_choices(), None).observations
    times = seen.time_s[seen.run == 0]
    assert len(times) and all(any(a <= t <= b for a, b in KEEP) for t in times)
    whole = fit_runs(open_and_process(two, choice.process_options("fit")), choice.fit_choices(), None).observations
    np.testing.assert_array_equal(seen.time_s[seen.run > 0], whole.time_s[whole.run > 0])
    shares = ok("process", *two, "--choice", path, "--json").json[0]["quality"]["shares"]
    assert 0.2 < shares["BY_HAND"] < 0.26
    assert re.search(r"left out .*by hand \d", ok("process", *two, "--choice", path).out)


def test_a_model_of_ones_own_is_fitted_beside_the_four(two, write):
    found = ok("fit", *two, "--choice", write(effects=("vasilev",)), "--json").json["models"]
    assert list(found) == ["wong", "vasilev", "lyasko", "ding", "chosen"]
    assert found["chosen"] == found["vasilev"]
    four = ok("fit", *two, "--json").json["models"]
    assert {name: model for name, model in found.items() if name != "chosen"} == four


def test_what_nothing_fitted_shows_is_held_at_neutral(two, write):
    found = ok("fit", *two, "--choice", write(effects=("lyasko", "torque_zero", "track_drift")), "--json").json
    chosen = found["models"]["chosen"]
    assert chosen["held"] == {"torque_zero.offset_nm": 0.0}
    assert {"m1", "m2", "track_drift.log_stiffness_half_span"} < set(chosen["estimates"])


def test_the_diagnosis_sees_only_what_is_kept(clay, write):
    path = write(runs=(ChosenRun("run-1.mcap", keep=KEEP), ChosenRun("run-2.mcap", use=False)))
    choice = load_choice(path)
    three = [clay / f"run-{i}.mcap" for i in (1, 2, 3)]
    processed = open_and_process(three, choice.process_options("diagnose"), choice=choice)
    (seen,) = map(samples_of, campaigns_of([clay], processed))
    assert seen.run_names == ("run-1", "run-3")
    times = seen.time_s[seen.run == 0]
    assert len(times) and all(any(a <= t <= b for a, b in KEEP) for t in times)
    assert seen.excluded["by_hand"] > 0
    quick = ["--effects", "lyasko", "--most-causes", 1, "--json"]
    found = ok("diagnose", *three, "--choice", path, *quick).json
    expected = diagnosis_json(
        diagnose_campaigns(campaigns_of([], processed), diagnosis_options(effects=["lyasko"], most_causes=1))
    )
    assert found["noise"] == plain(expected["noise"])


def test_the_report_says_what_was_chosen(clay, write, tmp_path):
    choice = write(
        runs=(ChosenRun(id="run-1", keep=KEEP), ChosenRun("run-2.mcap", use=False)), effects=("second_order",)
    )
    page = tmp_path / "report.html"
    said = ok("report", clay, "--choice", choice, "--no-diagnosis", "-o", page, "--json").json
    numbers = Path(said["numbers"]).read_text(encoding="utf-8")
    for text in (
        "run-1: 3 to 6.5 s and 10 to 13 s",
        "run-2.mcap excluded",
        sha256_of(choice),
        '"BY_HAND"',
        '"chosen"',
    ):
        assert text in numbers, text
    shown = page.read_text(encoding="utf-8")
    for text in ("choice.toml", "run-2.mcap excluded", "excluded by hand"):
        assert text in shown, text


def test_another_recording_under_the_same_name_is_a_warning(clay, two, write):
    right = sha256_of(clay / "run-1.mcap")
    assert (
        "another recording"
        not in ok("process", *two, "--choice", write(runs=(ChosenRun("run-1.mcap", sha256=right),))).err
    )
    choice = write(runs=(ChosenRun("run-1.mcap", sha256="0" * 64),))
    assert "run run-1: run-1.mcap is another recording" in ok("fit", *two, "--choice", choice).err
    (first, *_) = ok("process", *two, "--choice", choice, "--json").json
    assert "another recording" in first["quality"]["notes"][0]


def test_the_hash_tells_runs_of_two_campaigns_apart(clay, campaign, write):
    run = ChosenRun("run-1.mcap", "run-1", sha256_of(campaign / "run-1.mcap"), use=False)
    found = ok("process", clay, campaign, "--choice", write(runs=(run,)), "--json").json
    ids = [one["run"]["id"] for one in found if "set_aside" not in one]
    assert len(ids) == 7 and "run-1" in ids
    unsure = invoke("process", clay, campaign, "--choice", write(runs=(ChosenRun("run-1.mcap", use=False),)))
    assert unsure.code == 2
    assert "can be several runs" in unsure.err and "give its sha256" in unsure.err


def test_what_does_not_fit_the_runs_is_said_at_once(clay, write):
    choice = write(
        runs=(
            ChosenRun(id="run-7"),
            ChosenRun("run-1.mcap", "run-2"),
            ChosenRun("run-3.mcap", keep=((1.0, 500.0), (600.0, 700.0))),
            ChosenRun("run-4.mcap"),
            ChosenRun(id="run-4"),
        )
    )
    for command in ("process", "report"):
        more = ["-o", choice.with_name("r.html")] if command == "report" else []
        refused = invoke(command, clay, "--choice", choice, *more)
        assert refused.code == 2
        for text in (
            "5 faults",
            "no run with id 'run-7'",
            "no run with id 'run-2', file 'run-1.mcap'",
            "1 to 500 s",
            "600 to 700 s",
            "run 'run-4' is there twice",
        ):
            assert text in refused.err, text
    assert not choice.with_name("r.html").exists()


def test_every_run_switched_off_is_refused(clay, write):
    refused = invoke(
        "fit", clay, "--choice", write(runs=tuple(ChosenRun(id=f"run-{i}", use=False) for i in range(1, 7)))
    )
    assert refused.code == 2 and "every run is switched off" in refused.err


def test_an_effect_that_is_not_identifiable_is_refused(clay, write):
    refused = invoke("fit", clay, "--choice", write(effects=("closed_form_sinkage",)))
    assert refused.code == 2 and "literal reading only" in refused.err


@pytest.mark.parametrize(("args", "words"), [(["--table", "x.csv"], "exclude each other"), (["--plan"], "--choice")])
def test_a_choice_is_of_runs(write, args, words):
    refused = invoke("diagnose", *args, "--choice", write(cutoff_hz=2.0))
    assert refused.code == 2 and words in refused.err
