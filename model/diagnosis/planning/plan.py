"""Detectable and separable causes of a planned campaign, or of driven runs.

The runs are linearised as measured ones are, with the noise of the prior. Measured values are not used, only what is
driven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from daq import Note
from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.core.result import Detectable, NextRun
from model.diagnosis.findings.isolability import SEEN, Isolability, detectable_in_runs, isolability
from model.diagnosis.planning.next_run import Member, next_runs
from model.diagnosis.time_series.grams import Grams
from model.diagnosis.time_series.linearised_campaign import LinearisedCampaign, linearise_campaigns
from model.diagnosis.time_series.noise import Noise, beliefs
from model.diagnosis.time_series.samples import samples_of
from model.one_thread import one_thread

SCHEMA = "wheelsoil/plan/1"
ALIKE = 0.95
"""Cosine from which on causes count as confounded."""


@dataclass(frozen=True)
class Advice:
    """Causes that look alike, and what would part them, best first."""

    families: tuple[str, ...]
    next_runs: tuple[NextRun, ...]


@dataclass(frozen=True)
class Plan:
    """What a campaign can tell.

    Attributes
    ----------
    isolability : Isolability
        At one prior one-sigma of every parameter, or the sizes that were asked for.
    minimum_detectable : mapping effect key -> Detectable
        That something is there.
    minimum_separable : mapping effect key -> Detectable
        That it is this and no other family.
    cannot_tell : mapping family -> why
    """

    isolability: Isolability
    look_alikes: tuple[Advice, ...]
    minimum_detectable: dict[str, Detectable]
    minimum_separable: dict[str, Detectable]
    cannot_tell: dict[str, Note] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return what a program reads; infinite stays infinite, for the writer to turn into null."""
        found = self.isolability
        return {
            "schema": SCHEMA,
            "effects": [
                {
                    "name": family,
                    "key": key,
                    "left_by_soil": float(left),
                    "d": float(d),
                    "d_sep": float(apart),
                    "nearest": rival,
                    "minimum_detectable": vars(self.minimum_detectable[key]),
                    "minimum_separable": vars(self.minimum_separable[key]),
                }
                for key, family, left, d, apart, rival in zip(
                    found.keys,
                    found.families,
                    found.left,
                    found.deviation,
                    found.separation,
                    found.rivals,
                    strict=True,
                )
            ],
            "cosine": found.cosine.tolist(),
            "look_alikes": [
                {
                    "families": list(advice.families),
                    "next_run": [{**vars(run), "separates": list(run.separates)} for run in advice.next_runs],
                }
                for advice in self.look_alikes
            ],
            "cannot_tell": self.cannot_tell,
            "notes": list(self.notes),
        }


@one_thread
def plan_of(
    campaigns: Sequence[Campaign],
    options: DiagnosisOptions | None = None,
    sizes: Mapping[str, Sequence[float]] | None = None,
    *,
    advise: bool = True,
) -> Plan:
    """Say what campaigns can tell apart: planned ones (`model.diagnosis.planning.planned_runs`) or driven ones.

    Parameters
    ----------
    sizes : mapping key -> coefficients, optional
        In units of the prior scale; see `isolability`.
    advise : bool
        List for confounded causes the runs that would separate them.

    Raises
    ------
    DataError
        As `linearise_campaigns`.
    """
    chosen = options or DiagnosisOptions()
    seen = linearise_campaigns(campaigns, chosen, [_thought_of(campaign, chosen) for campaign in campaigns])
    return plan_from_linearised(seen, chosen, sizes, advise=advise)


@one_thread
def plan_from_linearised(
    seen: LinearisedCampaign,
    options: DiagnosisOptions | None = None,
    sizes: Mapping[str, Sequence[float]] | None = None,
    *,
    advise: bool = True,
) -> Plan:
    """Say what runs that were looked at can tell apart, with the noise that they have.

    Parameters
    ----------
    options, sizes, advise
        As for `plan_of`.
    """
    chosen = options or DiagnosisOptions()
    found = isolability(seen.grams, sizes)
    groups = found.look_alikes(ALIKE)
    detectable = detectable_in_runs(seen.grams, name_at=chosen.name_at)
    return Plan(
        isolability=found,
        look_alikes=tuple(Advice(g, _advice(seen, found, g) if advise else ()) for g in groups),
        minimum_detectable=detectable,
        minimum_separable={key: _separable(seen.grams, found, i) for i, key in enumerate(found.keys)},
        cannot_tell=seen.cannot_tell,
        notes=seen.notes,
    )


def _thought_of(campaign: Campaign, options: DiagnosisOptions) -> Noise:
    return Noise({name: b.centre for name, b in beliefs(samples_of(campaign, options.channels)).items()})


def _advice(seen: LinearisedCampaign, found: Isolability, group: tuple[str, ...]) -> tuple[NextRun, ...]:
    """Return what would part a group of families, each by its first form, at twice the size that is seen."""
    members = []
    for family in group:
        i = found.families.index(family)
        if found.deviation[i] > 0:
            key = found.keys[i]
            members.append(Member(key, found.sizes[key] * 2.0 * SEEN / float(found.deviation[i])))
    return next_runs(seen, tuple(members), most=3)


def _separable(grams: Grams, found: Isolability, i: int) -> Detectable:
    """Return the size of an effect's first parameter from which on it is separable from every other family."""
    key = found.keys[i]
    cause = next(c for c in grams.causes if c.key == key)
    apart = float(found.separation[i])
    share = SEEN / apart if apart > 0 else float("inf")
    return Detectable(cause.parameter, cause.neutral + share * float(found.sizes[key][0]) * cause.scale, cause.unit)
