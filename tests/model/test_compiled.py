"""The compiled core gives the numbers of numpy, refuses what has a wrong size, and goes where there is no compiler."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from property_settings import examples
from scipy.sparse import csr_array

from daq import ConfigError
from model import compiled, core_in_use, core_library
from model.core_build import compile_core
from model.core_library import Core, load
from model.diagnosis.time_series.evidence import _invert, log_box_probability
from model.diagnosis.time_series.hyper import Block, _Processes
from model.diagnosis.time_series.noise import Process
from model.diagnosis.time_series.whitening import Neighbours, StateSpace, _steps, smoothed, whiten
from model.effects import Effect, Parameter
from model.wheel_soil import SOILS, Conditions, Dual, Patch, Quadrature, Wheel, WheelSoilModel, resultants, value_of
from model.wheel_soil.contact import Resultants, rules_of

Both = Callable[[Callable[[], Any]], tuple[Any, Any]]
SANITIZED = "WHEELSOIL_TEST_CORE"
"""A library to test instead of one that is compiled here: the same tests run it under sanitizers."""
several = examples(40, gate=15, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = Path(os.environ.get(SANITIZED) or tmp_path_factory.mktemp("core") / "_compiled.so")
    if not path.exists():
        if shutil.which("cc") is None:
            pytest.skip("there is no C compiler")
        assert compile_core(path) is None
    return path


@pytest.fixture(scope="module")
def core(library: Path) -> ctypes.CDLL:
    found = load(library)
    assert found.library is not None, found.reason
    return found.library


@pytest.fixture
def both(core: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch) -> Iterator[Both]:
    """Return what a function returns by numpy and by the compiled core."""

    def run(function: Callable[[], Any]) -> tuple[Any, Any]:
        found = []
        for one in (Core(None, "numpy"), Core(core, "")):
            monkeypatch.setattr(core_library, "_core", lambda _, one=one: one)
            with np.errstate(all="ignore"):
                found.append(function())
        return found[0], found[1]

    yield run


RANGES = {
    "entry_angle": (0.02, 1.55),
    "speed_ratio": (0.05, 3.0),
    "radius": (0.2, 0.8),
    "width": (0.1, 0.6),
    "cohesion": (0.0, 2e4),
    "tan_phi": (0.05, 0.9),
    "shear_modulus": (1e-3, 0.08),
    "stiffness": (1e4, 1e7),
    "exponent": (0.2, 1.8),
    "peak_angle": (0.0, 0.015),
    "exit_angle": (-0.3, 0.0),
    "lug_height": (0.0, 0.05),
    "softening": (0.0, 0.6),
}
OPTIONAL = ("peak_angle", "exit_angle", "lug_height", "softening")


@st.composite
def patches(draw: st.DrawFn) -> Patch:
    """Return a patch of columns and numbers, some with derivatives; optional entries may be zero."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = draw(st.sampled_from([1, 2, 37]))
    columns = draw(st.sets(st.sampled_from(list(RANGES)))) | {"entry_angle"}
    absent = draw(st.sets(st.sampled_from(OPTIONAL)))
    ratio = draw(st.sampled_from([(0.05, 0.99), (1.01, 8.0), (0.3, 2.0), (1e6, 1e9)]))
    entries: dict[str, Any] = {}
    for name, (low, high) in (RANGES | {"speed_ratio": ratio}).items():
        entries[name] = 0.0 if name in absent else rng.uniform(low, high, (count, 1) if name in columns else ())
    for name in draw(st.sets(st.sampled_from(list(RANGES)))):
        own = {name: 1.0} if draw(st.booleans()) else {"a": rng.normal(size=(count, 1)), name: 2.0}
        entries[name] = Dual(entries[name], own)
    return Patch(**entries)


def assert_equal(ours: Any, theirs: Any, size: dict[str, float] | None = None) -> None:
    """Hold two numbers with derivatives against each other; those of what cancels by its own size."""
    values, expected = value_of(ours), value_of(theirs)
    assert values.shape == expected.shape
    largest = np.nanmax(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-12 * largest)
    carried = [x.partials if isinstance(x, Dual) else {} for x in (ours, theirs)]
    for name in {*carried[0], *carried[1]}:
        slopes = (np.broadcast_to(x.get(name, 0.0), values.shape) for x in carried)
        scale = largest / (size or {}).get(name, 1.0)
        np.testing.assert_allclose(*slopes, rtol=1e-9, atol=1e-9 * scale, err_msg=name)


