"""What the data cover, and which effects they can identify."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from daq import ROLES
from model.diagnosis.core.campaign import DiagnosisOptions
from model.effects.base import Effect, Needs
from model.effects.catalogue import EFFECTS

SAME_PASS = "every run is on the same pass: drive a second one in the rut of the first"
PRESSURE_UNKNOWN = "the inflation pressure is not known: taken as the same in every run"
USUAL = (SAME_PASS, PRESSURE_UNKNOWN)
"""What is wanting in nearly every campaign: it stands in the table, not in the sentence."""

_NAMES = {
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
ONE_LOAD = 0.08
"""Spread of loads, over their mean, below which they are one load."""


@dataclass(frozen=True)
class Coverage:
    """What some data hold, as `model.effects.base.Needs` asks for it.

    Attributes
    ----------
    conditions : set of str
        Fields of `Conditions` that are known in every row.
    channels, unused_channels : set of str
        Measured forces ("drawbar_pull", "driving_torque") that are used; that were measured and are not used.
    several_loads, both_directions, several_passes, several_runs, pressures, standstill, driven, braked : bool
    largest_slip : float
    tyre : "smooth", "lugged" or ""
        As declared.
    """

    conditions: frozenset[str]
    channels: frozenset[str]
    unused_channels: frozenset[str]
    several_loads: bool
    both_directions: bool
    several_passes: bool
    several_runs: bool
    pressures: bool
    standstill: bool
    driven: bool
    braked: bool
    largest_slip: float
    tyre: str


def considered(coverage: Coverage, options: DiagnosisOptions) -> tuple[type[Effect], ...]:
    """Return the effects of the options that can be there at all, and whose inputs are known."""
    effects = [EFFECTS[key] for key in options.effects if key in EFFECTS]
    return tuple(e for e in effects if e.reading in ("any", options.reading) and not ruled_out(e.needs, coverage))


def cannot_tell(coverage: Coverage) -> dict[str, str]:
    """Return, for families of which no form can be identified, a sentence that says why."""
    reasons: dict[str, list[str]] = {}
    for effect in EFFECTS.values():
        why = ruled_out(effect.needs, coverage) or next(_unmet(effect.needs, coverage), "")
        reasons.setdefault(effect.name, []).append(why if effect.reading == "any" else "")
    return {family: each[0] for family, each in reasons.items() if all(each)}


def ruled_out(needs: Needs, coverage: Coverage) -> str:
    """Return why an effect is not considered; empty where it is."""
    missing = [name for name in needs.conditions if name not in coverage.conditions]
    if missing:
        return f"{' and '.join(_NAMES.get(name, name) for name in missing)} is not known everywhere"
    return "the tyre is declared smooth" if needs.lugs and coverage.tyre == "smooth" else ""


def _unmet(needs: Needs, coverage: Coverage) -> Iterator[str]:
    """Yield why an effect that is considered is never named."""
    if needs.both_directions and not coverage.both_directions:
        yield "all runs go one way: drive some back"
    if needs.several_passes and not coverage.several_passes:
        yield SAME_PASS
    if needs.pressures and not coverage.pressures:
        yield PRESSURE_UNKNOWN
    if needs.two_loads and not coverage.several_loads:
        yield "one load only: drive with another added mass"
    if needs.several_runs and not coverage.several_runs:
        yield "one run only: a drift over the campaign does not show"
    if needs.braking and not coverage.braked:
        yield "the wheel was hardly ever braked"
    if needs.largest_slip and not coverage.driven:
        yield "the wheel was hardly ever driven"
    if needs.largest_slip and coverage.largest_slip < needs.largest_slip:
        yield f"the slip never was above {needs.largest_slip:g}"
    for channel in needs.channels:
        if channel in coverage.unused_channels:
            yield f"{ROLES[channel].name} was measured and not looked at"
        elif channel not in coverage.channels:
            yield f"{ROLES[channel].name} was not measured"
    if needs.standstill and not coverage.standstill:
        yield "no standstill was recorded: it would show the zeros"
