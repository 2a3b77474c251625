"""A plan as lines of text for the terminal: detectable causes, separable causes, confounded causes."""

from __future__ import annotations

from collections.abc import Iterable

from daq import FloatArray, number, table_lines
from model import LackCode
from model.diagnosis import CONFOUNDED_COSINE, DETECTABLE_D, Detectable, Plan
from model.effects import EFFECTS
from wheelsoil.wording.diagnosis_text import NOT_IDENTIFIABLE, limited, not_named, notes_by_text, wrapped
from wheelsoil.wording.grounds_text import undetectable
from wheelsoil.wording.names import effect_name, listed, plain_name
from wheelsoil.wording.notes import note_text, step_text, worth_text

_FAINT = 0.3


def plan_lines(plan: Plan, width: int = 96) -> list[str]:
    """Return a plan as lines of text; see `wheelsoil.wording.diagnosis_text.diagnosis_lines`."""
    width = limited(width)
    parts = (
        wrapped(_sentence(plan), width),
        _effects(plan, width),
        _alike(plan, width),
        _matrix(plan, width),
        *(
            notes_by_text(f"{title} ({len(texts)})", texts, width)
            for title, texts in not_named(plan.not_identifiable, plan.minimum_detectable).items()
        ),
    )
    return [line for i, part in enumerate(filter(None, parts)) for line in (("", *part) if i else part)]


def _sentence(plan: Plan) -> str:
    found = plan.isolability
    families = dict.fromkeys(found.families)
    seen = dict.fromkeys(f for f, d in zip(found.families, found.deviation, strict=True) if d >= DETECTABLE_D)
    apart = dict.fromkeys(
        f
        for f, d in zip(found.families, found.separation, strict=True)
        if d >= DETECTABLE_D and f not in plan.not_identifiable
    )
    library = dict.fromkeys(effect.name for effect in EFFECTS.values())
    reasons = {family: _why_omitted(plan, family) for family in library if family not in families}
    omitted = [f"{plain_name(family)} ({why})" for family, why in reasons.items() if why]
    omitted += [f"{others} that --effects or --without omits"] if (others := len(reasons) - len(omitted)) else []
    return (
        f"{len(families)} of the library's {len(library)} families are considered. {len(seen)} are detectable in these "
        f"runs at a plausible size; {len(apart)} of them are separable from every other (d_sep of 5 or more, on "
        "average)." + (f" Not considered: {', '.join(omitted)}." if omitted else "")
    )


def _why_omitted(plan: Plan, family: str) -> str:
    if (why := plan.not_identifiable.get(family)) and why.code in (LackCode.SMOOTH_TYRE, LackCode.INPUT_UNKNOWN):
        return note_text(why)
    effects = [effect for effect in EFFECTS.values() if effect.name == family]
    if roles := [role for effect in effects for role in effect.needs.roles]:
        return f"needs the role {listed(roles)}"
    return "" if any(e.reading == "any" for e in effects) else f"of --sinkage {effects[0].reading} only"


def _effects(plan: Plan, width: int) -> list[str]:
    found = plan.isolability
    rows = [
        [
            _short(key),
            f"{left:.2f}",
            number(d, 2),
            number(apart, 2),
            _short(rival) if rival else "-",
            _size(key, plan.minimum_detectable[key]),
            "not named" if family in plan.not_identifiable else _size(key, plan.minimum_separable[key]),
        ]
        for key, family, left, d, apart, rival in zip(
            found.keys, found.families, found.left, found.deviation, found.separation, found.rivals, strict=True
        )
    ]
    head = ["cause", "left", "d", "d_sep", "closest", "detectable", "separable"]
    lines = table_lines(head, rows, width=width - 2)
    title = "At a plausible size: share left by the soil, d (5: detectable), d_sep (5: separable from all others)"
    return [*wrapped(title, width), *(f"  {line}" for line in lines), *_footnote(plan, width)]


def _footnote(plan: Plan, width: int) -> list[str]:
    text = (
        "detectable: minimum detectable effect, found in half of such campaigns; "
        "separable: d_sep is 5, noise changes it by 1"
    )
    if any(title == NOT_IDENTIFIABLE for title in not_named(plan.not_identifiable, plan.minimum_detectable)):
        text += ". Not named: detectable, not identifiable, or not detectable, see below"
    return wrapped(f"{text}.", width, "  ")


def _short(key: str) -> str:
    """Return a name that fits: of a family with forms the form is enough."""
    return plain_name(EFFECTS[key].form) or effect_name(key)


def _size(key: str, found: Detectable) -> str:
    if undetectable({key: found}):
        return "at no size"
    return f"{number(found.value, 2)} {'' if found.unit == '1' else found.unit}".rstrip()


def _alike(plan: Plan, width: int) -> list[str]:
    lines = []
    for advice in plan.confounded:
        names = ", ".join(map(plain_name, advice.families))
        lines += wrapped(names, width, "  ", "    ")
        for run in advice.next_runs:
            lines += wrapped(f"{step_text(run)}: {worth_text(run)}", width, "    separated by ", "      ")
    return [f"Confounded causes (|cos| from {CONFOUNDED_COSINE:g} on)", *lines] if lines else []


def _matrix(plan: Plan, width: int) -> list[str]:
    """Return |cos| of every pair as one digit: tenths, = from `CONFOUNDED_COSINE` on, a dot where it is faint."""
    found = plan.isolability
    names = [effect_name(key) for key in found.keys]
    longest = max(map(len, names), default=0)
    gap = " " if longest + 2 + 2 * len(names) <= width else ""
    lines = [f"  {name.ljust(longest)} {gap.join(_digits(found.cosine[i, : i + 1]))}" for i, name in enumerate(names)]
    head = "|cos| of every pair, the soil projected out: tenths; = from .95 on; . below .3; + itself"
    return [*wrapped(head, width), *lines] if lines else []


def _digits(row: FloatArray) -> Iterable[str]:
    *others, _ = row.tolist()
    return [*("=" if c >= CONFOUNDED_COSINE else "." if c < _FAINT else str(int(10 * c)) for c in others), "+"]


def matrix_csv(plan: Plan) -> str:
    """Return the whole matrix of |cos| as CSV, one row and column for each effect."""
    found = plan.isolability
    rows = [",".join([key, *(f"{c:.4f}" for c in row)]) for key, row in zip(found.keys, found.cosine, strict=True)]
    return "\n".join([",".join(["effect", *found.keys]), *rows]) + "\n"
