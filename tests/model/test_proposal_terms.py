"""Terms of a formula for what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.diagnosis.findings.proposal import terms
from model.wheel_soil import Conditions


def driven(n: int = 50) -> Conditions:
    rng = np.random.default_rng(0)
    return Conditions(
        slip=rng.uniform(-0.4, 0.9, n),
        vertical_load_n=rng.uniform(7e3, 1e4, n),
        ground_speed_mps=rng.uniform(0.5, 4, n),
        ground_acceleration_mps2=rng.normal(size=n),
        line_position=rng.uniform(-1, 1, n),
        campaign_time=rng.uniform(-0.5, 0.5, n),
    )


def by_text(conditions: Conditions) -> dict[str, tuple[str, np.ndarray]]:
    found = terms(conditions, np.full(50, 0.05) + 1e-6 * np.asarray(conditions.vertical_load_n))
    assert len({term.text for term in found}) == len(found)
    return {term.text: (term.unit, term.values) for term in found}


def test_texts_are_what_is_calculated() -> None:
    c = driven()
    found = by_text(c)
    np.testing.assert_allclose(found["s^2 W"][1], c.slip**2 * c.vertical_load_n / 1e3)
    assert found["s^2 W"][0] == "kN" and found["W V"][0] == "kN m/s"
    np.testing.assert_allclose(found["sign(s) x"][1], np.sign(c.slip) * c.line_position)
    np.testing.assert_allclose(found["1"][1], 1.0)
    assert 60 < len(found) < 130


def test_what_was_not_measured_or_never_changes_is_no_term() -> None:
    c = replace(driven(), line_position=np.full(50, np.nan), vertical_load_n=np.full(50, 8e3))
    assert not any("x" in text.replace("exp", "").replace("max", "") or "W" in text for text in by_text(c))


def test_driving_only_leaves_one_of_two_that_say_the_same() -> None:
    c = replace(driven(), slip=np.abs(driven().slip))
    assert not any(word in text for text in by_text(c) for word in ("sign", "max", "|s| "))