@several
@given(patch=patches())
def test_contact_against_numpy(both: Both, patch: Patch) -> None:
    size = {name: float(np.max(np.abs(value_of(getattr(patch, name))))) or 1.0 for name in RANGES}
    expected, found = both(lambda: resultants(patch))
    for name in Resultants.__dataclass_fields__:
        assert_equal(getattr(found, name), getattr(expected, name), {**size, "a": min(size.values())})


@pytest.mark.parametrize("name", list(RANGES))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0])
def test_contact_against_numpy_where_an_entry_is_no_use(both: Both, name: str, bad: float) -> None:
    """What is not a number stays where it is."""
    entries: dict[str, Any] = {key: np.full((3, 1), 0.5 * (low + high)) for key, (low, high) in RANGES.items()}
    entries[name][1] = bad
    expected, found = both(lambda: resultants(Patch(**entries)))
    for one in Resultants.__dataclass_fields__:
        ours, theirs = (getattr(x, one)[[0, 2]] for x in (found, expected))
        assert np.isfinite(theirs).all()
        np.testing.assert_allclose(ours, theirs, rtol=1e-9)
        assert np.isfinite(getattr(found, one)[1]) == np.isfinite(getattr(expected, one)[1])


def test_a_rear_part_of_no_width_is_differentiated(both: Both) -> None:
    middle: dict[str, Any] = {name: 0.5 * (low + high) for name, (low, high) in RANGES.items()}
    middle |= {"entry_angle": np.array([[0.3], [0.9]]), "peak_angle": Dual(0.0, {"p": 1.0})}
    for ratio in (0.6, 1.7):
        entries = middle | {"exit_angle": Dual(0.0, {"e": 1.0}), "speed_ratio": ratio}
        expected, found = both(lambda entries=entries: resultants(Patch(**entries)))
        for name in Resultants.__dataclass_fields__:
            assert_equal(getattr(found, name), getattr(expected, name))


class DeeperPeak(Effect):
    """An effect of another package: it moves the peak with the sinkage, in Python."""

    name, summary, source = "deeper_peak", "a test's", "a test"
    parameters = (Parameter("share", "1", 0.0, 0.1, 0.0, 1.0, 0.1),)

    def patch(self, patch: Any, conditions: Any, values: Any) -> Any:
        from dataclasses import replace

        return replace(patch, peak_angle=patch.entry_angle * values["share"])


@several
@given(seed=st.integers(0, 2**32), share=st.sampled_from([0.0, 0.2]), soil=st.sampled_from(sorted(SOILS)))
def test_balance_against_numpy(both: Both, seed: int, share: float, soil: str) -> None:
    """Solved in C, or in Python about the compiled integral where an effect has its word in the patch."""
    rng = np.random.default_rng(seed)
    load = rng.uniform(500.0, 20e3, 30)
    load[:3] = 1e9, np.nan, 1e-6
    conditions = Conditions(slip=rng.uniform(-1.0, 1.0, 30), vertical_load_n=load)
    model = WheelSoilModel(Wheel(radius_m=0.47, width_m=0.318), SOILS[soil], [DeeperPeak])
    wrt = ("slip", "cohesion_kpa", "deeper_peak.share") if rng.random() < 0.5 else ()
    wrt = tuple(name for name in wrt if name in model._defaults or name == "slip")
    expected, found = both(lambda: model.predict(conditions, {"deeper_peak.share": share}, wrt))
    for name in ("sinkage_m", "entry_angle_rad", "vertical_load_n", "drawbar_pull_n", "driving_torque_nm"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(theirs)), err_msg=name)
    for key, one in expected.sensitivities.items():
        ours, theirs = found.sensitivities[key].drawbar_pull_n, one.drawbar_pull_n
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9 * np.nanmax(np.abs(theirs)), err_msg=key)


