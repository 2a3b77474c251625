"""docs/blind_results.md and its JSON: every figure with its n and its bound."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median

import numpy as np
from blind.causes import ALL, FAMILIES
from blind.figures import (
    LEVELS,
    Figure,
    Line,
    candidates,
    families,
    intervals,
    level,
    loose_verdict,
    of,
    pull_r0,
    right_verdict,
    said,
    share,
    tellable,
)
from blind.mix import FRESH
from blind.study import read_lines

_GIVEN_NOISE = ("linearise", "columns", "whitening", "smoothing", "evidence", "bagging")
"""Stages of a diagnosis whose noise model is known."""


def joined(out: Path, wanted: set[str] | None = None) -> list[Line]:
    """Return the lines of a study that are complete."""
    truths, answers = read_lines(out / "truth.jsonl"), read_lines(out / "answers.jsonl")
    return [truths[name] | answers[name] for name in truths if name in answers and (wanted is None or name in wanted)]


def figures(lines: Sequence[Line]) -> list[Figure]:
    """Return the table of the study."""
    nulls, singles, pairs = (of(lines, kind) for kind in ("null", "single", "pair"))
    return [
        share("nulls: named at p > 0.9", "0 of 200 is the aim, above 2 a defect", nulls, lambda x: bool(said(x, 0.9))),
        share("nulls: any false verdict", "<= .05", nulls, lambda x: x["verdict"] != "nothing_detectable"),
        *_slip_sinkage(singles),
        *_top_one(singles, nulls),
        share("verdict right for what the data can tell", ">= .85", [*nulls, *singles], right_verdict),
        share("the same, a right name never being wrong", "", [*nulls, *singles], loose_verdict),
        *_set_lengths([*nulls, *singles]),
        *_precision([*nulls, *singles, *pairs]),
        *_outside(of(lines, "outside")),
        *_left_out(of(lines, "left_out")),
        *_pairs(pairs),
        *_intervals([*singles, *pairs]),
        *_gain(singles),
        *_literal(of(lines, "literal")),
        *_times(lines),
    ]


def _slip_sinkage(singles: Sequence[Line]) -> list[Figure]:
    own = [x for x in singles if families(x) == ["slip_sinkage"] and x["members"][0]["d_sep"] > 5]
    apart = [x for x in own if x["members"][0]["d_forms"] > 5 and not x["members"][0]["variant"]]

    def top(x: Line) -> bool:
        return x["verdict"] in ("named", "one_of") and candidates(x, none=False)[:1] == ["slip_sinkage"]

    def form(x: Line) -> bool:
        return [c["form"] for c in x["causes"] if c["name"] == "slip_sinkage"] == [x["members"][0]["key"]]

    return [
        share("slip sinkage named or top of one_of, d_sep > 5", ">= .98", own, top),
        share("its form, where forms stand apart", ">= .85", apart, form),
    ]


def _top_one(singles: Sequence[Line], nulls: Sequence[Line]) -> list[Figure]:
    out = []
    for at in LEVELS:
        own = [x for x in singles if level(x) == at]
        for none, key in ((True, "right"), (False, "right_forced")):
            best = float(np.mean([x["oracle"][key] for x in own])) if own else 0.0
            out.append(
                share(
                    f"top-1 family, {'none allowed' if none else 'forced'}, L = {at:g}",
                    ">= .9 of the oracle's",
                    own,
                    lambda x, none=none: candidates(x, none=none)[:1] == families(x),
                    beside=f"oracle {best:.2f}",
                )
            )
    best = float(np.mean([x["oracle"]["right"] for x in nulls])) if nulls else 0.0
    out.append(
        share(
            "top-1 is none on nulls", "", nulls, lambda x: candidates(x, none=True)[0] == "none", f"oracle {best:.2f}"
        )
    )
    return out


def _precision(lines: Sequence[Line]) -> list[Figure]:
    out = []
    for least, to_reach in ((0.9, ">= .97"), (0.99, ">= .99")):
        stated = [(name, x) for x in lines for name in said(x, least)]
        right = sum(name in families(x) for name, x in stated)
        out.append(Figure(f"stated names right, p > {least:g} (nulls, singles, pairs)", to_reach, right, len(stated)))
    return out


def _set_lengths(lines: Sequence[Line]) -> list[Figure]:
    lengths = [len(x["causes"]) for x in lines if x["verdict"] == "one_of"]
    return [Figure("length of a one_of set, median", "", n=len(lengths), value=_median(lengths))]


def _outside(lines: Sequence[Line]) -> list[Figure]:
    loud = [x for x in lines if x["members"][0]["L"] >= 1.9]
    plain = _unlike(loud, 5.0)
    fresh = [x for x in plain if x["seed"] >= FRESH["outside"]]
    singly = [x for x in loud if x["members"][0]["d_sep"] > 5]
    return [
        share("outside the library, no look-alike, L >= 2: unexplained", ">= .98", plain, _unexplained),
        share("the same, on seeds that nobody had seen", "", fresh, _unexplained),
        share("the same, all seeds, plainly no look-alike (three leave 8 sigma)", "", _unlike(loud, 8.0), _unexplained),
        share("the same, unlike any one family (d_sep > 5), three may still imitate it", "", singly, _unexplained),
        share("the same, look-alikes too", "", loud, _unexplained),
        share("outside: confidently wrong (named at p > .9)", "", loud, _named),
    ]


def _unlike(lines: Sequence[Line], sigmas: float) -> list[Line]:
    """Return the campaigns that the best three other families leave more than so many sigma of."""
    return [x for x in lines if x["left_by_three"] > sigmas]


def _unexplained(x: Line) -> bool:
    return bool(x["verdict"] == "unexplained")


def _left_out(lines: Sequence[Line]) -> list[Figure]:
    apart = [x for x in lines if x["members"][0]["d_sep"] > 5]
    plain = _unlike(apart, 5.0)
    fresh = [x for x in plain if x["seed"] >= FRESH["left_out"]]
    what = "one family left out, d_sep > 5: confidently wrong"
    return [
        share(what, "<= .05", apart, _named),
        share("the same, where no three of the rest imitate it", "", plain, _named),
        share("the same, on seeds that nobody had seen", "", fresh, _named),
        share("the same, all seeds, where three plainly do not (they leave 8 sigma)", "", _unlike(apart, 8.0), _named),
    ]


def _named(x: Line) -> bool:
    return bool(said(x, 0.9))


def _pairs(lines: Sequence[Line]) -> list[Figure]:
    apart = [x for x in lines if all(m["d_sep"] > 5 for m in x["members"])]
    stated = [(name, x) for x in apart for name in said(x)]
    right = sum(name in families(x) for name, x in stated)
    return [
        share("pairs, both d_sep > 5: exact set", ">= .75", apart, lambda x: sorted(said(x)) == sorted(families(x))),
        Figure("pairs: stated members right", ">= .97", right, len(stated)),
    ]


def _intervals(lines: Sequence[Line]) -> list[Figure]:
    out = []
    for source, words in (("", "95 % intervals, pooled"), ("given_truth", "the same, fit given the true cause")):
        found = intervals(lines, source)
        out.append(Figure(words, ".92 to .98, n >= 500", sum(i.inside for i in found), len(found)))
    return out


def _gain(singles: Sequence[Line]) -> list[Figure]:
    both = [(x, pull_r0(x), pull_r0(x, "given_truth")) for x in singles]
    ratios = [(x, ours / best) for x, ours, best in both if ours and best]
    apart = [ratio for x, ratio in ratios if tellable(x["members"][0]) == "named"]
    what = "held-out R0 over that of the fit given the true cause, median"
    return [
        Figure(f"{what}, where the data can tell the name", "<= 1.05", n=len(apart), value=_median(apart)),
        Figure(f"{what}, wherever it was fitted", "<= 1.05", n=len(ratios), value=_median([r for _, r in ratios])),
    ]


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None


def _literal(lines: Sequence[Line]) -> list[Figure]:
    what = "literal simulation of a balanced soil: closed_form_sinkage named"
    return [share(what, "", lines, lambda x: said(x) == ["closed_form_sinkage"])]


def _times(lines: Sequence[Line]) -> list[Figure]:
    whole = [x["engine_s"] for x in lines]
    evidence = [sum(x["stages_s"].get(stage, 0.0) for stage in _GIVEN_NOISE) for x in lines]
    return [
        Figure("whole diagnosis, median seconds on a shared machine", "<= 15", n=len(whole), value=_median(whole)),
        Figure(
            "its evidence stage, noise given, median seconds",
            "<= 1",
            n=len(evidence),
            value=_median(evidence),
        ),
    ]


def write_report(out: Path, wanted: set[str] | None, path: Path) -> None:
    """Write the tables and their JSON."""
    lines = joined(out, wanted)
    rows = figures(lines)
    path.write_text(_markdown(lines, rows), encoding="utf-8")
    content = {
        "cases": dict(Counter(x["kind"] for x in lines)),
        "figures": [asdict(row) | {"reached": row.reached, "bounds": row.bounds} for row in rows],
    }
    path.with_suffix(".json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _markdown(lines: Sequence[Line], rows: Sequence[Figure]) -> str:
    kinds = Counter(x["kind"] for x in lines)
    frames = sum(x["frames"] for x in lines)
    text = [
        "# Blind study: hidden causes, and what the diagnosis said",
        "",
        "Written by `make blind`. A generator with physics, numerics and instruments of its own (`tests/blind/`) hides",
        "a cause and hands over recordings. L, d, d_sep and the oracle come from its truth: L is the effect over the",
        "instruments' noise per 5 Hz sample, d over the campaign with the laboratory's soil and the scatter of runs",
        "projected out, d_sep what is left of d when the best other family explains it too.",
        "What the data can tell: d < 2 nothing; 2 to 5 nothing, or one_of with the truth; d > 5 and d_sep < 5 one_of",
        "with it, or the name; d_sep > 5 the name. The oracle knows noise, soil spread, run scatter and case mix.",
        "",
        f"Cases: {', '.join(f'{n} {kind}' for kind, n in kinds.items())}; {frames} of {len(lines)} through frames, the",
        "others from channels; seeds from 0; clay and sandy by turns; loads 8, 11, 13 kN; six runs of 40 s.",
        "Bounds are Clopper-Pearson, 95 %.",
        "",
        "| figure | to reach | reached | n | 95 % bounds | beside |",
        "|---|---|---|---|---|---|",
        *(_row(row) for row in rows),
        "",
        *_by_family(lines),
        *_by_interval(lines),
        *_substitutions(lines),
        *_hidden(),
    ]
    return "\n".join(text) + "\n"


def _row(row: Figure) -> str:
    reached = "-" if row.reached is None else f"{row.reached:.3g}"
    bounds = "-" if row.value is not None or not row.n else "{:.3f} to {:.3f}".format(*row.bounds)
    hits = f" ({row.hits})" if row.value is None and row.n else ""
    return f"| {row.what} | {row.to_reach} | {reached}{hits} | {row.n} | {bounds} | {row.beside} |"


def _by_family(lines: Sequence[Line]) -> list[str]:
    singles = of(lines, "single")
    head = ["## Singles by family: right verdict / top-1 / n at each L, median d and d_sep", ""]
    head += ["| family | " + " | ".join(f"L = {at:g}" for at in LEVELS) + " |", "|---|" + "---|" * len(LEVELS)]
    for family in FAMILIES:
        cells = []
        for at in LEVELS:
            own = [x for x in singles if families(x) == [family] and level(x) == at]
            if not own:
                cells.append("-")
                continue
            right = sum(right_verdict(x) for x in own)
            top = sum(candidates(x, none=True)[:1] == [family] for x in own)
            d, apart = (median(x["members"][0][key] for x in own) for key in ("d", "d_sep"))
            cells.append(f"{right}/{top}/{len(own)}, d {d:.0f}, {apart:.1f}")
        head.append(f"| {family} | " + " | ".join(cells) + " |")
    return [*head, ""]


def _by_interval(lines: Sequence[Line]) -> list[str]:
    found = intervals([*of(lines, "single"), *of(lines, "pair")])
    out = ["## Intervals by family", "", "| family | inside | n | mean z | sd of z |", "|---|---|---|---|---|"]
    for family in FAMILIES:
        own = [i for i in found if i.family == family]
        if own:
            z = np.array([i.z for i in own])
            inside = sum(i.inside for i in own) / len(own)
            out.append(f"| {family} | {inside:.2f} | {len(own)} | {z.mean():.2f} | {z.std():.2f} |")
    return [*out, ""]


def _substitutions(lines: Sequence[Line]) -> list[str]:
    wrong: Counter[tuple[str, str, str]] = Counter()
    for x in lines:
        names = [name for name in said(x, 0.9) if name not in families(x)]
        if names and x["kind"] != "literal":
            hidden = families(x)[0] if x["members"] and families(x)[0] else _what(x)
            wrong[hidden, x["kind"], ", ".join(sorted(names))] += 1
    out = [
        "## Named at p > .9 instead of what was hidden",
        "",
        "| hidden | kind | named | campaigns |",
        "|---|---|---|---|",
    ]
    return [*out, *(f"| {hidden} | {kind} | {names} | {n} |" for (hidden, kind, names), n in wrong.most_common()), ""]


def _what(x: Line) -> str:
    return x["members"][0]["key"] if x["members"] else "nothing"


def _hidden() -> list[str]:
    head = ["## What is hidden, and how", "", "| key | family | formula | the engine has it |", "|---|---|---|---|"]
    rows = (
        f"| {h.key} | {h.family or '-'} | {h.formula} | {'yes' if not h.variant and not h.outside else 'no'} |"
        for h in ALL.values()
    )
    return [*head, *rows]
