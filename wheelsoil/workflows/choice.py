"""choice.toml: the runs, stretches and options that a person chose for a campaign, and what they select."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import tomli_w
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError, create_model

from daq import ConfigError, Fault, Note, RecordingCode, TerrainConfig, nearest, read_toml
from daq.runs import Run
from model import ExtendedModel
from model.effects import EFFECTS
from model.fit import FitOptions
from model.wheel_soil import Reading, Soil, prior_of
from processing import Interval, ProcessOptions
from wheelsoil.workflows.recordings import sha256_of

SCHEMA = "wheelsoil/choice/1"
CHOICE_FILE = "choice.toml"

_HEAD = "# What was chosen by hand: `wheelsoil process`, `fit`, `diagnose` and `report` take it with --choice.\n\n"

Second = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
Flag = Annotated[bool, Field(strict=True)]
Comment = Annotated[str, Field(max_length=2000)]

_EXPECTED = {
    "schema": f'schema = "{SCHEMA}"',
    "slip_threshold": "a slip from 0 to below 1",
    "cutoff_hz": "a positive number of Hz",
    "min_speed_mps": "a positive number of m/s",
    "max_gap_s": "a positive number of seconds",
    "sinkage": '"balanced" or "literal"',
    "channels": 'some of ["dp", "t", "z"]',
    "soil_prior": "true or false",
    "effects": "keys of effects, each once: docs/effects/README.md",
    "file": "the name of the recording",
    "id": "the id of the run",
    "sha256": "64 hexadecimal digits",
    "use": "true or false",
    "keep": "pairs of seconds [from, to], none of them negative",
    "comment": "a text of up to 2000 characters",
    "marks": "tables {at_s, text}: seconds, none of them negative, and up to 200 characters",
}
_MEND = "mend it, or take the key out: the default is taken then"


def _known_effect(key: str) -> str:
    if key not in EFFECTS:
        raise ValueError(f"no effect is called {key!r} ({nearest(key, EFFECTS, label='known: ')})")
    return key


def _no_twins(values: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(values)) < len(values):
        raise ValueError("one of them is there twice")
    return values


@dataclass(frozen=True)
class Mark:
    """A remark at a moment of a run, in seconds since its time base begins."""

    __pydantic_config__ = ConfigDict(extra="forbid", defer_build=True)

    at_s: Second
    text: Annotated[str, Field(max_length=200)] = ""


@dataclass(frozen=True)
class ChosenRun:
    """What was chosen of one run.

    Attributes
    ----------
    file, id : str
        Name of the recording without folder, and id of the run; one of them is enough.
    sha256 : str
        Of the recording (`wheelsoil.workflows.recordings.sha256_of`), or empty.
    keep : tuple of (from, to) or None
        Seconds since the run's time base begins, in order; None: all of it.
    marks : tuple of Mark
        In order of time; no computation takes them.
    comment : str
    """

    __pydantic_config__ = ConfigDict(extra="forbid", defer_build=True)

    file: str = ""
    id: str = ""
    sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""
    use: Flag = True
    keep: tuple[tuple[Second, Second], ...] | None = None
    marks: tuple[Mark, ...] = ()
    comment: Comment = ""


@dataclass(frozen=True)
class FitChoices:
    """What a person chooses about a fit; see `model.fit.result.FitOptions`."""

    reading: Reading = "balanced"
    channels: tuple[str, ...] = ("dp",)
    soil_prior: bool = False
    slip_threshold: float | None = None
    extended: ExtendedModel | None = None
    effects: tuple[str, ...] = ()

    @property
    def purpose(self) -> str:
        """What runs are processed for."""
        return "fit_torque" if "t" in self.channels else "fit"

    def options(self, soil: Soil, terrain: TerrainConfig | None) -> FitOptions:
        """Return the options of the fit.

        Raises
        ------
        ConfigError
            The slip threshold is not between 0 and 1.
        """
        if not 0 <= (self.slip_threshold or 0.0) < 1:
            raise ConfigError.of("--slip-threshold is no slip", found=f"{self.slip_threshold:g}", expected="0 to 1")
        prior = prior_of(soil, terrain) if self.soil_prior else None
        return FitOptions(
            self.reading, self.channels, prior, self.slip_threshold, extended=self.extended, chosen=self.effects
        )


@dataclass(frozen=True)
class Choice:
    """What was chosen of one campaign; None is the default of whoever takes it.

    Attributes
    ----------
    slip_threshold, cutoff_hz, min_speed_mps, max_gap_s, sinkage, channels, soil_prior
        See `FitChoices` and `processing.options.ProcessOptions`.
    effects : tuple of str
        Keys of `model.effects.EFFECTS`: a model of one's own, fitted beside the four.
    runs : tuple of ChosenRun
        Runs that are not listed are used whole.
    comment : str
        Of whoever chose; no computation takes it.
    path : Path or None
        The file it was read from; two choices that differ only in it are equal.
    """

    slip_threshold: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, lt=1)] | None = None
    cutoff_hz: Positive | None = None
    min_speed_mps: Positive | None = None
    max_gap_s: Positive | None = None
    sinkage: Reading | None = None
    channels: Annotated[tuple[Literal["dp", "t", "z"], ...], Field(min_length=1), AfterValidator(_no_twins)] | None = (
        None
    )
    soil_prior: Flag | None = None
    effects: Annotated[tuple[Annotated[str, AfterValidator(_known_effect)], ...], AfterValidator(_no_twins)] = ()
    runs: tuple[ChosenRun, ...] = ()
    comment: Comment = ""
    path: Path | None = field(default=None, compare=False)

    @property
    def source(self) -> str:
        """What messages call it."""
        return str(self.path or CHOICE_FILE)

    def but(self, **options: Any) -> Choice:
        """Return the choice with other values for those options that are not None."""
        return replace(self, **{name: value for name, value in options.items() if value is not None})

    def without_remarks(self) -> Choice:
        """Return what computations take of it: no marks, no comments, no run of which nothing else is said."""
        bare = [replace(run, marks=(), comment="") for run in self.runs]
        return replace(self, comment="", runs=tuple(run for run in bare if not run.use or run.keep is not None))

    def process_options(self, purpose: str = "process", *, rate_hz: float = 100.0) -> ProcessOptions:
        """Return how runs are processed.

        Raises
        ------
        ConfigError
            See `ProcessOptions`.
        """
        return ProcessOptions(rate_hz, self.cutoff_hz, self.min_speed_mps, self.max_gap_s, purpose)

    def fit_choices(self, extended: ExtendedModel | None = None) -> FitChoices:
        """Return how models are fitted; `extended` is the model that a diagnosis left."""
        default = FitChoices()
        return FitChoices(
            reading=self.sinkage or default.reading,
            channels=default.channels if self.channels is None else self.channels,
            soil_prior=bool(self.soil_prior),
            slip_threshold=self.slip_threshold,
            extended=extended,
            effects=self.effects,
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return what a TOML or JSON file holds; what was not chosen is left out."""
        head = {name: getattr(self, name) for name in _KEYS}
        return {"schema": SCHEMA, **_stated(head | {"run": [_stated(asdict(run)) for run in self.runs]})}

    def to_toml(self) -> str:
        """Return the text of the file; `load_choice` reads the same choice from it."""
        return _HEAD + tomli_w.dumps(self.to_mapping())


