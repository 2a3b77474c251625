"""The campaigns of the blind study: what is handed over, and whether the generator's own noise is what it says."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blind.causes import ALL
from blind.colour import REAL_FORCES, REAL_SPEED, Colour
from blind.driving import DURATION_S
from blind.field import driven, field_day
from blind.folders import run_info, vehicle_config, write_campaign
from blind.measures import Yardstick, oracle, told
from blind.sensors import START_NS
from blind.vendors import VENDORS
from blind.wheel import Reading, Vehicle, simulated, slip_of
from blind.world import World
from scipy.linalg import cholesky, solve_triangular

from daq.runs import open_runs
from processing import ProcessedRun, ProcessOptions
from processing.pipeline import process
from wheelsoil.workflows import process_runs

HERE = Path(__file__).parent
_MEETS_THE_ENGINE = ("advice", "engine", "growth", "hindsight", "wheels", "wheels_truth", "study", "tables")
SHORT = World(runs=2, duration_s=15.0)
"""One run out and one back: what is asked of every run of the study, at an eighth of its price."""


def test_the_generator_knows_nothing_of_the_model() -> None:
    for path in HERE.glob("*.py"):
        if path.name.startswith("test_") or path.stem in _MEETS_THE_ENGINE:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [n for n in names if n.split(".")[0] in ("model", "wheelsoil", "processing")], path.name


@pytest.mark.parametrize("vendor", list(VENDORS))
def test_frames_and_channels_say_the_same(vendor: str, tmp_path: Path) -> None:
    day = field_day("clay", (5, 0), vendor, world=SHORT)
    hidden = [("vasilev", 0.03)]
    write_campaign(tmp_path, day, hidden)
    config = vehicle_config(day)
    [*framed] = (run for _, run in process_runs(open_runs([tmp_path]), ProcessOptions(purpose="fit")))
    direct = [process(c, config, run_info(p)) for p, c in zip(day.plans, driven(day, hidden), strict=True)]
    for one, other in zip(framed, direct, strict=True):
        assert one.start_ns == other.start_ns
        both = one.used & other.used
        assert both.sum() > 0.95 * other.used.sum()
        for name, close in (
            ("drawbar_pull_n", 4.0),
            ("vertical_load_n", 4.0),
            ("driving_torque_nm", 1.0),
            ("ground_speed_mps", 0.01),
            ("wheel_speed_radps", 0.005),
        ):
            assert np.abs(getattr(one, name) - getattr(other, name))[both].max() < close, name


def test_only_recordings_are_handed_over(tmp_path: Path) -> None:
    day = field_day("sandy", (5, 1), "fjord", world=SHORT)
    write_campaign(tmp_path, day, [("skid_sinkage", 0.3)], runs=1)
    assert {p.name for p in tmp_path.iterdir()} == {
        "vehicle.toml",
        "terrain.toml",
        "runs.toml",
        "fjord.dbc",
        "01.log",
    }
    text = "".join((tmp_path / n).read_text() for n in ("vehicle.toml", "terrain.toml", "runs.toml"))
    assert not [key for key in ALL if key in text]


def test_a_seed_gives_the_same_campaign_and_what_is_hidden_changes_nothing_else() -> None:
    day, again = (field_day("clay", (6, 1), world=SHORT) for _ in range(2))
    plain, hidden, repeated = driven(day, [])[0], driven(day, [("torque_zero", 25.0)])[0], driven(again, [])[0]
    for role, channel in plain.items():
        assert np.array_equal(channel.values, repeated[role].values)
        moved = hidden[role].values - channel.values
        assert np.allclose(moved, 25.0 if role == "driving_torque" else 0.0)


def test_runs_are_what_the_study_asks_for() -> None:
    day = field_day("clay", (6, 2))
    assert len(day.plans) == 6
    assert [p.direction for p in day.plans] == [1, -1, 1, -1, 1, -1]
    assert sorted(p.load_n for p in day.plans) == sorted(2 * [8000.0, 11000.0, 13000.0])
    slip = np.concatenate([m.slip[m.speed > 0.5] for m in day.moments])
    assert slip.min() < -0.2
    assert slip.max() > 0.8
    assert max(np.abs(m.alpha).max() for m in day.moments) < 15
    for m in day.moments:
        assert len(m.time_s) == DURATION_S * 200
        assert (m.speed[:400] == 0).all()
        assert (m.speed[-200:] == 0).all()


def at_five_hertz(run: ProcessedRun, time_s: np.ndarray, name: str) -> np.ndarray:
    """Return block means of a processed quantity."""
    values = getattr(run, name)
    known = np.isfinite(values)
    whole = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    start = (run.start_ns - START_NS) * 1e-9
    return np.interp(time_s - start, run.time_s, np.convolve(whole, np.ones(20) / 20, mode="same"))


DRAWN = World(
    soil="dry sand",
    vehicle=Vehicle(0.3, 0.2, 20.0, 0.9, 1100.0, (2500.0, 3400.0, 4100.0), 0.9),
    runs=3,
    duration_s=30.0,
    force=REAL_FORCES,
    speed=Colour(((1.0, 3.0),)),
)
MEMORIES = replace(DRAWN, force=Colour(((0.5, 0.1), (0.3, 1.0), (0.15, 5.0), (0.05, 0.0))), speed=REAL_SPEED)


@pytest.mark.parametrize(
    ("world", "seed"),
    [
        pytest.param(World("sandy"), 1, marks=pytest.mark.slow),
        pytest.param(DRAWN, 1, marks=pytest.mark.slow),
        (MEMORIES, 3),
    ],
)
def test_the_covariance_of_the_oracle_is_that_of_the_recordings(world: World, seed: int) -> None:
    """Nothing hidden: measured less simulated on the true soil, whitened, has unit variance (stones add some)."""
    day = field_day(world.soil, (9, seed), world=world)
    yardstick = Yardstick(day)
    config = vehicle_config(day)
    runs = [process(c, config, run_info(p)) for p, c in zip(day.plans, driven(day, []), strict=True)]
    whitened = []
    for run, (root, rows) in zip(runs, yardstick._roots, strict=True):
        m = yardstick.sight.moments.at(rows)
        rests = m.rolls < 0.5
        speed, omega, load, pull, torque = (
            at_five_hertz(run, m.time_s, name)
            for name in (
                "ground_speed_mps",
                "wheel_speed_radps",
                "vertical_load_n",
                "drawbar_pull_n",
                "driving_torque_nm",
            )
        )
        speed, omega = np.where(rests, 0, np.maximum(speed, 1e-3)), np.where(rests, 0, omega)
        said = simulated(day.ground, replace(m, omega=omega), Reading(pull, torque, speed, omega, load))
        left = np.concatenate([pull - said[0], torque - said[1]])
        far = np.tile((np.abs(slip_of(world.vehicle.radius_m * m.omega, m.speed)) > 0.05) | rests, 2)
        covariance = (root @ root.T)[np.ix_(far, far)]
        whitened.append(solve_triangular(cholesky(covariance, lower=True), left[far], lower=True))
    variance = np.mean(np.concatenate(whitened) ** 2)
    assert 0.9 < variance < 1.35


@pytest.fixture(scope="module")
def yardstick() -> Yardstick:
    return Yardstick(field_day("clay", (6, 3)))


@pytest.mark.slow
def test_sizes_are_set_by_their_loudness(yardstick: Yardstick) -> None:
    for key in ("vasilev", "torque_gain", "speed_latency", "exit_angle"):
        for level in (0.5, 5.0):
            size, reached = yardstick.size_for(key, level)
            assert reached == pytest.approx(level, rel=0.03)
            assert told(yardstick, [(key, size)]).loudness == pytest.approx(level, rel=0.03)


@pytest.mark.slow
def test_what_can_be_told_grows_with_the_size_and_the_oracle_with_it(yardstick: Yardstick) -> None:
    small, large = (told(yardstick, [("vasilev", size)]) for size in (0.005, 0.05))
    assert small.detectability < large.detectability
    assert large.separability <= large.detectability
    loud, faint, silent = (
        oracle(yardstick, hidden) for hidden in ([("vasilev", 0.05)], [("interface_friction", -0.005)], [])
    )
    assert loud.right > 0.95 and loud.verdicts["named right"] > 0.95
    assert faint.right < 0.2 and faint.verdicts["nothing"] > 0.8
    assert silent.right > 0.9 and silent.verdicts["nothing"] > 0.95
    assert all(sum(x.verdicts.values()) == pytest.approx(1.0) for x in (loud, faint, silent))


def test_a_rival_that_may_have_one_sign_only_explains_nothing_of_the_other(yardstick: Yardstick) -> None:
    up, down = (told(yardstick, [("track_drift", size)]) for size in (0.1, -0.1))
    assert up.detectability == pytest.approx(down.detectability, rel=0.2)
    assert min(up.separability, down.separability) > 5