def space_of(seed: int, runs: int, count: int, width: int, near: bool) -> tuple[StateSpace, np.ndarray]:
    """Return a state space with steps, gaps and padding, and its columns."""
    rng = np.random.default_rng(seed)
    states, channels = 6, 2
    decay = rng.uniform(0.0, 1.0, (runs, count, states))
    loadings = rng.standard_normal((runs, count, channels, states))
    loadings[-1, count // 2 :] = 0.0
    columns = np.where(loadings.any(axis=-1)[..., None], rng.standard_normal((runs, count, channels, width)), 0.0)
    neighbours, variance = None, rng.uniform(0.3, 3.0, states)
    if near:
        steps = rng.choice([0.2, 0.2, 0.4, 3.0], (runs * count, 1))
        later, shares, block = _steps(np.array([1.3, 0.0]), steps, 0.2)
        decay[..., :2] = later.reshape(runs, count, 2)
        at = np.arange(2)
        neighbours = Neighbours(at, at + 2, at + 4, shares.reshape(runs, count, 3, 2), block)
        variance = np.tile(variance[:2], 3)
    return StateSpace(loadings, decay, variance, rng.uniform(0.1, 1.0, columns.shape[:3]), neighbours), columns


@several
@given(
    seed=st.integers(0, 2**32),
    sizes=st.tuples(st.integers(1, 3), st.integers(1, 40), st.integers(0, 9)),
    near=st.booleans(),
)
def test_whitening_against_numpy(both: Both, seed: int, sizes: tuple[int, int, int], near: bool) -> None:
    space, columns = space_of(seed, *sizes, near)
    expected, found = both(lambda: whiten(space, columns))
    np.testing.assert_allclose(found.columns, expected.columns, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.log_determinants, expected.log_determinants, rtol=1e-9, atol=1e-9)
    if sizes[2]:
        for ours, theirs in zip(*both(lambda: smoothed(space, columns[..., 0])), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-8)


def noise_of(seed: int, sites: int, numbers: int) -> tuple[list[csr_array], np.ndarray]:
    """Return what numbers see of three processes at some sites, none of one, and the lags of the sites."""
    rng = np.random.default_rng(seed)
    loads = [csr_array(rng.normal(size=(sites, numbers)) * (rng.random((sites, numbers)) < 0.3)) for _ in range(3)]
    lags = np.abs(rng.uniform(0.0, 9.0, (2, sites, 1)) - rng.uniform(0.0, 9.0, (2, 1, sites)))
    return [*loads, csr_array((sites, numbers))], lags + lags.swapaxes(1, 2)


@several
@given(seed=st.integers(0, 2**32), sites=st.integers(1, 20), numbers=st.integers(1, 30))
def test_covariance_of_the_noise_against_numpy(core: ctypes.CDLL, seed: int, sites: int, numbers: int) -> None:
    loads, lags = noise_of(seed, sites, numbers)
    listed = [Process(f"d{i}", "t" if i != 2 else None, i == 1, "") for i in range(4)]
    values = {"t": 1.7, "d0": 0.3, "d1": 2.0, "d2": 1.1, "d3": 5.0}
    nothing = np.zeros((numbers, 1))
    block = Block(nothing, *lags, tuple(zip(listed, loads, strict=True)), (), (), nothing[:, 0])
    times, sigmas = np.array([1.7, 1.7, 0.0, 1.7]), np.array([0.3, 2.0, 1.1, 5.0])
    ours, theirs = block.compiled.at(core, times, sigmas), _Processes(block, values)
    x = np.random.default_rng(seed).normal(size=(numbers, numbers))
    found = [np.ones((numbers, numbers)) for _ in range(2)]
    for one, to in zip((ours, theirs), found, strict=True):
        one.add_to(to)
    for mine, expected in (
        found,
        (ours.slope_products(x[0]), theirs.slope_products(x[0])),
        (ours.slope_traces(x + x.T), theirs.slope_traces(x + x.T)),
    ):
        np.testing.assert_allclose(mine, expected, rtol=1e-9, atol=1e-9)


@several
@given(seed=st.integers(0, 2**32), columns=st.integers(1, 5), replicates=st.integers(1, 3))
def test_evidence_of_sets_against_numpy(core: ctypes.CDLL, seed: int, columns: int, replicates: int) -> None:
    rng = np.random.default_rng(seed)
    shape = columns, replicates, 20
    rows = rng.normal(size=(replicates, 20, columns, columns + 2))
    precision = np.moveaxis(rows @ rows.swapaxes(2, 3), (2, 3), (0, 1)) + np.eye(columns)[..., None, None]
    side, width = 30.0 * rng.normal(size=shape), rng.choice([0.0, 0.1, 1.0, 100.0, np.inf], size=(2, columns, 20))
    lower, upper = -width[0], np.maximum(width[1], 0.1)
    ours = compiled.weigh(core, precision.copy(), side, lower, upper)
    log_det = _invert(precision)
    mean = np.einsum("ij...,j...->i...", precision, side)
    inside = log_box_probability(mean, precision, lower[:, None], upper[:, None])
    np.testing.assert_allclose(ours, [log_det, (side * mean).sum(axis=0), inside], rtol=1e-8, atol=1e-8)
    for wrong in ((precision[:, :, :0], side, lower, upper), (precision, side, lower[:, 1:], upper)):
        with pytest.raises(ValueError, match="of shape"):
            compiled.weigh(core, *wrong)


def test_a_noise_of_another_size_is_refused(core: ctypes.CDLL) -> None:
    loads, lags = noise_of(1, 5, 8)
    outside = loads[0].copy()
    outside.indices[0] = 8
    for wrong in ([outside, loads[1]], [loads[0], loads[1][:, :7]], [loads[0], loads[1][:4]]):
        with pytest.raises(ValueError):
            compiled.NoiseProcesses(wrong, lags, [False, True]).at(core, np.ones(2), np.ones(2))
    for lag, which in ((lags[:, :4], [False] * 4), (lags, [False] * 3), (lags, [2] * 4)):
        with pytest.raises(ValueError):
            compiled.NoiseProcesses(loads, lag, which)  # type: ignore[arg-type]
    noise = compiled.NoiseProcesses(loads, lags, [False] * 4)
    with pytest.raises(ValueError):
        noise.at(core, np.ones(3), np.ones(4))
    at = noise.at(core, np.ones(4), np.ones(4))
    for call in (at.add_to, at.slope_products, at.slope_traces):
        with pytest.raises(ValueError):
            call(np.ones((7, 7)))


def wrong_patches() -> Iterator[tuple[str, dict[str, Any]]]:
    columns = [np.full((4, 1), 0.5) for _ in RANGES]
    rules = rules_of(Quadrature())
    for shape in ((3, 1), (4,), (1, 4), (4, 2), (0, 1)):
        yield "entry of shape", {"entries": [np.full(shape, 0.5), *columns[1:]], "rules": rules}
    yield "entries", {"entries": columns[1:], "rules": rules}
    yield "entries", {"entries": [*columns, *columns], "rules": rules}
    for size in (0, 26, len(rules) - 1):
        yield "rules", {"entries": columns, "rules": rules[:size]}


@pytest.mark.parametrize(("what", "given_"), list(wrong_patches()))
def test_a_patch_of_another_size_is_refused(core: ctypes.CDLL, what: str, given_: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=what):
        compiled.contact(core, count=4, wanted=0, **given_)
    with pytest.raises(ValueError, match=what):
        load = np.ones((4, 1))
        compiled.balance(core, load=load, start=load, limits=(1e-7, 0.1, 0.999), **given_)


@pytest.mark.parametrize("wanted", [-1, 1 << 13, 1 << 40])
def test_derivatives_by_what_is_not_there_are_refused(core: ctypes.CDLL, wanted: int) -> None:
    with pytest.raises(ValueError, match="entries"):
        compiled.contact(core, [np.full((4, 1), 0.5)] * 13, 4, rules_of(Quadrature()), wanted)


def test_a_load_of_another_size_is_refused(core: ctypes.CDLL) -> None:
    entries, load = [np.full((4, 1), 0.5)] * 13, np.ones((4, 1))
    for wrong in (load[:3], load[:, 0]):
        with pytest.raises(ValueError, match="of shape"):
            compiled.balance(core, entries, rules_of(Quadrature()), load, wrong, (1e-7, 0.1, 0.999))


def test_a_state_space_of_another_size_is_refused(core: ctypes.CDLL) -> None:
    space, columns = space_of(1, 2, 5, 3, near=True)
    noise = (space.loadings, space.decay, space.stationary(), space.white)
    assert space.neighbours
    near = (space.neighbours.later, space.neighbours.now, space.neighbours.before, space.neighbours.shares)
    for i in range(4):
        wrong = tuple(x[:-1] if i == k else x for k, x in enumerate(noise))
        with pytest.raises(ValueError, match="of shape"):
            compiled.StateSpace(core, wrong, near)  # type: ignore[arg-type]
    for position in (-1, 6, 2**40):
        for i in range(3):
            moved = tuple(np.full(2, position) if i == k else x for k, x in enumerate(near))
            with pytest.raises(ValueError, match="outside the states"):
                compiled.StateSpace(core, noise, moved)  # type: ignore[arg-type]
    for wrong_near in ((near[0][:1], *near[1:]), (*near[:3], near[3][:, :-1])):
        with pytest.raises(ValueError):
            compiled.StateSpace(core, noise, wrong_near)  # type: ignore[arg-type]
    for data in (columns[0], columns[:, :-1], columns[:, :, :1]):
        with pytest.raises(ValueError, match="of shape"):
            compiled.StateSpace(core, noise, near).whiten(data)
        with pytest.raises(ValueError, match="of shape"):
            compiled.StateSpace(core, noise, near).smooth(data[..., 0])


@pytest.mark.parametrize(("compiler", "why"), [("no-such-compiler", "no C compiler"), ("false", "ended with 1")])
def test_without_a_compiler_there_is_a_reason_and_nothing_is_left(
    compiler: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", compiler)
    failure = compile_core(tmp_path / "_compiled.so")
    assert failure is not None and why in failure
    assert not list(tmp_path.iterdir())


def test_numpy_computes_where_there_is_no_library(tmp_path: Path) -> None:
    path = tmp_path / "_compiled.so"
    assert "was not built" in load(path).reason
    path.write_bytes(b"no library")
    assert "cannot be loaded" in load(path).reason


def test_numpy_computes_where_the_library_is_of_another_source(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core_library, "source_hash", lambda: "another")
    stale = load(library)
    assert stale.library is None
    assert "another compiled.c" in stale.reason


def test_the_variable_forces_a_core(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    core_library._core.cache_clear()
    monkeypatch.setattr(core_library, "library_path", lambda: tmp_path / "_compiled.so")
    assert core_in_use().startswith("numpy: it was not built")
    for wanted, error in (("c", "asks for the compiled core"), ("fortran", "not understood")):
        monkeypatch.setenv("WHEELSOIL_CORE", wanted)
        with pytest.raises(ConfigError, match=error):
            core_in_use()
    monkeypatch.setenv("WHEELSOIL_CORE", "numpy")
    assert core_in_use() == "numpy: WHEELSOIL_CORE says so"
    core_library._core.cache_clear()


def sanitizer() -> str:
    """Return the path of the sanitizer's library, empty where there is none."""
    if shutil.which("gcc") is None:
        return ""
    said = subprocess.run(["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    path = said.stdout.strip()
    return path if os.path.isabs(path) and sys.platform == "linux" else ""  # noqa: PTH117 - a name alone: not found


BEYOND = """
import numpy as np, sys
from pathlib import Path
from model import compiled
from model.core_library import load
from model.wheel_soil import Quadrature
from model.wheel_soil.contact import rules_of
core = load(Path(sys.argv[1])).library
compiled._sized = lambda array, shape: array.ctypes.data  # nothing is checked any more
compiled.balance(core, [0.5] * 13, rules_of(Quadrature()), np.ones((4, 1)), np.ones((2, 1)), (1e-7, 0.1, 0.999))
"""


@pytest.mark.slow
@pytest.mark.skipif(not sanitizer(), reason="gcc with its sanitizers is not here (Debian: apt-get install gcc)")
def test_sanitizers_find_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """AddressSanitizer and UndefinedBehaviorSanitizer run the tests above; they do find a read beyond an array."""
    library = tmp_path / "_compiled.so"
    monkeypatch.setenv("CC", "gcc")
    flags = ("-g", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
    assert compile_core(library, flags) is None
    environment = {
        **os.environ,
        "LD_PRELOAD": sanitizer(),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONMALLOC": "malloc",
        SANITIZED: str(library),
    }
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    command += ["--hypothesis-profile", "gate"]
    command += ["-k", "against or refused or width", __file__, "-m", "not slow"]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert " skipped" not in done.stdout
    beyond = [sys.executable, "-c", BEYOND, str(library)]
    found = subprocess.run(beyond, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert found.returncode != 0
    assert "heap-buffer-overflow" in found.stderr