def _stated(values: dict[str, Any]) -> dict[str, Any]:
    empty: tuple[object, ...] = ((), [])  # no part of a run that is kept is not the whole of it
    return {name: x for name, x in values.items() if x not in (None, "") and (x not in empty or name == "keep")}


def provenance_of(choice: Choice) -> dict[str, Any]:
    """Return what a report says of a choice: its file, the file's hash and what was done with runs; {} without one."""
    named: dict[str, Any] = {}
    if choice.path:
        named |= {"choice": choice.path.name, "choice_sha256": sha256_of(choice.path)}
    if choice.runs:
        named["choice_runs"] = tuple(map(_in_words, choice.runs))
    return named


def _in_words(run: ChosenRun) -> str:
    if not run.use:
        return f"{run.id or run.file} excluded"
    parts = ["all of it"] if run.keep is None else [f"{first:g} to {last:g} s" for first, last in run.keep]
    return f"{run.id or run.file}: {' and '.join(parts)}"


def load_choice(path: str | Path) -> Choice:
    """Read choice.toml.

    Raises
    ------
    ConfigError
        Everything that is wrong with it.
    """
    return replace(parse_choice(read_toml(Path(path)), str(path)), path=Path(path))


def parse_choice(raw: Mapping[str, Any], where: str = CHOICE_FILE) -> Choice:
    """Return the choice that a TOML or JSON file holds; `where` is its name, for messages.

    Raises
    ------
    ConfigError
        Everything that is wrong with it: unknown keys, impossible values, intervals that are empty or overlap.
    """
    faults: list[Fault] = []
    head = _checked({k: v for k, v in raw.items() if k != "run"}, _CAMPAIGN.model_validate, where, faults)
    sections = raw.get("run", [])
    if not isinstance(sections, list) or not all(isinstance(section, Mapping) for section in sections):
        faults.append(
            Fault("run is no list of tables", where, repr(sections), "[[run]]", "begin each run with [[run]]")
        )
        sections = []
    runs = [_chosen_run(section, f"{where}, [[run]] {i}", faults) for i, section in enumerate(sections, 1)]
    names = [(run.file, run.id) for run in runs if run]
    faults += [
        Fault(f"run {run or file!r} is there twice", where, next_step="leave one [[run]] of it")
        for file, run in dict.fromkeys(names)
        if names.count((file, run)) > 1
    ]
    if faults or head is None:
        raise ConfigError(*faults)
    return Choice(**{name: getattr(head, name) for name in _KEYS}, runs=tuple(run for run in runs if run))


