"""The library of effects: one hypothesis a file; `EFFECTS` lists them by their short name."""

from __future__ import annotations

from model.effects.base import Effect, Parameter
from model.effects.ding import Ding
from model.effects.lyasko import Lyasko
from model.effects.vasilev import Vasilev

EFFECTS: dict[str, type[Effect]] = {effect.key(): effect for effect in (Vasilev, Lyasko, Ding)}
"""Every known effect: form where the family has several, else family."""

__all__ = ["EFFECTS", "Ding", "Effect", "Lyasko", "Parameter", "Vasilev"]
