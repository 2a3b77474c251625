"""How often a transducer that drifts is flagged and named, and a sound one is not, also on a wheel wrongly described.

``PYTHONPATH=tests python -m studies.passports.study [seeds]``. Twelve months, three transducers, twenty campaigns of
two runs of 40 s for each, on soils that are drawn. In one of the three the gain of drawbar pull drifts by nothing, 0.1
or 0.5 % a month. Campaigns are made as in tests/blind, by another formula, rate and quadrature than the engine's. What
each says is kept in out/passports, so that a second start continues there. Seeds 0 to n - 1.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from blind.engine import campaign_from_channels
from blind.field import field_day
from blind.world import World
from scipy.stats import beta

from model.diagnosis.findings.adequacy import excess
from model.diagnosis.pooling import Observation, Passport, passport_of
from model.diagnosis.time_series.linearised_campaign import linearise_campaigns
from wheelsoil.cache.codec import from_bytes, to_bytes

TRANSDUCERS, CAMPAIGNS, RUNS = 3, 20, 2
DRIFTS = (0.0, 0.1, 0.5)
"""Percent a month."""
OF = "drawbar_pull_gain"
SHARED = {"bulldozing": 0.05, "grouser": 0.002, "wheel_radius": 0.005}
"""What the engine is not told of the vehicle: the same in all campaigns, in the effects' SI units."""
SHARED_SEEDS = 8
KEPT = Path("out") / "passports"
RESULTS = Path(__file__).with_name("results.json")


def months(seed: int, transducer: int) -> list[float]:
    """Return when the campaigns of a transducer are driven."""
    return sorted(np.random.default_rng((seed, transducer, 99)).uniform(0.0, 12.0, CAMPAIGNS).tolist())


def observed(seed: int, transducer: int, number: int, drift: float = 0.0, shared: str = "") -> Observation:
    """Return what a campaign says, made or kept; `shared` is of SHARED."""
    kept = KEPT / f"{seed}_{transducer}_{number}_{shared or format(drift, 'g')}"
    when = months(seed, transducer)[number]
    if not kept.exists():
        soil = "clay" if (transducer + number) % 2 else "sandy"
        day = field_day(soil, (seed, transducer, number), world=World(soil, runs=RUNS))
        hidden = [(shared, SHARED[shared])] if shared else [(OF, drift / 100.0 * when)] if drift else []
        campaign = campaign_from_channels(day, hidden)
        found = linearise_campaigns([campaign])
        kept.write_bytes(to_bytes(found.information(excess(found.grams, found.best.keys))))
    return Observation(str(number), when / 12.0, from_bytes(bytearray(kept.read_bytes())))


def passport(seed: int, transducer: int, drift: float) -> Passport:
    """Return the passport of a transducer; `drift` is its own."""
    return passport_of(str(transducer), [observed(seed, transducer, i, drift) for i in range(CAMPAIGNS)])


def one(seed: int) -> dict[str, Any]:
    """Return what is said of the transducers of a seed."""
    wrong = seed % TRANSDUCERS
    sound = [passport(seed, i, 0.0) for i in range(TRANSDUCERS)]
    found: dict[str, Any] = {"seed": seed, "0": [_told(one) for one in sound]}
    for drift in DRIFTS[1:]:
        others = [each for i, each in enumerate(sound) if i != wrong]
        found[f"{drift:g}"] = {"wrong": _told(passport(seed, wrong, drift)), "others": [_told(one) for one in others]}
    return found


def wrongly_described(shared: str) -> list[dict[str, Any]]:
    """Return what is said of sound transducers on a vehicle that is not as described."""
    of = [[observed(seed, 0, i, shared=shared) for i in range(CAMPAIGNS)] for seed in range(SHARED_SEEDS)]
    found = [passport_of(str(seed), each) for seed, each in enumerate(of)]
    return [
        _told(one) | {"shared": one.shared[0].effect, "share": round(one.shared[0].probability, 3)} for one in found
    ]


def _told(one: Passport) -> dict[str, Any]:
    trend = one.trends[OF]
    slope, sigma = (100.0 / 12.0 * x for x in trend.per_year)
    return {
        "decision": one.decision,
        "effects": list(one.effects),
        "wrong": round(one.wrong, 5),
        "leading": one.candidates[0].effect,
        "probability": round(one.candidates[0].probability, 5),
        "percent_a_month": [round(slope, 4), round(sigma, 4)],
        "disagree": list(one.disagree),
    }


def summary(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures: counts of n, with the Clopper-Pearson bound at 95 %."""

    def of(count: int, n: int) -> dict[str, Any]:
        lower = float(beta.ppf(0.05, count, n - count + 1)) if count else 0.0
        return {"count": count, "n": n, "at_least": round(lower, 3)}

    n = len(found)
    sound = [all(each["decision"] == "nothing" for each in one["0"]) for one in found]
    drifting = {key: [one[key]["wrong"] for one in found] for key in ("0.1", "0.5")}
    slopes = [(each["percent_a_month"], float(key)) for key, all_of in drifting.items() for each in all_of]
    covered = sum(abs(x - true) <= 1.96 * sigma for (x, sigma), true in slopes)
    return {
        "without drift nothing is flagged": of(sum(sound), n),
        "0.1 % a month: flagged": of(sum(each["decision"] != "nothing" for each in drifting["0.1"]), n),
        "0.1 % a month: named": of(sum(each["effects"] == [OF] for each in drifting["0.1"]), n),
        "0.1 % a month: another named": sum(
            each["decision"] == "named" and each["effects"] != [OF] for each in drifting["0.1"]
        ),
        "0.5 % a month: named or leading": of(sum(each["leading"] == OF for each in drifting["0.5"]), n),
        "0.5 % a month: named": of(sum(each["effects"] == [OF] for each in drifting["0.5"]), n),
        "slope's interval holds the truth": of(covered, len(slopes)),
        "decisions": {key: dict(Counter(each["decision"] for each in own)) for key, own in drifting.items()},
    }


def main(seeds: int = 20) -> None:
    """Work on the seeds and keep the results."""
    KEPT.mkdir(parents=True, exist_ok=True)
    found = [one(seed) for seed in range(seeds)]
    shared = {key: wrongly_described(key) for key in SHARED}
    figures = summary(found) | {
        f"{key} off by {size:g}: {decision}": sum(one["decision"] == decision for one in shared[key])
        for key, size in SHARED.items()
        for decision in ("nothing", "flagged", "named")
    }
    kept = {"figures": figures, "seeds": found, "wrongly described": shared}
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
