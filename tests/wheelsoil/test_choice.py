"""choice.toml: what is written reads the same, and everything that is wrong is said at once."""

import re
import string
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples

from daq import ConfigError
from model.effects import EFFECTS
from wheelsoil.to_json import to_json
from wheelsoil.workflows import Choice, ChosenRun, load_choice, parse_choice
from wheelsoil.workflows.choice import SCHEMA, Mark
from wheelsoil.workflows.fit import FitChoices

names = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12)
positive = st.floats(1e-6, 1e6)


@st.composite
def intervals(draw):
    edges = sorted(draw(st.lists(st.floats(0, 1e5), min_size=2, max_size=8, unique=True)))
    return tuple(zip(edges[::2], edges[1::2], strict=False))


chosen_runs = st.builds(
    ChosenRun,
    file=names,
    id=st.one_of(st.just(""), names),
    sha256=st.one_of(st.just(""), st.text(string.hexdigits[:16], min_size=64, max_size=64)),
    use=st.booleans(),
    keep=st.one_of(st.none(), intervals()),
    marks=st.lists(st.builds(Mark, st.floats(0, 1e5), names), max_size=3).map(
        lambda marks: tuple(sorted(marks, key=lambda mark: mark.at_s))
    ),
    comment=st.one_of(st.just(""), names),
)
choices = st.builds(
    Choice,
    slip_threshold=st.none() | st.floats(0, 1, exclude_max=True),
    cutoff_hz=st.none() | positive,
    min_speed_mps=st.none() | positive,
    sinkage=st.sampled_from([None, "balanced", "literal"]),
    channels=st.sampled_from([None, ("dp",), ("t",), ("dp", "t")]),
    soil_prior=st.sampled_from([None, True, False]),
    effects=st.lists(st.sampled_from(list(EFFECTS)), unique=True, max_size=4).map(tuple),
    runs=st.lists(chosen_runs, max_size=4, unique_by=lambda run: (run.file, run.id)).map(tuple),
    comment=st.one_of(st.just(""), names),
)


@examples(150)
@given(choices)
def test_what_is_written_reads_the_same(choice):
    text = choice.to_toml()
    assert parse_choice(tomllib.loads(text)) == choice
    assert parse_choice(choice.to_mapping()) == choice
    assert parse_choice(tomllib.loads(text)).to_toml() == text
    assert to_json(choice.to_mapping())


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
KEYS = [
    *Choice().to_mapping(),
    "run",
    "cutoff_hz",
    "channels",
    "effects",
    "keep",
    "use",
    "slip_threshold",
    "sinkage",
    "marks",
]


@examples(150)
@given(st.dictionaries(st.sampled_from(KEYS), junk), st.lists(st.dictionaries(st.sampled_from(KEYS), junk), max_size=3))
def test_whatever_is_in_it_is_read_or_refused_with_reasons(head, sections):
    raw = {"schema": SCHEMA, "run": sections} | head
    try:
        choice = parse_choice(raw, "mine.toml")
    except ConfigError as error:
        assert all(fault.where.startswith("mine.toml") and fault.next_step for fault in error.faults)
    else:
        assert parse_choice(tomllib.loads(choice.to_toml())) == choice


WRONG = """
schema = "wheelsoil/choice/2"
efects = ["lyasko"]
slip_threshold = 1.5
cutoff_hz = -2
min_speed_mps = nan
sinkage = "deep"
channels = ["x"]
soil_prior = 1
effects = ["lasko", "vasilev"]
[[run]]
id = "a"
keep = [[3, 3], [5, 9], [8, 12], [30, 20], [-1, 1]]
[[run]]
id = "b"
keep = [[3, 3], [5, 9], [8, 12], [30, 20]]
[[run]]
id = "b"
keep = []
kep = 1
[[run]]
use = false
"""
SAID = (
    ("schema", '"wheelsoil/choice/1"'),
    ("unknown key 'efects'", "nearest: effects"),
    ("slip_threshold", "a slip from 0 to below 1"),
    ("cutoff_hz", "found: -2"),
    ("min_speed_mps", "finite"),
    ("sinkage", "'balanced' or 'literal'"),
    ("channels", "'x'"),
    ("soil_prior", "true or false"),
    ("no effect is called 'lasko'", "lyasko"),
    ("keep.4.0", "-1"),
    ("is empty", "[3, 3]"),
    ("is empty", "[30, 20]"),
    ("overlap", "[5, 9] and [8, 12]"),
    ("unknown key 'kep'", "nearest: keep"),
    ("without name", "file or id"),
)


def test_everything_that_is_wrong_is_said_at_once(tmp_path: Path):
    path = tmp_path / "choice.toml"
    path.write_text(WRONG)
    with pytest.raises(ConfigError) as caught:
        load_choice(path)
    texts = [str(fault) for fault in caught.value.faults]
    for words in SAID:
        assert any(all(word in text for word in words) for text in texts), words
    assert all(fault.where.startswith(str(path)) and fault.next_step for fault in caught.value.faults)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ([{"id": "a", "keep": []}], ["nothing of the run is left", "use = false"]),
        ([{"id": "a"}, {"id": "a", "use": False}], ["'a' is there twice"]),
        ({"id": "a"}, ["begin each run with [[run]]"]),
        ([{"file": "x", "sha256": "12"}], ["64 hexadecimal digits"]),
    ],
)
def test_a_wrong_run_is_refused(sections, words):
    with pytest.raises(ConfigError) as caught:
        parse_choice({"schema": SCHEMA, "run": sections})
    for word in words:
        assert word in str(caught.value)


def test_the_page_shows_every_key():
    page = (Path(__file__).parents[2] / "docs" / "choice.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(.*?)```", page, re.S)
    choice = parse_choice(tomllib.loads(shown), "docs/choice.md")
    assert all(getattr(choice, f.name) not in (None, (), "") for f in fields(Choice) if f.name != "path")
    assert all(getattr(choice.runs[0], f.name) not in (None, (), "") for f in fields(ChosenRun))


def test_no_file_and_no_toml_are_said(tmp_path: Path):
    (tmp_path / "choice.toml").write_text("slip_threshold = ")
    for name, word in (("choice.toml", "not valid TOML"), ("chioce.toml", "no such file")):
        with pytest.raises(ConfigError, match=word):
            load_choice(tmp_path / name)


def test_a_run_of_which_nothing_is_kept_is_not_written_as_a_whole_one():
    with pytest.raises(ConfigError, match="keep is empty"):
        parse_choice(tomllib.loads(Choice(runs=(ChosenRun(id="a", keep=()),)).to_toml()))


def test_intervals_are_put_in_order():
    choice = parse_choice({"schema": SCHEMA, "run": [{"id": "a", "keep": [[5, 6], [1, 5]]}]})
    assert choice.runs[0].keep == ((1.0, 5.0), (5.0, 6.0))


def test_nothing_chosen_is_the_default_of_each_command():
    assert Choice().fit_choices() == FitChoices()
    assert Choice().but(channels=("t",), cutoff_hz=None) == Choice(channels=("t",))
    assert Choice(cutoff_hz=2.0, min_speed_mps=0.7).process_options("fit").min_speed_mps == 0.7


def test_computations_take_neither_marks_nor_comments():
    kept = ChosenRun("a.mcap", keep=((1.0, 2.0),))
    remarked = Choice(0.2, runs=(ChosenRun("b.mcap", marks=(Mark(1.0, "here"),)),), comment="wet")
    assert remarked.without_remarks() == Choice(0.2)
    assert Choice(runs=(kept,), comment="wet").without_remarks() == Choice(runs=(kept,))
