"""`wheelsoil simulate`: the folder, its reproducibility, live output, bad options."""

from __future__ import annotations

import json
import shlex
import threading
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq import ConfigError, RunsConfig, TerrainConfig, VehicleConfig, load_toml
from daq.can import FrameBatch, concatenate
from daq.runs import open_runs
from model.effects import EFFECTS
from model.wheel_soil import SOILS, soil_from_terrain
from processing import REBOUND_M, REBOUND_SIGMA_M
from processing.pipeline import process
from wheelsoil.cli.app import run as wheelsoil
from wheelsoil.simulation import SimulationOptions, parse_effect, simulate_campaign, simulated_roles
from wheelsoil.simulation.campaign import frames_sha256, lifted_runs, simulated_run, simulated_ruts, true_soil
from wheelsoil.simulation.vehicle import virtual_frames

LYASKO = {"lyasko": {"m1": 0.1, "m2": 0.05}}


def frames_of(path: Path) -> FrameBatch:
    (run,) = open_runs([path])
    return concatenate(list(run.frame_batches()))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "clay"
    text = "simulate --effect lyasko:m1=0.1,m2=0.05 --runs 3 --duration 40 --seed 5 --format both -o"
    assert wheelsoil([*shlex.split(text), str(folder)]) == 0
    return folder


def test_the_folder_is_a_campaign(campaign: Path) -> None:
    runs = open_runs([campaign])
    assert [run.id for run in runs] == ["run-1", "run-2", "run-3"]
    assert [run.info.direction for run in runs] == ["out", "back", "out"]
    assert [run.info.added_load_kg for run in runs] == [0, 300, 500]
    assert all(path.suffix == ".mcap" for path in (run.path for run in runs))
    vehicle = load_toml(campaign / "vehicle.toml", VehicleConfig)
    assert vehicle.latency_s("ground_speed") == pytest.approx(0.07)
    assert vehicle.wheel is not None
    assert vehicle.wheel.outboard_inertia_kgm2 == 8
    laboratory = soil_from_terrain(load_toml(campaign / "terrain.toml", TerrainConfig))
    for name in ("cohesion_pa", "tan_phi", "shear_modulus_m", "cohesive_modulus", "frictional_modulus"):
        assert getattr(laboratory, name) == pytest.approx(getattr(SOILS["clay"], name))
    assert len(load_toml(campaign / "runs.toml", RunsConfig).run) == 3


def test_only_the_manifest_tells_the_truth(campaign: Path) -> None:
    manifest = tomllib.loads((campaign / "manifest.toml").read_text())
    assert manifest["truth"]["effect"] == [{"name": "lyasko", "parameters": {"m1": 0.1, "m2": 0.05}}]
    assert manifest["truth"]["seed"] == 5
    others = [path for path in campaign.iterdir() if path.name != "manifest.toml"]
    for path in others:
        assert b"lyasko" not in path.read_bytes().lower(), path.name
    (run, *_) = open_runs([campaign / "run-1.mcap"])
    assert "manifest.toml" not in run.attachments
    assert {"vehicle.toml", "terrain.toml", "wft.dbc"} <= set(run.attachments)


def test_the_manifest_s_command_makes_the_same_frames(campaign: Path, tmp_path: Path) -> None:
    manifest = tomllib.loads((campaign / "manifest.toml").read_text())
    words = shlex.split(manifest["command"])
    assert words[0] == "wheelsoil"
    assert wheelsoil([*words[1:], "-o", str(tmp_path / "again")]) == 0
    for fact in manifest["run"]:
        frames = frames_of(tmp_path / "again" / fact["file"])
        assert len(frames) == fact["frames"]
        assert frames_sha256(frames) == fact["frames_sha256"]


def test_roles_without_files_are_those_of_the_recording(campaign: Path) -> None:
    channels, vehicle, info = simulated_roles(SimulationOptions(effects=LYASKO, runs=3, seed=5), 1)
    run = open_runs([campaign])[1]
    assert vehicle == run.vehicle
    assert info.added_load_kg == run.info.added_load_kg
    read = run.channels()
    assert set(read) - set(channels) == {"latitude", "longitude"}
    for role, channel in channels.items():
        assert np.array_equal(read[role].values, channel.values)
        assert np.array_equal(read[role].time_ns, channel.time_ns)


