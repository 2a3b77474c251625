"""Many faults that differ only in where they are do not fill the screen."""

from __future__ import annotations

from daq import DataError, Fault


def test_six_of_one_kind_are_reported_once_with_the_first_and_last_place() -> None:
    error = DataError(*(Fault("no torque", f"run-{i}", "dp", next_step=f"add it to {i}.toml") for i in range(1, 7)))
    assert len(error.faults) == 6, "programs get them all"
    assert str(error).count("no torque") == 1
    assert "run-1; and in 5 more places, to run-6" in str(error)
    assert "faults:" not in str(error)


def test_a_few_and_different_ones_stand_for_themselves() -> None:
    few = DataError(*(Fault("no torque", f"run-{i}") for i in range(1, 4)), Fault("no load", "run-1"))
    assert str(few).startswith("4 faults:")
    assert all(f"run-{i}" in str(few) for i in range(1, 4))
