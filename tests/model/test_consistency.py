"""The bound before a diagnosis: campaigns and tables, with and without what it needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from stressed_wheel import StressedWheel

from model.diagnosis import Bench, Campaign, bound_rows_of_runs
from model.diagnosis.core.consistency import SIGMAS, inconsistencies
from model.fit import Observations
from model.wheel_soil import SOILS, Wheel, prior_of
from processing.pipeline import process
from wheelsoil.simulation import SimulationOptions, simulated_roles
from wheelsoil.wording.notes import note_text

SLIP = np.linspace(0.1, 0.9, 9)
WHEEL = Wheel(0.47, 0.3)


def bench(name: str, sinkage_share: float = 1.0, tyre: str = "smooth") -> Bench:
    wheel = StressedWheel(entry=0.7, slip=0.5)
    load, pull, torque = np.array([replace(wheel, slip=s).forces() for s in SLIP]).T
    nothing = np.zeros(9)
    rows = Observations(
        SLIP,
        load,
        pull,
        torque,
        np.full(9, sinkage_share * wheel.sinkage),
        nothing,
        nothing,
        nothing,
        np.zeros(9, np.intp),
        ("",),
        independent=True,
    )
    sigmas = {"dp": 5.0, "t": 2.0, "z": 1e-3}
    return Bench(name, rows, WHEEL, SOILS["sandy"], prior_of(SOILS["sandy"]), sigmas, tyre)


def campaign(sinkage_m: float | None) -> Campaign:
    channels, vehicle, info = simulated_roles(SimulationOptions(soil="sandy", runs=1, duration_s=20.0), 0)
    run = process(channels, vehicle, info)
    if sinkage_m is not None:
        run = replace(run, sinkage_m=np.full(len(run), sinkage_m))
    return Campaign("field", (run,), Wheel(0.47, 0.318), SOILS["sandy"], prior_of(SOILS["sandy"]))


def test_what_is_right_is_consistent() -> None:
    assert inconsistencies([bench("a"), bench("b", tyre="lugged"), campaign(0.18)]) == ()


def test_without_sinkage_or_torque_nothing_is_said() -> None:
    rows = bench("a").rows
    bare = replace(bench("a"), rows=replace(rows, driving_torque_nm=np.full(9, np.nan)))
    assert inconsistencies([bare, campaign(None)]) == ()


def test_each_part_says_its_own() -> None:
    (alone,) = inconsistencies([bench("a", 0.02)])
    assert (alone.channel, alone.rows) == ("sinkage", 9)
    assert note_text(alone.why).startswith("T/r - Dp")
    field = campaign(0.001)
    first, second = inconsistencies([bench("a", 0.02), bench("b"), field])
    assert note_text(first.why) == f"a: {note_text(alone.why)}"
    assert note_text(second.why).startswith("field: ")
    rows = bound_rows_of_runs(field.runs)
    over = rows.slip[rows.excess_n > SIGMAS * rows.sigma_n]
    assert second.rows == len(over) > 100 and second.why.values["slips"] == (over.min(), over.max())
