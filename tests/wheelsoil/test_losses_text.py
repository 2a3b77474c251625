"""Lost frames as people read them."""

from __future__ import annotations

from wheelsoil.wording.losses import losses_as_texts

LOSSES = {"counter.can0.A": 1063, "wrapped.can0.A": 2, "counter.can0.B": 5, "missing.can0.C": 7, "kernel.can0": 0}


def test_a_counter_that_may_have_wrapped_gives_the_least() -> None:
    assert losses_as_texts(LOSSES) == {"counter.can0.A": "at least 1,063", "counter.can0.B": "5", "missing.can0.C": "7"}
