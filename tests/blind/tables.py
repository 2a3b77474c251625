"""docs/blind_results.md and its JSON: every figure with its n and its bound."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import median
from textwrap import wrap

import numpy as np
from blind.causes import ALL, FAMILIES
from blind.figures import (
    ALL_NAMES_RIGHT,
    FALSE_UNEXPLAINED,
    LEVELS,
    LISTED_OR_NOT,
    NAMES_RIGHT,
    NULLS_NAMED,
    Aim,
    Figure,
    Line,
    candidates,
    families,
    intervals,
    level,
    loose_verdict,
    most_probable_set,
    named_causes,
    of,
    oracle_verdict,
    pull_r0,
    reliability,
    right_foreign_verdict,
    right_verdict,
    said,
    share,
    tellable,
)
from blind.foreign import FOREIGN
from blind.provenance import engine_words
from blind.study import by_name

BLOCKS = "blind_blocks.json"
_INTRODUCTION = """
 Written by `make blind`. A generator with physics, numerics and instruments of its own (`tests/blind/`) hides a
cause and hands over recordings. Each campaign draws its world: soil, wheel (.15 to .6 m), loads, outboard mass,
3 to 12 runs of 15 to 60 s, noise of two or three memories or with the spectrum of real recordings, heavy tails,
lost frames, GNSS memory of .1 to 4 s, tilted ground, brakes held or released. L, d, d_sep and the oracle come
from its truth: L is the effect over the instruments' noise per 5 Hz sample, d over the campaign with the
laboratory's soil and the scatter of runs projected out, d_sep what is left of d when the best other family
explains it too. What the data can tell: d < 2 nothing; 2 to 5 nothing, or one_of with the truth; d > 5 and
d_sep < 5 one_of with it, or the name; d_sep > 5 the name. The oracle knows noise, soil spread, run scatter and
case mix, and names above .9. Pairs are drawn until both members have d_sep > 5, before the engine sees anything. A
foreign wheel is right where it is unexplained, or one of a set with the family that it is akin to.
"""
_GIVEN_NOISE = ("linearise", "columns", "whitening", "smoothing", "evidence", "bagging")
"""Stages of a diagnosis whose noise model is known."""


def joined(out: Path, wanted: set[str] | None = None) -> list[Line]:
    """Return the lines of a study that are complete."""
    truths, answers = by_name(out / "truth.jsonl"), by_name(out / "answers.jsonl")
    return [truths[name] | answers[name] for name in truths if name in answers and (wanted is None or name in wanted)]


def figures(lines: Sequence[Line]) -> list[Figure]:
    """Return the table of the study."""
    nulls, singles, pairs = (of(lines, kind) for kind in ("null", "single", "pair"))
    return [
        *_safety(lines),
        share('nulls that are not "nothing"', Aim(most=0.02), nulls, lambda x: x["verdict"] != "nothing_detectable"),
        _verdicts([*nulls, *singles]),
        share("the same, a right name never being wrong", None, [*nulls, *singles], loose_verdict),
        *_slip_sinkage(singles),
        *_top_one(singles, nulls),
        *_set_lengths([*nulls, *singles]),
        *_outside(of(lines, "outside")),
        *_left_out(of(lines, "left_out")),
        *_foreign(of(lines, "foreign")),
        *_pairs(pairs),
        *_intervals([*singles, *pairs]),
        *_gain(singles),
        *_literal(of(lines, "literal")),
        *_times(lines),
    ]


def _verdicts(lines: Sequence[Line]) -> Figure:
    """Return how often the verdict is right for what the data can tell, beside the oracle's."""
    known = [oracle_verdict(x) for x in lines if "verdicts" in (x["oracle"] or {})]
    beside = f"oracle {sum(known) / len(known):.3f}" if known else ""
    what = "verdict right for what the data can tell"
    return share(what, Aim(least=0.93), lines, right_verdict, beside)