_KEYS: dict[str, Any] = {
    each.name: (get_type_hints(Choice, include_extras=True)[each.name], each.default)
    for each in fields(Choice)
    if each.name not in ("runs", "path")
}
"""What the file says of the whole campaign: type and default."""
_CAMPAIGN = create_model(
    "_Campaign",
    __config__=ConfigDict(extra="forbid", defer_build=True),
    **_KEYS | {"schema_": (Annotated[Literal["wheelsoil/choice/1"], Field(alias="schema")], ...)},
)
_RUN = TypeAdapter(ChosenRun)


def _checked(raw: Mapping[str, Any], check: Callable[[Any], Any], where: str, faults: list[Fault]) -> Any:
    """Return the checked section; None where it is wrong, and then `faults` have grown."""
    try:
        return check(raw)
    except ValidationError as error:
        for item in error.errors():
            message = str(item["ctx"]["error"]) if item["type"] == "value_error" else item["msg"]
            key = str(item["loc"][0])
            place = ".".join(map(str, item["loc"]))
            if item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
                key = str(item["loc"][-1])
                fault = Fault(f"unknown key {key!r}", where, f"{item['input']!r}", nearest(key, _EXPECTED), "rename it")
            elif item["type"] == "missing":
                fault = Fault(f"key {key!r} is missing", where, expected=_EXPECTED[key], next_step="add it")
            else:
                fault = Fault(f"{place}: {message}", where, f"{item['input']!r}", _EXPECTED[key], _MEND)
            faults.append(fault)
    return None


def _chosen_run(raw: Mapping[str, Any], where: str, faults: list[Fault]) -> ChosenRun | None:
    found: ChosenRun | None = _checked(raw, _RUN.validate_python, where, faults)
    if found is None:
        return None
    if not (found.file or found.id):
        faults.append(Fault("a run without name", where, expected="file or id", next_step="add one of them"))
    keep = None if found.keep is None else tuple(sorted(found.keep))
    faults += _interval_faults(keep, where)
    return replace(found, keep=keep, marks=tuple(sorted(found.marks, key=lambda mark: mark.at_s)))


