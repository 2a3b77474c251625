"""Values that are no measurement are found, named and excluded; sound channels, coarse and held ones too, keep all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import Channel, FloatArray
from daq.runs import Run, open_runs
from processing import ProcessedRun, Reason, RunCode
from processing.pipeline import process
from processing.pipeline.collection import marks_of
from wheelsoil.wording.notes import note_text

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
FORCES = ("vertical_load", "drawbar_pull", "driving_torque")
ROLES = ("ground_speed", "wheel_speed", *FORCES)
Damage = Callable[[FloatArray, FloatArray], None]


@cache
def clay() -> tuple[Run, dict[str, Channel], ProcessedRun]:
    run = open_runs([CLAY])[0]
    channels = dict(run.channels())
    return run, channels, process(channels, run.vehicle, run.info)


def damaged(role: str, damage: Damage) -> ProcessedRun:
    """Return the first run of clay with one channel changed."""
    run, channels, _ = clay()
    channel = channels[role]
    values = channel.values.astype(float)
    damage((channel.time_ns - channel.time_ns[0]) * 1e-9, values)
    return process(channels | {role: replace(channel, values=values)}, run.vehicle, run.info)


def told(run: ProcessedRun) -> dict[str, dict[str, object]]:
    """Return the values of each note on a sensor fault, by role."""
    return {n.values["role"]: dict(n.values) for n in run.quality.notes if n.code is RunCode.SENSOR_FAULT}


def drop(time_s: FloatArray, values: FloatArray) -> None:
    values[time_s % 2.0 < 0.5] = 0.0


def freeze(time_s: FloatArray, values: FloatArray) -> None:
    still = (time_s > 15) & (time_s < 17.5)
    values[still] = values[still][0]


def clip(_: FloatArray, values: FloatArray) -> None:
    np.minimum(values, np.quantile(values, 0.67), out=values)


def mark(_: FloatArray, values: FloatArray) -> None:
    values[::37] = -99999.0


def test_a_sound_run_loses_nothing() -> None:
    run = clay()[2]
    assert not told(run) and "SENSOR_FAULT" not in run.quality.shares


@pytest.mark.parametrize(
    ("role", "kind", "damage", "share"),
    [
        ("ground_speed", "dropped", drop, 0.2),
        *((role, "frozen", freeze, 2.5 / 40) for role in ROLES),
        *((role, "clipped", clip, 0.3) for role in FORCES),
        *((role, "mark", mark, 1 / 37) for role in ROLES),
    ],
)
def test_a_fault_is_named_and_its_samples_are_excluded(role: str, kind: str, damage: Damage, share: float) -> None:
    run, sound = damaged(role, damage), clay()[2]
    assert {name: values["kind"] for name, values in told(run).items()} == {role: kind}
    assert told(run)[role]["share"] == pytest.approx(share, rel=0.15)
    [note] = [n for n in run.quality.notes if n.code is RunCode.SENSOR_FAULT]
    assert role in note_text(note) and "excluded" in note_text(note)
    used = run.used & sound.used
    assert used.sum() > 0.5 * sound.used.sum()
    field = {"ground_speed": "ground_speed_mps", "wheel_speed": "rim_speed_mps"}.get(role) or {
        "vertical_load": "vertical_load_n",
        "drawbar_pull": "drawbar_pull_n",
        "driving_torque": "driving_torque_nm",
    }[role]
    change = np.abs(getattr(run, field) - getattr(sound, field))[used]
    spread = float(np.nanstd(getattr(sound, field)[sound.used]))
    assert np.quantile(change, 0.9) < 0.1 * spread, "what is left is what was measured"
    if kind != "mark":
        assert run.quality.shares["SENSOR_FAULT"] > 0.8 * share and Reason.SENSOR_FAULT in run.reason


def test_a_wheel_that_stops_or_is_held_is_no_fault_of_the_ground_speed() -> None:
    run, channels, _ = clay()

    def stop(time_s: FloatArray, values: FloatArray) -> None:
        values[(time_s > 15) & (time_s < 17)] = 0.0

    both = {}
    for role in ("ground_speed", "wheel_speed"):
        values = channels[role].values.astype(float)
        stop((channels[role].time_ns - channels[role].time_ns[0]) * 1e-9, values)
        both[role] = replace(channels[role], values=values)
    assert not told(process(channels | both, run.vehicle, run.info))


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("how", ["coarse", "held"])
def test_coarse_and_held_channels_are_sound(role: str, how: str) -> None:
    def coarse(_: FloatArray, values: FloatArray) -> None:
        step = 0.1 * float(np.std(values))
        values[:] = np.round(values / step) * step

    def held(time_s: FloatArray, values: FloatArray) -> None:
        first = np.searchsorted(time_s, np.floor(time_s))
        values[:] = values[first]

    run = damaged(role, coarse if how == "coarse" else held)
    assert run.quality.shares.get("SENSOR_FAULT", 0.0) <= 0.01, told(run)


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=50, unique=True), st.integers(2, 3))
def test_only_values_far_from_all_others_are_marks(values: list[float], times: int) -> None:
    assert marks_of(np.array(values)) == []
    several = np.array([*values, *[-99999.0] * times])
    assert marks_of(several) == ([-99999.0] if len(values) >= 10 else [])