def _safety(lines: Sequence[Line]) -> list[Figure]:
    """Return the gates, the one over all campaigns first."""
    listed = [x for x in lines if x["kind"] in ("null", "single", "pair")]
    library = [x for x in listed if x["kind"] != "pair"]
    everything = [x for x in lines if x["kind"] in LISTED_OR_NOT]
    unlisted = sum(x["kind"] in ("outside", "left_out") for x in lines) / max(
        sum(bool(x["members"]) for x in everything), 1
    )
    beside = f"aimed at .96; unlisted {unlisted:.2f} of those with a cause"
    return [
        Figure(
            "names right over all campaigns, listed causes or not",
            ALL_NAMES_RIGHT,
            *named_causes(everything),
            beside=beside,
        ),
        Figure("names right, listed causes (nulls, singles, pairs)", NAMES_RIGHT, *named_causes(listed)),
        share("nulls: a cause named", NULLS_NAMED, of(lines, "null"), lambda x: bool(said(x))),
        share("false `unexplained`, nulls and singles", FALSE_UNEXPLAINED, library, _unexplained),
        Figure(
            "names right over all campaigns but those of unlisted causes that three listed ones explain, too",
            None,
            *named_causes([*listed, *_unlike([x for x in everything if x not in listed], 5.0)]),
        ),
    ]


def _foreign(lines: Sequence[Line]) -> list[Figure]:
    keys = sorted({x["members"][0]["key"] for x in lines})
    kinds = [[x for x in lines if x["members"][0]["key"] == key] for key in keys]
    return [
        share("foreign wheels: right (unexplained, or akin)", None, lines, right_foreign_verdict),
        share(
            "foreign wheels: nothing detectable", Aim(most=0.0), lines, lambda x: x["verdict"] == "nothing_detectable"
        ),
        *(
            share(f"foreign wheels: right, {key}", None, own, right_foreign_verdict)
            for key, own in zip(keys, kinds, strict=True)
        ),
    ]


def _slip_sinkage(singles: Sequence[Line]) -> list[Figure]:
    own = [x for x in singles if families(x) == ["slip_sinkage"] and x["members"][0]["d_sep"] > 5]
    apart = [x for x in own if x["members"][0]["d_forms"] > 5 and not x["members"][0]["variant"]]

    def top(x: Line) -> bool:
        return x["verdict"] in ("named", "one_of") and candidates(x, none=False)[:1] == ["slip_sinkage"]

    def form(x: Line) -> bool:
        return [c["form"] for c in x["causes"] if c["name"] == "slip_sinkage"] == [x["members"][0]["key"]]

    return [
        share("slip sinkage named or top of one_of, d_sep > 5", Aim(least=0.98), own, top),
        share("its form, where forms stand apart", Aim(least=0.85), apart, form),
    ]


def _top_one(singles: Sequence[Line], nulls: Sequence[Line]) -> list[Figure]:
    out = []
    for at in LEVELS:
        own = [x for x in singles if level(x) == at]
        for none, key in ((True, "right"), (False, "right_forced")):
            best = float(np.mean([x["oracle"][key] for x in own])) if own else 0.0
            counted = share(
                f"top-1 family, {'none allowed' if none else 'forced'}, L = {at:g}",
                Aim(least=0.9, of_oracle=True),
                own,
                lambda x, none=none: candidates(x, none=none)[:1] == families(x),
            )
            out.append(replace(counted, beside=f"oracle {best:.2f}", oracle=best))
    out.append(share("top-1 is none on nulls", None, nulls, lambda x: candidates(x, none=True)[0] == "none"))
    return out


def _set_lengths(lines: Sequence[Line]) -> list[Figure]:
    lengths = [len(x["causes"]) for x in lines if x["verdict"] == "one_of"]
    return [Figure("length of a one_of set, median", n=len(lengths), value=_median(lengths))]


def _outside(lines: Sequence[Line]) -> list[Figure]:
    loud = [x for x in lines if x["members"][0]["L"] >= 1.9]
    plain = _unlike(loud, 5.0)
    singly = [x for x in loud if x["members"][0]["d_sep"] > 5]
    return [
        share(
            "outside the library, not confounded with any three, L >= 2: unexplained",
            Aim(least=0.95),
            plain,
            _unexplained,
        ),
        share("the same, clearly not (three leave 8 sigma)", None, _unlike(loud, 8.0), _unexplained),
        share("the same, separable from any one family (d_sep > 5), not always from three", None, singly, _unexplained),
        share("the same, confounded ones too", None, loud, _unexplained),
        share("outside: confidently wrong (named)", None, loud, _named),
    ]


def _unlike(lines: Sequence[Line], sigmas: float) -> list[Line]:
    """Return the campaigns that the best three other families leave more than so many sigma of."""
    return [x for x in lines if x["left_by_three"] > sigmas]


def _unexplained(x: Line) -> bool:
    return bool(x["verdict"] == "unexplained")