def test_logs_hold_the_same_frames_as_recordings(campaign: Path) -> None:
    assert frames_sha256(frames_of(campaign / "run-2.log")) == frames_sha256(frames_of(campaign / "run-2.mcap"))


@pytest.mark.parametrize("there", [False, True])
def test_a_run_that_fails_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str], there: bool) -> None:
    folder = tmp_path / "a"
    if there:
        folder.mkdir()
    text = "simulate --runs 1 --duration 20 --added-load 20000 --format both -o"
    assert wheelsoil([*shlex.split(text), str(folder)]) == 1
    assert "cannot carry the wheel" in capsys.readouterr().err
    assert list(tmp_path.rglob("*")) == [folder] * there


def test_rut_readings_are_of_the_true_sinkage_and_change_no_frame(tmp_path: Path) -> None:
    plain = SimulationOptions(effects=LYASKO, runs=3, duration_s=20.0)
    options = replace(plain, rut=10)
    read = [simulated_ruts(options, index) for index in range(3)]
    assert [len(of_run) for of_run in read] == [4, 3, 3]
    off = []
    for index, of_run in enumerate(read):
        truth = simulated_run(options, index).truth
        for reading in of_run:
            at = np.argmin(np.abs(truth.time_s - reading.time_s))
            assert 0.0 < truth.slip[at] < 0.9
            off.append(truth.sinkage_m[at] - reading.depth_m)
    assert abs(np.mean(off) - 0.005) < 0.008 and np.std(off) < 0.01
    assert simulated_ruts(plain, 0) == ()
    simulate_campaign(tmp_path / "a", options)
    assert [len(run.rut) for run in load_toml(tmp_path / "a" / "runs.toml", RunsConfig).run] == [4, 3, 3]


def test_a_run_does_not_depend_on_the_others() -> None:
    few, many = (SimulationOptions(effects=LYASKO, runs=n, duration_s=20.0) for n in (2, 5))
    assert frames_sha256(virtual_frames(simulated_run(few, 1))) == frames_sha256(virtual_frames(simulated_run(many, 1)))


def test_passes_and_pressures_take_turns(tmp_path: Path) -> None:
    text = "simulate --runs 3 --duration 15 --pass-number 1 --pass-number 2 --inflation 340 --inflation 180 -o"
    assert wheelsoil([*shlex.split(text), str(tmp_path / "a")]) == 0
    runs = open_runs([tmp_path / "a"])
    assert [run.info.pass_number for run in runs] == [1, 2, 1]
    assert [run.info.inflation_kpa for run in runs] == [340, 180, 340]
    assert load_toml(tmp_path / "a/runs.toml", RunsConfig).run == tuple(run.info for run in runs)


def test_an_effect_that_cannot_show_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "simulate --runs 1 --duration 15 --effect multi_pass"
    assert wheelsoil([*shlex.split(text), "-o", str(tmp_path / "a")]) == 0
    assert "acts from the second pass on" in capsys.readouterr().err
    assert wheelsoil([*shlex.split(text), "--pass-number", "2", "-o", str(tmp_path / "b")]) == 0
    assert "second pass" not in capsys.readouterr().err


def test_several_effects_of_both_kinds(tmp_path: Path) -> None:
    text = "simulate --runs 1 --duration 15 --effect vasilev --effect torque_gain:relative=0.1 --effect torque_zero -o"
    assert wheelsoil([*shlex.split(text), str(tmp_path / "a")]) == 0
    effects = tomllib.loads((tmp_path / "a/manifest.toml").read_text())["truth"]["effect"]
    assert [effect["name"] for effect in effects] == ["vasilev", "torque_gain", "torque_zero"]


def test_faults_follow_each_other_by_their_stage() -> None:
    """A zero comes after the gain, in whatever order they are given."""
    gain, zero = {"torque_gain": {"relative": 0.1}}, {"torque_zero": {"offset_nm": 40.0}}
    none, scaled, one, other = (
        simulated_run(SimulationOptions(effects=e, runs=1, duration_s=15.0, noise=0.0), 0)
        .sensors["transducer"]["driving_torque"]
        .values
        for e in ({}, gain, gain | zero, zero | gain)
    )
    assert scaled == pytest.approx(1.1 * none)
    assert one == pytest.approx(1.1 * none + 40.0)
    assert np.array_equal(one, other)


