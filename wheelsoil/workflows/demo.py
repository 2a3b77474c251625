"""The demo's sealed envelope: a hidden effect drawn from a seed, and what is said of it when it is opened."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from model.diagnosis import Cause, Diagnosis
from model.effects import EFFECTS, Effect, Parameter
from model.wheel_soil import Wheel
from processing import ProcessedRun
from wheelsoil.wording.names import effect_name, plain_name

Outcome = Literal["found", "in the set", "not named", "not seen", "wrong", "right"]

NONE = "none"
_NOTHING_SHARE = 0.08
_LEAST_SIZE, _LARGEST_SIZE = 0.6, 1.6
_HIDDEN_STREAM = 1 << 20
"""Far from the streams of the simulation, which are numbered from 0."""


@dataclass(frozen=True)
class Hidden:
    """What the envelope holds: the key of an effect with its parameters, or `NONE`."""

    key: str
    values: dict[str, float] = field(default_factory=dict)

    @property
    def family(self) -> str:
        """The effect's family, or `NONE`."""
        return NONE if self.key == NONE else EFFECTS[self.key].name

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """As the simulation takes it."""
        return {} if self.key == NONE else {self.key: self.values}

    @property
    def text(self) -> str:
        """In words."""
        if self.key == NONE:
            return "nothing at all"
        units = {p.name: p.unit for p in EFFECTS[self.key].parameters}
        sizes = [f"{name} = {value:.3g} {units[name]}".removesuffix(" 1") for name, value in self.values.items()]
        return f"{effect_name(self.key)} with {' and '.join(sizes)}"


def draw_hidden(seed: int, wheel: Wheel) -> Hidden:
    """Draw a family, one of its forms, and for each parameter a size and a direction; sometimes nothing.

    Families are equally likely. A size is 0.6 to 1.6 times plausible by the prior, within the bounds.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_HIDDEN_STREAM,)))
    if rng.random() < _NOTHING_SHARE:
        return Hidden(NONE)
    families: dict[str, list[type[Effect]]] = {}
    for effect in EFFECTS.values():
        if effect.reading == "any" and not effect.needs.roles:
            families.setdefault(effect.name, []).append(effect)
    forms = families[list(families)[rng.integers(len(families))]]
    effect = forms[rng.integers(len(forms))]
    return Hidden(effect.key(), {p.name: _size(p, wheel, rng) for p in effect.parameters})


def _size(parameter: Parameter, wheel: Wheel, rng: np.random.Generator) -> float:
    side = parameter.side or (1 if rng.random() < 0.5 else -1)
    value = parameter.neutral + side * parameter.scale(wheel) * rng.uniform(_LEAST_SIZE, _LARGEST_SIZE)
    return float(f"{np.clip(value, parameter.lower, parameter.upper):.4g}")


def without_ruts(run: ProcessedRun) -> ProcessedRun:
    """Return a run as it was before its rut was read."""
    nothing = np.full(len(run), np.nan)
    return replace(run, run=run.run.model_copy(update={"rut": ()}), sinkage_m=nothing, sinkage_sigma_m=nothing)


@dataclass(frozen=True)
class Opened:
    """What is said once the envelope is open.

    Attributes
    ----------
    outcome : see `Outcome`
    parameters : tuple of mapping
        name, unit, truth, value, interval95, inside: where the very form was found.
    """

    outcome: Outcome
    sentence: str
    parameters: tuple[dict[str, Any], ...] = ()


def open_envelope(hidden: Hidden, diagnosis: Diagnosis) -> Opened:
    """Compare the verdict with what was hidden."""
    outcome = _outcome(hidden, diagnosis)
    found = next((cause for cause in diagnosis.causes if cause.name == hidden.family), None)
    parameters = _parameters(hidden, found) if found else ()
    return Opened(outcome, f"{_words(outcome, hidden, diagnosis)}{_sizes(parameters)}", parameters)


def _outcome(hidden: Hidden, diagnosis: Diagnosis) -> Outcome:
    names = {cause.name for cause in diagnosis.causes}
    if hidden.key == NONE:
        return "right" if diagnosis.verdict == "nothing_detectable" else "wrong"
    if diagnosis.verdict == "named":
        return "found" if hidden.family in names else "wrong"
    if diagnosis.verdict == "one_of":
        return "in the set" if hidden.family in names else "wrong"
    return "not seen" if diagnosis.verdict == "nothing_detectable" else "not named"


def _words(outcome: Outcome, hidden: Hidden, diagnosis: Diagnosis) -> str:
    names = ", ".join(dict.fromkeys(plain_name(cause.name) for cause in diagnosis.causes))
    sentences: dict[Outcome, str] = {
        "found": f"Found: {hidden.text} was hidden.",
        "in the set": f"Not decided, but not missed: {hidden.text} was hidden, and it is in the set.",
        "not named": f"Seen, but not named: {hidden.text} was hidden.",
        "not seen": f"Not seen: {hidden.text} was hidden.{_least(hidden, diagnosis)}",
        "wrong": f"Wrong: {hidden.text} was hidden, and the verdict is {plain_name(diagnosis.verdict)}"
        + (f" ({names})." if names else "."),
        "right": "Right: nothing was hidden.",
    }
    others = [name for name in dict.fromkeys(c.name for c in diagnosis.causes) if name != hidden.family]
    extra = f" Named beside it, and not hidden: {', '.join(map(plain_name, others))}."
    return sentences[outcome] + (extra if outcome == "found" and others else "")


def _least(hidden: Hidden, diagnosis: Diagnosis) -> str:
    least = diagnosis.minimum_detectable.get(hidden.key)
    if least is None or not np.isfinite(least.value):
        return ""
    unit = "" if least.unit == "1" else f" {least.unit}"
    return f" It is detectable from {least.parameter} = {least.value:.3g}{unit} on."


def _parameters(hidden: Hidden, found: Cause) -> tuple[dict[str, Any], ...]:
    """Return truth beside estimate; of Lyasko's law only the sum is determined."""
    if found.key != hidden.key:
        return ()
    truth = dict(hidden.values)
    if set(truth) == {"m1", "m2"}:
        truth["p"] = sum(truth.values())
    rows = []
    for estimate in found.parameters:
        low, high = estimate.interval95
        if estimate.name in truth:
            rows.append(
                {
                    "name": estimate.name,
                    "unit": estimate.unit,
                    "truth": truth[estimate.name],
                    "value": estimate.value,
                    "interval95": (low, high),
                    "inside": bool(low <= truth[estimate.name] <= high),
                }
            )
    return tuple(rows)


def _sizes(parameters: tuple[dict[str, Any], ...]) -> str:
    sentences = [
        f"{p['name']} is estimated as {p['value']:.3g} ({p['interval95'][0]:.3g} to {p['interval95'][1]:.3g}), which "
        f"{'contains' if p['inside'] else 'does not contain'} the true value"
        for p in parameters
        if np.isfinite(p["interval95"]).all()
    ]
    return f" {'; '.join(sentences)}." if sentences else ""