def _left_out(lines: Sequence[Line]) -> list[Figure]:
    apart = [x for x in lines if x["members"][0]["d_sep"] > 5]
    what = "one family left out, d_sep > 5: confidently wrong"
    return [
        share(what, Aim(most=0.05), apart, _named),
        share("the same, not confounded with any three of the rest", None, _unlike(apart, 5.0), _named),
        share("the same, clearly not (three leave 8 sigma)", None, _unlike(apart, 8.0), _named),
    ]


def _named(x: Line) -> bool:
    return bool(said(x))


def _pairs(lines: Sequence[Line]) -> list[Figure]:
    exact = "pairs, both d_sep > 5: exact set"
    return [
        share(exact, Aim(least=0.75), lines, lambda x: sorted(said(x)) == sorted(families(x))),
        share("the same, by the most probable set", None, lines, lambda x: most_probable_set(x) == sorted(families(x))),
        Figure("pairs: stated members right", Aim(least=0.97), *named_causes(lines)),
    ]


def _intervals(lines: Sequence[Line]) -> list[Figure]:
    out = []
    for source, words in (
        ("", "95 % intervals, as stated"),
        ("given_fit", "the same, fit given the true cause, every single"),
    ):
        found = intervals(lines, source)
        out.append(Figure(words, Aim(0.92, 0.98), sum(i.inside for i in found), len(found)))
    return out


def _gain(singles: Sequence[Line]) -> list[Figure]:
    both = [(x, pull_r0(x), pull_r0(x, "given_truth")) for x in singles]
    ratios = [(x, ours / best) for x, ours, best in both if ours and best]
    apart = [ratio for x, ratio in ratios if tellable(x["members"][0]) == "named"]
    what = "held-out R0 over that of the fit given the true cause, median"
    most = Aim(most=1.05)
    return [
        Figure(f"{what}, where the data can tell the name", most, n=len(apart), value=_median(apart)),
        Figure(f"{what}, wherever it was fitted", most, n=len(ratios), value=_median([r for _, r in ratios])),
    ]


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None


def _literal(lines: Sequence[Line]) -> list[Figure]:
    what = "literal simulation of a balanced soil: closed_form_sinkage named"
    return [share(what, None, lines, lambda x: said(x) == ["closed_form_sinkage"])]


def _times(lines: Sequence[Line]) -> list[Figure]:
    whole = [x["engine_cpu_s"] for x in lines]
    evidence = [sum(x["stages_s"].get(stage, 0.0) for stage in _GIVEN_NOISE) for x in lines]
    what = "its evidence stage, noise given, median seconds"
    return [
        Figure("whole diagnosis, median CPU seconds", Aim(most=15.0), n=len(whole), value=_median(whole)),
        Figure(what, Aim(most=1.0), n=len(evidence), value=_median(evidence)),
    ]


def write_report(out: Path, wanted: set[str] | None, path: Path) -> None:
    """Write the page of a study and its JSON, and keep its gates in the list of blocks beside it."""
    lines = joined(out, wanted)
    missing = sorted((wanted or set()) - {x["name"] for x in lines})
    rows = figures(lines)
    engines = list(dict.fromkeys(engine_words(x["engine"]) for x in lines))
    blocks = _kept_blocks(path.parent / BLOCKS, lines, rows, engines, missing)
    path.write_text(_markdown(lines, rows, engines, blocks, missing), encoding="utf-8")
    content = {
        "cases": dict(Counter(x["kind"] for x in lines)),
        "engines": engines,
        "figures": [
            asdict(row)
            | {"aim": str(row.aim or ""), "reached": row.reached, "bounds": row.bounds, "passes": row.passes}
            for row in rows
        ],
        "reliability": [asdict(one) | {"bounds": one.bounds} for one in reliability(of(lines, "calibration"))],
    }
    path.with_suffix(".json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _kept_blocks(
    path: Path, lines: Sequence[Line], rows: Sequence[Figure], engines: list[str], missing: Sequence[str]
) -> list[Line]:
    """Return every block that was ever run, this one among them; a block that failed stays.

    One in which a case that a gate counts raised an error, or is not done yet, has not passed.
    """
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    for block in sorted({x["block"] for x in lines} - {-1}):
        gates = {row.what: f"{row.hits} of {row.n}" for row in rows if row.aim and row.aim.gate}
        whole = not any(name.partition("/")[0] in LISTED_OR_NOT for name in missing)
        passed = whole and all(row.passes for row in rows if row.aim and row.aim.gate)
        mine = {"block": block, "engine": "; ".join(engines), "campaigns": len(lines), "gates": gates, "passed": passed}
        known = [one for one in known if (one["block"], one["engine"]) != (block, mine["engine"])] + [mine]
    if known:
        path.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    return known


