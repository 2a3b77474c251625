"""Part of the load shows in drawbar pull."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from model.effects.base import Effect, Needs, Parameter, Values

if TYPE_CHECKING:
    from model.effects.signals import Signals
    from model.wheel_soil.conditions import Reaction, WheelState


class Crosstalk(Effect):
    """Measured Dp = true Dp + k W with the true load; a tilt of the transducer by k rad does the same."""

    name = "crosstalk"
    kind = "measurement"
    summary = "A share of the vertical load shows in drawbar pull: cross-talk of the bridges, or a tilted transducer."
    source = "MTS Systems (2008), SWIFT 30 manual: cross-talk matrix (KFXFZ -0.003); usually 0.3 to 1 %"
    shows = ("drawbar_pull",)
    parameters = (Parameter("coefficient", "1", 0.0, 0.01, -0.3, 0.3, 0.02, "1 deg of tilt is 0.017"),)
    needs = Needs(channels=("drawbar_pull",), two_loads=True, standstill=True)
    at_standstill = True
    stage = 2

    def observation(self, reaction: Reaction, state: WheelState, values: Values) -> Reaction:
        """Return what the transducer reads."""
        load = state.conditions.vertical_load_n
        return replace(reaction, drawbar_pull=reaction.drawbar_pull + values["coefficient"] * load)

    def sensed(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        """Return the signals with what the transducer makes of them."""
        pull = signals.drawbar_pull_n + values["coefficient"] * signals.vertical_load_n
        return replace(signals, drawbar_pull_n=pull)
