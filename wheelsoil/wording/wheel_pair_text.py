"""What `diagnose --paired` prints: the differences between two wheels on one soil, and what explains them."""

from __future__ import annotations

from math import isfinite
from typing import Any

from daq import OUTPUTS, number, table_lines
from model.diagnosis import WheelPair
from model.diagnosis.single_wheel import own_part
from wheelsoil.wording.diagnosis_text import limited, wrapped
from wheelsoil.wording.grounds_text import form_error_words
from wheelsoil.wording.names import chance, effect_name, page_unit, plain_name, with_chance

SCHEMA = "wheelsoil/paired/1"
_DIFFERENT = 0.01
"""p below which the wheels are said to differ."""
_LIKELY = 0.9
_MOST_SETS = 6
_LEAST_SHOWN = 0.01


def wheel_pair_lines(found: WheelPair, first: str, second: str, width: int) -> list[str]:
    """Return the comparison of two wheels, by their names, as lines of text."""
    width = limited(width)
    head = ["slip", *(f"{OUTPUTS[c].name} {page_unit(c)[1]}" for c in found.difference)]
    rows = [[f"{slip:.2f}", *(_with_sigma(found, c, i) for c in found.difference)] for i, slip in enumerate(found.slip)]
    families = [f"{plain_name(name)} {chance(p)}" for name, p in found.families().items() if p >= _LEAST_SHOWN]
    sets = [f"  {chance(p)}  {_set(causes)}" for causes, p in _sets(found)]
    return [
        *wrapped(wheel_pair_sentence(found, first, second), width),
        "",
        *wrapped(f"{second} less {first}, after load, slip and size (± one-sigma if nothing is different)", width),
        *(f"  {line}" for line in table_lines(head, rows)),
        "",
        *wrapped(f"Causes of {second} alone (probability of being among them)", width),
        *wrapped(", ".join(families) or "none", width, "  "),
        "",
        *wrapped(f"Sets of causes (own: of {second} alone)", width),
        *sets,
    ]


def wheel_pair_sentence(found: WheelPair, first: str, second: str) -> str:
    """Return what the second wheel does differently, how sure that is, and why it does."""
    if found.p_value >= _DIFFERENT:
        sentence = (
            f"What {first} taught holds for {second}: differences as large as the measured ones come by chance with "
            f"p = {found.p_value:.2g}"
        )
        return " ".join([f"{sentence}.", *form_error_words(found.form_errors)])
    sentence = (
        f"What {first} taught does not hold for {second} (p = {found.p_value:.2g}): at like slip, {_largest(found)}"
    )
    own, families = found.own_cause, found.families()
    likely = [with_chance(name, p) for name, p in families.items() if p >= 0.05]
    if not found.both.any_adequate:
        why = "No cause of the library that acts on it alone explains the difference to within what may be missed"
    elif max(families.values(), default=0.0) > _LIKELY and own > _LIKELY:
        why = f"It has a cause of its own ({chance(own)}): {likely[0]}"
    elif likely:
        one_of = f"one of {', '.join(likely)}" if len(likely) > 1 else f"most probably {likely[0]}"
        why = f"It has a cause of its own with {chance(own)}, {one_of}: these rows cannot separate them further"
    else:
        why = f"A cause of its own is not detectable ({chance(own)}): a cause that both share may explain it"
    return " ".join([f"{sentence}.", f"{why}.", *form_error_words(found.form_errors)])


def _largest(found: WheelPair) -> str:
    """Return the most significant difference of each channel."""
    sizes = []
    for channel, difference in found.difference.items():
        known = [i for i, size in enumerate(difference) if isfinite(size)]
        if known:
            i = max(known, key=lambda i: abs(difference[i]) / found.difference_sigma[channel][i])
            factor, unit = page_unit(channel)
            size = f"{factor * difference[i]:+.2g} {unit}"
            sizes.append(f"{size} of {OUTPUTS[channel].name} at slip {found.slip[i]:.2g}")
    return ", ".join(sizes) or "no slip was measured with both"


def _with_sigma(found: WheelPair, channel: str, i: int) -> str:
    size, sigma = (page_unit(channel)[0] * float(x[channel][i]) for x in (found.difference, found.difference_sigma))
    return f"{size:+.3g} ± {number(sigma, 2)}" if isfinite(size) else "-"


def _sets(found: WheelPair) -> list[tuple[tuple[tuple[str, bool], ...], float]]:
    """Return the most probable sets: key and whether the second wheel alone has it."""
    ranked = sorted(zip(found.both.probabilities.tolist(), found.both.sets, strict=True), key=lambda pair: -pair[0])
    return [
        (tuple((use.key, use in own_part(w.hypothesis)) for use in w.hypothesis), p)
        for p, w in ranked[:_MOST_SETS]
        if p >= _LEAST_SHOWN
    ]


def _set(causes: tuple[tuple[str, bool], ...]) -> str:
    return " + ".join(f"{effect_name(key)}{' (own)' if own else ''}" for key, own in causes) or "no cause"


def wheel_pair_json(found: WheelPair, first: str, second: str) -> dict[str, Any]:
    """Return the comparison as plain values for programs; the contract is `SCHEMA`."""
    return {
        "schema": SCHEMA,
        "sentence": wheel_pair_sentence(found, first, second),
        "first": first,
        "second": second,
        "p_value": found.p_value,
        "own_cause": found.own_cause,
        "adequate": found.both.any_adequate,
        "families": found.families(),
        "sets": [
            {
                "shared": [key for key, own in causes if not own],
                "own": [key for key, own in causes if own],
                "probability": p,
            }
            for causes, p in _sets(found)
        ],
        "slip": found.slip,
        "difference": found.difference,
        "difference_sigma": found.difference_sigma,
        "measured": found.measured,
        "predicted": found.predicted,
        "predicted_sigma": found.predicted_sigma,
        "error_of_form": [vars(form_error) for form_error in found.form_errors],
    }