def test_rut_readings_follow_the_true_sinkage_and_change_no_frame(tmp_path: Path) -> None:
    plain = SimulationOptions(effects={"vasilev": {"H_m": 0.05}}, runs=2, duration_s=20.0, seed=4)
    options = replace(plain, rut=10)
    for name, one in (("plain", plain), ("ruts", options)):
        simulate_campaign(tmp_path / name, one)
    hashes = [
        [run["frames_sha256"] for run in tomllib.loads((tmp_path / name / "manifest.toml").read_text())["run"]]
        for name in ("plain", "ruts")
    ]
    assert hashes[0] == hashes[1]
    infos = load_toml(tmp_path / "ruts/runs.toml", RunsConfig).run
    assert [len(info.rut) for info in infos] == [5, 5]
    slips, raised = [], []
    for index, info in enumerate(infos):
        truth = simulated_run(options, index).truth
        for reading in info.rut:
            row = int(np.argmin(np.abs(truth.time_s - reading.time_s)))
            slips.append(truth.slip[row])
            raised.append(truth.sinkage_m[row] - reading.depth_m)
    assert np.sort(slips) == pytest.approx(np.linspace(0.05, 0.8, 10), abs=0.03)
    assert np.mean(raised) == pytest.approx(REBOUND_M, abs=3 * np.hypot(REBOUND_SIGMA_M, 0.005 / np.sqrt(10)))
    assert 0.001 < np.std(raised) < 0.01


def test_the_files_do_not_contain_a_pressure_that_was_not_stated(tmp_path: Path) -> None:
    simulate_campaign(tmp_path / "a", SimulationOptions(runs=1, duration_s=15.0))
    assert b"inflation" not in (tmp_path / "a/runs.toml").read_bytes()


def test_the_command_line_of_all_options_is_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (
        "simulate --soil sandy --effect vasilev:H_m=0.08 --runs 1 --duration 20 --seed 9 --sinkage literal "
        "--added-load 120 --pass-number 3 --inflation 260.5 "
        "--radius 0.5 --width 0.3 --draw-soil --wheel-axes --noise 0.5 "
        "--tilt -1.5 --brakes released --lifted --rut 2 --start 2026-01-02T03:04:05Z"
    )
    assert wheelsoil([*shlex.split(text), "-o", str(tmp_path / "a")]) == 0
    command = tomllib.loads((tmp_path / "a/manifest.toml").read_text())["command"]
    assert wheelsoil([*shlex.split(command)[1:], "-o", str(tmp_path / "b")]) == 0
    assert (tmp_path / "a/manifest.toml").read_text() == (tmp_path / "b/manifest.toml").read_text()
    assert capsys.readouterr().out.split() == [str(tmp_path / "a"), str(tmp_path / "b")]


def test_the_wheel_is_lifted_ten_minutes_before_and_after_the_campaign() -> None:
    options = SimulationOptions(runs=3, duration_s=20.0, lifted=True)
    seconds = [run.start_ns / 1e9 - options.start.timestamp() for run in lifted_runs(options)]
    assert seconds == pytest.approx([-600.0, 3 * 20.0 + 3 * 600.0])


