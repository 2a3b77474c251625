"""Which effects the data can tell at all, and what is missing for the others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.diagnosis.core.campaign import Campaign, DiagnosisOptions
from model.diagnosis.time_series.samples import Samples
from model.effects.base import Effect
from model.effects.catalogue import EFFECTS

_ONE_LOAD = 0.08
"""Spread of the runs' median loads, over their mean, below which they are one load."""
_SOME = 20
SAME_PASS = "every run is on the same pass: drive a second one in the rut of the first"
PRESSURE_UNKNOWN = "the inflation pressure is not known: taken as the same in every run"
USUAL = (SAME_PASS, PRESSURE_UNKNOWN)
"""What is wanting in nearly every campaign: it stands in the table, not in the sentence."""

NEEDED_WORDS = {
    "ground_speed_mps": "the ground speed",
    "wheel_speed_radps": "the wheel speed",
    "ground_acceleration_mps2": "the acceleration",
    "ground_jerk_mps3": "the change of the acceleration",
    "wheel_acceleration_radps2": "the wheel's acceleration",
    "line_position": "the place on the line",
    "campaign_time": "the campaign's clock",
    "direction": "the direction",
    "pass_number": "the number of the pass",
    "inflation_kpa": "the inflation pressure",
    "unit_weight_n_m3": "the soil's unit weight",
}


def considered(campaign: Campaign, samples: Samples, options: DiagnosisOptions) -> tuple[type[Effect], ...]:
    """Return the effects whose inputs are there, and that the reading and the tyre allow."""
    effects = [EFFECTS[key] for key in options.effects if key in EFFECTS]
    return tuple(
        effect
        for effect in effects
        if effect.reading in ("any", options.reading)
        and not (effect.name == "grouser" and campaign.tyre == "smooth")
        and not any(np.isnan(getattr(samples.conditions, name)).any() for name in effect.needs)
    )


def cannot_tell(campaign: Campaign, samples: Samples, effects: tuple[type[Effect], ...]) -> dict[str, str]:
    """Return, for families that the data cannot tell or cannot part from others, a sentence that says why.

    Parameters
    ----------
    campaign : Campaign
    samples : Samples
    effects : tuple of Effect classes
        Those that are considered.
    """
    found = dict(_without_inputs(campaign, samples, effects))
    for family, why in (*_not_varied(campaign, samples), *_not_seen(campaign, samples)):
        found.setdefault(family, why)
    return found


def _without_inputs(
    campaign: Campaign, samples: Samples, effects: tuple[type[Effect], ...]
) -> Iterator[tuple[str, str]]:
    left = {effect.name for effect in effects}
    for effect in EFFECTS.values():
        if effect.name in left or effect.reading == "literal":
            continue
        missing = [n for n in effect.needs if np.isnan(getattr(samples.conditions, n)).any()]
        if missing:
            words = " and ".join(NEEDED_WORDS.get(n, n) for n in missing)
            yield effect.name, f"{words} is not known in every run"
        elif effect.name == "grouser" and campaign.tyre == "smooth":
            yield effect.name, "the tyre is declared smooth"


def _not_varied(campaign: Campaign, samples: Samples) -> Iterator[tuple[str, str]]:
    runs = [run.run for run in campaign.runs]
    if len({run.direction for run in runs}) < 2:
        why = "all runs go one way: drive some back"
        for family in ("slope", "track_drift"):
            yield family, why
    if len({run.pass_number for run in runs}) < 2:
        yield "multi_pass", SAME_PASS
    if not any(run.inflation_kpa for run in runs):
        yield "tyre_flattening", PRESSURE_UNKNOWN
    load = np.asarray(samples.conditions.vertical_load_n)
    medians = [float(np.median(load[samples.run == i])) for i in range(samples.runs) if (samples.run == i).any()]
    if not medians or np.ptp(medians) < _ONE_LOAD * np.mean(medians):
        for family in ("crosstalk", "load_gain", "load_zero", "bulldozing", "drawbar_pull_zero"):
            yield family, "one load only: drive with another added mass"
    if len(runs) < 2:
        yield "zero_drift", "one run only: a drift over the campaign does not show"


def _not_seen(campaign: Campaign, samples: Samples) -> Iterator[tuple[str, str]]:
    slip = np.asarray(samples.conditions.slip)
    if np.count_nonzero(slip < 0) < _SOME:
        yield "skid_sinkage", "the wheel was hardly ever braked"
    if np.count_nonzero(slip > 0) < _SOME:
        yield "slip_sinkage", "the wheel was hardly ever driven"
    elif np.max(slip, initial=0.0) < 0.15:
        yield "slip_sinkage", "the slip never was above 0.15"
    if "t" not in samples.measured:
        for family in ("torque_zero", "torque_gain"):
            yield family, _without(campaign, "driving_torque_nm", "torque")
    if "dp" not in samples.measured:
        for family in ("drawbar_pull_zero", "drawbar_pull_gain", "crosstalk", "zero_drift", "slope"):
            yield family, _without(campaign, "drawbar_pull_n", "drawbar pull")
    if not len(samples.rests):
        for family in ("torque_zero", "drawbar_pull_zero", "crosstalk", "zero_drift", "slope"):
            yield family, "no standstill was recorded: it would show the zeros"


def _without(campaign: Campaign, field: str, words: str) -> str:
    measured = any(np.isfinite(getattr(run, field)).any() for run in campaign.runs)
    return f"{words} was measured and not looked at" if measured else f"{words} was not measured"