def _markdown(
    lines: Sequence[Line], rows: Sequence[Figure], engines: list[str], blocks: Sequence[Line], missing: Sequence[str]
) -> str:
    kinds = Counter(x["kind"] for x in lines)
    frames = sum(x["frames"] for x in lines)
    seeds = [x["seed"] for x in lines]
    text = [
        "# Blind study: hidden causes, and what the diagnosis said",
        "",
        *wrap(_INTRODUCTION.strip(), 118),
        "",
        f"Cases: {', '.join(f'{n} {kind}' for kind, n in kinds.items()) or 'none'}; {frames} of {len(lines)} through",
        f"frames, the others from channels; seeds {min(seeds, default=0)} to {max(seeds, default=0)}.",
        f"Engine: {'; '.join(engines) or 'none'}. Without a result, in no figure: {', '.join(missing) or 'none'}.",
        "Bounds are Clopper-Pearson, 95 %. A bound that is to be reached is the unfavourable one.",
        "",
        "| figure | to reach | reached | n | 95 % bounds | passes | beside |",
        "|---|---|---|---|---|---|---|",
        *(_row(row) for row in rows),
        "",
        *_by_block(blocks),
        *_by_probability(of(lines, "calibration")),
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
    passes = {None: "", True: "yes", False: "**no**"}[row.passes]
    return f"| {row.what} | {row.aim or ''} | {reached}{hits} | {row.n} | {bounds} | {passes} | {row.beside} |"


def _by_block(blocks: Sequence[Line]) -> list[str]:
    if not blocks:
        return []
    gates = list(blocks[-1]["gates"])
    head = ["## Blocks of seeds", "", "Block k has the seeds from 20,000 + 1,000 k. One that failed stays here.", ""]
    head += [
        f"| block | engine | campaigns | {' | '.join(gates)} | passed |",
        "|---|---|---|" + "---|" * (len(gates) + 1),
    ]
    for one in blocks:
        cells = " | ".join(one["gates"].get(gate, "-") for gate in gates)
        passed = "yes" if one["passed"] else "**no**"
        head.append(f"| {one['block']} | {one['engine']} | {one['campaigns']} | {cells} | {passed} |")
    return [*head, ""]


def _by_probability(lines: Sequence[Line]) -> list[str]:
    head = [
        "## Reliability of the stated probabilities",
        "",
        f"{len(lines)} campaigns drawn from the engine's own prior (no cause .5, one .35, two .12, three .03; sizes by",
        "the prior scale). Every family's probability, and that of no cause; `unexplained` states none.",
        "",
        "| stated | n | mean stated | share right | 95 % bounds |",
        "|---|---|---|---|---|",
    ]
    for one in reliability(lines):
        share_right = f"{one.hits / one.n:.3f}" if one.n else "-"
        low, high = one.bounds
        head.append(
            f"| {one.low:g} to {one.high:g} | {one.n} | {one.stated:.3f} | {share_right} | {low:.3f} to {high:.3f} |"
            if one.n
            else f"| {one.low:g} to {one.high:g} | 0 | - | - | - |"
        )
    return [*head, ""]


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
        names = [name for name in said(x) if name not in families(x) or x["kind"] == "left_out"]
        if names and x["kind"] not in ("literal", "foreign"):
            hidden = " + ".join(filter(None, families(x))) or _what(x)
            wrong[hidden, x["kind"], ", ".join(sorted(names))] += 1
    out = [
        "## Named instead of what was hidden",
        "",
        "| hidden | kind | named | campaigns |",
        "|---|---|---|---|",
    ]
    return [*out, *(f"| {hidden} | {kind} | {names} | {n} |" for (hidden, kind, names), n in wrong.most_common()), ""]


def _what(x: Line) -> str:
    return x["members"][0]["key"] if x["members"] else "nothing"


def _hidden() -> list[str]:
    head = ["## What is hidden, and how", "", "| key | family | formula | the engine has it |", "|---|---|---|---|"]
    foreign = (f"| {f.key} | {', '.join(f.families) or '-'} (akin) | {f.formula} | no |" for f in FOREIGN.values())
    rows = (
        f"| {h.key} | {h.family or '-'} | {h.formula} | {'yes' if not h.variant and not h.outside else 'no'} |"
        for h in ALL.values()
    )
    return [*head, *rows, *foreign]