@pytest.mark.parametrize("wheel_axes", [False, True])
def test_a_zero_of_the_lifted_wheel_is_that_of_the_runs(
    tmp_path: Path, wheel_axes: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    effects = {"torque_zero": {"offset_nm": 30.0}}
    options = SimulationOptions(
        effects=effects, runs=1, duration_s=15.0, wheel_axes=wheel_axes, lifted=True, brakes="released"
    )
    written = simulate_campaign(tmp_path / "a", options)
    assert [path.name for path in written.files] == ["run-1.mcap", "lifted-before.mcap", "lifted-after.mcap"]
    assert [run.info.id for run in open_runs([tmp_path / "a"])] == ["run-1"]
    lifted = [str(path) for path in written.files[1:]]
    assert wheelsoil(["zero", *lifted, "--max-drift", "N=50,Nm=20", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [one["method"] for one in printed["zeros"]] == ["spin", "spin"]
    for one in printed["zeros"]:
        moment, pull = (one["channels"][name] for name in ("WFT_Moments.My", "WFT_Forces.Fx"))
        assert moment["offset"] == pytest.approx(30.0, abs=5 * moment["offset_sigma"])
        zero = 25.0 if wheel_axes else 0.0
        assert pull["offset"] == pytest.approx(zero, abs=5 * pull["offset_sigma"])
    vehicle = tmp_path / "a" / "vehicle.toml"
    vehicle.write_text(vehicle.read_text().replace("[transducer]", '[transducer]\nzero_file = "zero.toml"'))
    assert wheelsoil(["process", str(tmp_path / "a"), "--json"]) == 0
    (run,) = json.loads(capsys.readouterr().out)
    stands = run["quality"]["standstills"]
    assert {stand["brakes"] for stand in stands} == {"released"}
    assert all(abs(stand["levels"]["driving_torque"]) < 12.0 for stand in stands)
    assert all(abs(stand["levels"]["vertical_load"] - 8000.0) < 60.0 for stand in stands)


@pytest.mark.parametrize("wheel_axes", [False, True])
def test_processing_finds_the_truth_again(tmp_path: Path, wheel_axes: bool) -> None:
    options = SimulationOptions(effects=LYASKO, runs=1, noise=0.0, wheel_axes=wheel_axes)
    simulate_campaign(tmp_path / "quiet", options)
    (run,) = open_runs([tmp_path / "quiet"])
    processed = process(run.channels(), run.vehicle, run.info)
    simulated = simulated_run(options, 0)
    truth = simulated.truth
    at = (processed.start_ns - simulated.start_ns) * 1e-9 - 0.25 + processed.time_s
    used = processed.used & (processed.ground_speed_mps > 0.8)

    def spread(measured: np.ndarray, true: np.ndarray) -> float:
        return float(np.sqrt(np.mean((measured - np.interp(at, truth.time_s, true))[used] ** 2)))

    assert used.sum() > 1500
    assert spread(processed.ground_speed_mps, truth.ground_speed_mps) < 0.01
    assert spread(processed.slip, truth.slip) < 0.01
    assert spread(processed.drawbar_pull_n, truth.drawbar_pull_n) < 45  # the road's share above the cut-off
    assert spread(processed.driving_torque_nm, truth.driving_torque_nm) < 25
    driven = used & (processed.slip > 0.2)
    error = processed.drawbar_pull_n - np.interp(at, truth.time_s, truth.drawbar_pull_n)
    assert abs(np.mean(error[driven])) < 5
    assert processed.quality.clock["offset_s"] == pytest.approx(0.25, abs=1e-3)


def test_processing_finds_declared_latency_and_rising_slip_sinkage(campaign: Path) -> None:
    for run in open_runs([campaign]):
        quality = process(run.channels(), run.vehicle, run.info).quality
        assert quality.residual_latency_s == pytest.approx(0.0, abs=0.04 + 3 * quality.residual_latency_sigma_s)
        assert quality.standstills


@pytest.mark.parametrize("speed", [5, pytest.param(1, marks=pytest.mark.slow)])
def test_live_output_keeps_the_time(speed: int, capsys: pytest.CaptureFixture[str]) -> None:
    import can

    received: list[can.Message] = []
    stop = threading.Event()
    with can.Bus(interface="virtual", channel="sim-live", ignore_config=True) as bus:

        def listen() -> None:
            while not stop.is_set():
                message = bus.recv(0.2)
                if message is not None:
                    received.append(message)

        listener = threading.Thread(target=listen)
        listener.start()
        began = time.monotonic()
        arguments = f"simulate --runs 1 --duration 15 --live virtual --channel sim-live --speed {speed}"
        code = wheelsoil(shlex.split(arguments))
        took = time.monotonic() - began
        time.sleep(0.5)
        stop.set()
        listener.join()
    assert code == 0
    assert 14.5 / speed < took < 14.5 / speed + 10
    expected = 15 * (3 * 1000 + 100 + 3 * 20)
    assert len(received) == pytest.approx(expected, rel=0.001)
    stamps = np.array([message.timestamp for message in received])
    assert 14.5 / speed < stamps[-1] - stamps[0] < 14.5 / speed + 10  # a busy machine may be late, never early
    assert "frames in" in capsys.readouterr().err


def test_drawing_the_soil_hides_it_from_terrain_toml(tmp_path: Path) -> None:
    options = SimulationOptions(draw_soil=True, runs=1, duration_s=20.0, seed=3)
    assert true_soil(options) != SOILS["clay"]
    assert true_soil(options) == true_soil(options)
    simulate_campaign(tmp_path / "drawn", options)
    stated = load_toml(tmp_path / "drawn/terrain.toml", TerrainConfig)
    assert stated.soil.cohesion_kpa == 7.58
    assert stated.uncertainty is not None
    assert stated.uncertainty.friction_angle_deg == 0.06


def test_a_terrain_file_is_a_soil(tmp_path: Path) -> None:
    simulate_campaign(tmp_path / "first", SimulationOptions(runs=1, duration_s=20.0))
    again = SimulationOptions(soil=str(tmp_path / "first/terrain.toml"), runs=1, duration_s=20.0)
    assert again.laboratory_soil.cohesion_pa == pytest.approx(7580)
    assert again.terrain == load_toml(tmp_path / "first/terrain.toml", TerrainConfig)


def with_covariance(folder: Path, factor: float = 1.0) -> tuple[Path, np.ndarray]:
    """Return a terrain.toml with correlated parameters, and its covariance."""
    path = folder / f"terrain-{factor:g}.toml"
    sigma = factor * np.array([0.7, 0.8, 0.004, 0.03, 4.0, 40.0])
    covariance = np.diag(sigma**2)
    covariance[0, 1] = covariance[1, 0] = -0.7 * sigma[0] * sigma[1]
    path.write_text(
        "[soil]\nname = 'field'\ncohesion_kpa = 7.58\nfriction_angle_deg = 14\nshear_modulus_m = 0.025\n"
        "sinkage_exponent = 0.85\ncohesive_modulus_kn = 43.68\nfrictional_modulus_kn = 499.3\n"
        f"[uncertainty]\ncovariance = {covariance.tolist()}\n"
    )
    return path, covariance


def test_a_terrain_file_with_a_covariance_is_a_soil_and_keeps_it(tmp_path: Path) -> None:
    path, covariance = with_covariance(tmp_path)
    arguments = ["simulate", "--soil", str(path), "--runs", "1", "--duration", "20", "-o", str(tmp_path / "out")]
    assert wheelsoil(arguments) == 0
    stated = load_toml(tmp_path / "out/terrain.toml", TerrainConfig)
    assert stated == load_toml(path, TerrainConfig)
    assert stated.uncertainty is not None
    assert np.array_equal(np.array(stated.uncertainty.covariance), covariance)
    manifest = tomllib.loads((tmp_path / "out/manifest.toml").read_text())
    assert manifest["truth"]["soil"]["cohesion_pa"] == pytest.approx(7580)


def test_soils_drawn_from_a_covariance_scatter_as_it_says(tmp_path: Path) -> None:
    path, covariance = with_covariance(tmp_path)
    soils = [true_soil(SimulationOptions(soil=str(path), draw_soil=True, seed=seed)) for seed in range(400)]
    drawn = np.array([[s.cohesion_pa / 1e3, np.degrees(s.friction_angle_rad), s.cohesive_modulus / 1e3] for s in soils])
    rows = np.ix_([0, 1, 4], [0, 1, 4])
    sigma = np.sqrt(np.diag(covariance[rows]))
    standard = (drawn - np.array([7.58, 14, 43.68])) / sigma
    assert np.mean(standard, axis=0) == pytest.approx(0, abs=4 / np.sqrt(400))
    assert np.cov(standard.T) == pytest.approx(covariance[rows] / np.outer(sigma, sigma), abs=4 * np.sqrt(2 / 400))


def test_a_soil_drawn_from_a_wide_covariance_is_one_that_can_be(tmp_path: Path) -> None:
    path, _ = with_covariance(tmp_path, factor=12.0)
    for seed in range(50):
        soil = true_soil(SimulationOptions(soil=str(path), draw_soil=True, seed=seed))
        assert soil.cohesion_pa >= 0
        assert soil.shear_modulus_m > 0
        assert soil.stiffness(0.318) > 0


def test_what_is_no_covariance_is_refused(tmp_path: Path) -> None:
    path, covariance = with_covariance(tmp_path)
    covariance[0, 1] = covariance[1, 0] = 3 * covariance[0, 1]
    text = path.read_text().partition("covariance")[0]
    path.write_text(f"{text}covariance = {covariance.tolist()}\n")
    with pytest.raises(ConfigError, match="not positive semi-definite"):
        true_soil(SimulationOptions(soil=str(path), draw_soil=True))


def test_a_parameter_that_is_not_given_beside_others_is_neutral():
    assert parse_effect("stress_peak_shift:c2=0.2") == ("stress_peak_shift", {"c1": 0.0, "c2": 0.2})
    assert parse_effect("lyasko:m1=0.1") == ("lyasko", {"m1": 0.1, "m2": 0.0})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("", "nothing to do"),
        ("--soil clya -o OUT", "nearest: clay"),
        ("--soil nowhere.toml -o OUT", "no such file"),
        ("--effect lyaskp -o OUT", "nearest: lyasko"),
        ("--effect lyasko:m3=1 -o OUT", "has no parameter 'm3'"),
        ("--effect lyasko:m1 -o OUT", "cannot be read"),
        ("--effect lyasko:m1=0.1,m2=2 -o OUT", "out of its bounds"),
        ("--effect lyasko:m1=nan,m2=0 -o OUT", "out of its bounds"),
        ("--effect vasilev --effect vasilev -o OUT", "given twice"),
        ("--runs 0 -o OUT", "number of runs is out of range"),
        ("--duration 5 --runs 0 -o OUT", "2 faults"),
        ("--duration nan -o OUT", "duration is out of range"),
        ("--seed -1 -o OUT", "seed is out of range"),
        ("--noise -1 -o OUT", "noise is out of range"),
        ("--added-load 1e9 -o OUT", "added load is out of range"),
        ("--effect closed_form_sinkage -o OUT", "defined for --sinkage literal only"),
        ("--pass-number 0 -o OUT", "pass number is out of range"),
        ("--inflation 5 -o OUT", "inflation is out of range"),
        ("--radius 0 -o OUT", "wheel radius is out of range"),
        ("--start yesterday -o OUT", "the start is not a time"),
        ("-o OUT/deeper/down", "no such folder"),
        ("-o FILE", "the output is a file"),
        ("-o FULL", "not empty"),
        ("--live nothing-like-it", "knows no interface"),
        ("--live virtual --speed 0", "speed must be positive"),
    ],
)
def test_bad_options_get_one_message(
    arguments: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "FILE").write_text("x")
    (tmp_path / "FULL").mkdir()
    (tmp_path / "FULL/x").write_text("x")
    for name in ("FILE", "FULL", "OUT"):
        arguments = arguments.replace(name, str(tmp_path / name))
    assert wheelsoil(["simulate", *shlex.split(arguments)]) == 2
    printed = capsys.readouterr().err
    assert words in printed
    assert "Traceback" not in printed


def test_an_unknown_effect_is_answered_with_all_that_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert wheelsoil(["simulate", "-o", str(tmp_path / "new"), "--effect", "foo"]) == 2
    printed = capsys.readouterr().err
    assert "known: " not in printed and all(name in printed for name in EFFECTS)


def test_a_family_that_is_given_as_an_effect_is_answered_with_its_forms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert wheelsoil(["simulate", "-o", str(tmp_path / "new"), "--effect", "slip_sinkage:H_m=0.05"]) == 2
    printed, forms = capsys.readouterr().err, [key for key, form in EFFECTS.items() if form.name == "slip_sinkage"]
    assert f"expected: a form of that family: {', '.join(forms)}" in printed and "skid" not in printed


def test_effects_are_parsed() -> None:
    assert parse_effect("ding") == ("ding", {"n1": 0.3})
    assert parse_effect("lyasko:m1=0.1, m2=0.05") == ("lyasko", {"m1": 0.1, "m2": 0.05})
    with pytest.raises(ConfigError):
        SimulationOptions(effects={"lyasko": {}})