def _interval_faults(keep: tuple[Interval, ...] | None, where: str) -> list[Fault]:
    if keep is None:
        return []
    if not keep:
        return [Fault("keep is empty: nothing of the run is left", where, "[]", _EXPECTED["keep"], "say use = false")]
    empty = [
        Fault("an interval of keep is empty", where, f"[{a:g}, {b:g}]", "[from, to] with from < to", "mend it")
        for a, b in keep
        if not a < b
    ]
    overlapping = [
        Fault("intervals of keep overlap", where, f"[{a:g}, {b:g}] and [{c:g}, {d:g}]", "disjoint ones", "join them")
        for (a, b), (c, d) in pairwise(keep)
        if c < b and a < b and c < d
    ]
    return empty + overlapping


@dataclass(frozen=True)
class RunInUse:
    """A run that is used.

    Attributes
    ----------
    keep : tuple of (from, to) or None
        See `wheelsoil.workflows.choice.ChosenRun`.
    warnings : tuple of Note
        It is another recording than the one that the choice was made of.
    """

    run: Run
    keep: tuple[Interval, ...] | None = None
    warnings: tuple[Note, ...] = ()


def runs_in_use(choice: Choice, opened: Sequence[Run]) -> tuple[list[RunInUse], list[Fault]]:
    """Return the runs that a choice leaves in use, in their order, and everything of it that does not fit.

    What does not fit: a run that is not there or is listed twice, several that a name could mean, none that is left.
    """
    faults: list[Fault] = []
    chosen: dict[int, ChosenRun] = {}
    for section in choice.runs:
        meant = _meant(section, opened)
        if len(meant) != 1:
            faults.append(_not_one(section, [opened[i] for i in meant], opened, choice.source))
        elif meant[0] in chosen:
            run = opened[meant[0]]
            faults.append(Fault(f"run {run.id!r} is there twice", choice.source, next_step="leave one [[run]] of it"))
        else:
            chosen[meant[0]] = section
    in_use = [
        RunInUse(run, chosen[i].keep, _warnings(run, chosen[i], choice.source)) if i in chosen else RunInUse(run)
        for i, run in enumerate(opened)
        if i not in chosen or chosen[i].use
    ]
    if opened and not in_use:
        names = ", ".join(run.id for run in opened)
        faults.append(Fault("every run is switched off", choice.source, names, "one at least", "say use = true of one"))
    return in_use, faults


def _meant(section: ChosenRun, opened: Sequence[Run]) -> list[int]:
    """Return the runs that a section can mean; where campaigns share names, the hash tells them apart."""
    found = [i for i, run in enumerate(opened) if is_called(section, run)]
    if len(found) > 1 and section.sha256:
        return [i for i in found if sha256_of(*opened[i].files) == section.sha256] or found
    return found


def is_called(section: ChosenRun, run: Run) -> bool:
    """Return whether a run bears the section's name; its id may have got a number, see `daq.runs.open.open_runs`."""
    if section.file not in ("", run.path.name):
        return False
    numbered = section.file and re.fullmatch(f"{re.escape(section.id)}-[0-9]+", run.id)
    return section.id in ("", run.id) or bool(numbered)


def _not_one(section: ChosenRun, meant: Sequence[Run], opened: Sequence[Run], where: str) -> Fault:
    name = ", ".join(filter(None, (section.id and f"id {section.id!r}", section.file and f"file {section.file!r}")))
    if meant:
        found = ", ".join(str(run.path) for run in meant)
        return Fault(f"{name} can be several runs", where, found, "one of them", "give its sha256, or one campaign")
    known = ", ".join(f"{run.id} ({run.path.name})" for run in opened)
    near = nearest(section.id or section.file, [run.id if section.id else run.path.name for run in opened])
    return Fault(f"there is no run with {name}", where, known, near, "mend the name, or take this [[run]] out")


def _warnings(run: Run, section: ChosenRun, where: str) -> tuple[Note, ...]:
    if not section.sha256 or sha256_of(*run.files) == section.sha256:
        return ()
    return (Note(RecordingCode.ANOTHER_FILE, values={"file": run.path.name, "choice": where}),)
