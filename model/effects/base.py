"""What an effect (a hypothesis about the measured wheel) is: one file, its parameters and the hooks it needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from model.dual import Dual, Number

if TYPE_CHECKING:
    from model.wheel_soil import Conditions, SoilState


@dataclass(frozen=True)
class Parameter:
    """A number to be estimated.

    Attributes
    ----------
    name, unit : str
    neutral : float
        The value at which the effect is not there.
    start : float
        Where an estimate starts.
    lower, upper : float
        Bounds of an estimate.
    prior_scale : float
        One-sigma of what is plausible before any data.
    source : str
    """

    name: str
    unit: str
    neutral: float
    start: float
    lower: float
    upper: float
    prior_scale: float
    source: str = ""


Values = Mapping[str, Number]


class Effect:
    """A change of the base model that vanishes at its parameters' neutral values.

    A subclass states the class variables and overrides only the hooks it needs. Hooks are plain numpy formulas on
    columns (n, 1) and get sensitivities by themselves (`model.dual`): no ``if`` on a value, `model.dual.where` instead.

    Attributes
    ----------
    name, form : str
        Family and form; ``form`` is empty where the family has one form only.
    kind : "physical" or "measurement"
    summary, source : str
        What a report says of it, and where the formula is from.
    parameters : tuple of Parameter
    """

    name: ClassVar[str]
    form: ClassVar[str] = ""
    kind: ClassVar[Literal["physical", "measurement"]] = "physical"
    summary: ClassVar[str]
    source: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil's parameters under the given conditions."""
        return soil

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return Z in metres from the static Z0."""
        return static_sinkage

    @classmethod
    def moves_sinkage(cls) -> bool:
        """Whether the effect sets a sinkage other than the static one."""
        return cls.sinkage is not Effect.sinkage

    @classmethod
    def changes_soil(cls) -> bool:
        """Whether the effect changes the soil, and with it the static sinkage."""
        return cls.soil is not Effect.soil

    @classmethod
    def is_active(cls, values: Values) -> bool:
        """Whether any parameter differs from neutral or is to be differentiated."""
        return any(isinstance(values[p.name], Dual) or bool(values[p.name] != p.neutral) for p in cls.parameters)

    @classmethod
    def key(cls) -> str:
        """Return the short unique name: the form where there is one, else the family."""
        return cls.form or cls.name
