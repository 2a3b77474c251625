"""A run with hidden zero offsets, zeroed by a lifted wheel before and after it, against the same run without them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import busy, invoke, ok
from virtual_support import START_NS, WHEEL, simulated
from zero_support import Bench, write_lifted

from daq import Channel, load_zeros
from daq.can import shipped_dbc
from daq.recording import Recording, RecordingWriter
from daq.runs import vehicle_from_file
from model.simulation import TransducerSetup, VirtualRun, VirtualSetup
from processing import ProcessedRun
from wheelsoil.simulation.campaign import to_toml
from wheelsoil.simulation.vehicle import DBC_FILES, vehicle_config, virtual_frames
from wheelsoil.wording.notes import texts_of
from wheelsoil.workflows import open_and_process

HOUR_NS = 3600 * 10**9
COLUMNS = {
    "drawbar_pull": "drawbar_pull_n",
    "vertical_load": "vertical_load_n",
    "driving_torque": "driving_torque_nm",
}


def _setup(frame: str, zero: str) -> VirtualSetup:
    transducer = TransducerSetup(
        frame=frame,  # type: ignore[arg-type]
        zero=zero,  # type: ignore[arg-type]
        zero_offset_n=(0.0, 0.0),
        angle_offset_deg=40.0 if frame == "wheel" else 0.0,
    )
    return VirtualSetup(duration_s=25.0, transducer=transducer)


def _bench(setup: VirtualSetup, after: bool = False) -> Bench:
    start_ns = START_NS + HOUR_NS if after else START_NS - HOUR_NS
    return Bench(
        frame=setup.transducer.frame,
        angle_offset_deg=setup.transducer.angle_offset_deg,
        tared=setup.transducer.zero == "lifted",
        box_n=140.0 + 90.0j if setup.transducer.frame == "vehicle" else 0j,
        torque_nm=60.0 if after else 40.0,
        duration_s=25.0,
        noise=10.0,
        start_ns=start_ns,
    )


def _with_offsets(run: VirtualRun, setup: VirtualSetup, bench: Bench) -> VirtualRun:
    """Add what the bench's transducer adds; its torque is half way between the spin before and the one after."""
    sent = run.sensors["transducer"]
    psi = sent["wheel_angle"].values - np.radians(setup.transducer.angle_offset_deg)
    added = np.full(len(psi), bench.bridges_n)
    if setup.transducer.frame == "vehicle":
        added = added * np.exp(-1j * psi) + bench.box_n
    extra = {"drawbar_pull": added.real, "vertical_load": added.imag, "driving_torque": np.full(len(psi), 50.0)}
    changed = {
        name: Channel(c.name, c.unit, c.time_ns, c.values + extra[name]) if name in extra else c
        for name, c in sent.items()
    }
    return replace(run, sensors=run.sensors | {"transducer": changed})


def _folder(path: Path, setup: VirtualSetup, run: VirtualRun, zero_file: str) -> Path:
    path.mkdir()
    config = vehicle_config(setup, WHEEL, "can0")
    config = config.model_copy(update={"transducer": config.transducer.model_copy(update={"zero_file": zero_file})})
    (path / "vehicle.toml").write_bytes(to_toml(config))
    for name in DBC_FILES:
        (path / name).write_bytes(shipped_dbc(name).read_bytes())
    with RecordingWriter(path / "run.mcap", flush_every_s=None, sync_every_s=None) as writer:
        writer.write_frames(virtual_frames(run))
    return path


def _processed(folder: Path) -> ProcessedRun:
    from processing import ProcessOptions

    ((_, run),) = open_and_process([folder], ProcessOptions())
    return run


@pytest.mark.parametrize(
    ("frame", "zero"),
    [("vehicle", "spin"), pytest.param("vehicle", "lifted", marks=pytest.mark.slow), ("wheel", "spin")],
)
def test_the_zero_gives_back_the_run_without_offsets(frame: str, zero: str, tmp_path: Path) -> None:
    setup = _setup(frame, zero)
    run = simulated(setup, seed=4)
    clean = _processed(_folder(tmp_path / "clean", setup, run, ""))
    spoilt_folder = _folder(tmp_path / "spoilt", setup, _with_offsets(run, setup, _bench(setup)), "zero.toml")

    missing = invoke("process", spoilt_folder)
    assert missing.code == 2
    assert "zero.toml" in missing.err
    assert "wheelsoil zero" in missing.err

    spins = tmp_path / "spins"
    spins.mkdir()
    files = [write_lifted(spins / f"{late}.mcap", _bench(setup, late), 20 + late) for late in (False, True)]
    ok("zero", *files, "-o", spoilt_folder / "zero.toml")
    zeroed = _processed(spoilt_folder)
    used = clean.used & zeroed.used
    assert used.sum() > 1000
    for role, column in COLUMNS.items():
        left = float(np.mean(getattr(zeroed, column)[used] - getattr(clean, column)[used]))
        systematic = zeroed.quality.sensors[role].systematic_sigma
        assert 0.1 < systematic < 5
        assert abs(left) < 3.5 * systematic, f"{role}: {left:.2f} +- {systematic:.2f}"
        zero_of = zeroed.quality.zeros[role]
        assert zero_of.methods == ("spin", "spin")
        assert zero_of.ages_s == pytest.approx((3600, -3600), abs=60)
    ripple = np.std((zeroed.drawbar_pull_n - clean.drawbar_pull_n)[used])
    assert ripple < 4
    notes = " ".join(texts_of(zeroed.quality.notes))
    assert "1.0 h" in notes or "60 min before the run" in notes
    drift = re.search(r"the zero of driving_torque moved by \+([\d.]+) ± ([\d.]+)", notes)
    assert drift
    assert abs(float(drift[1]) - 20.0) < 4 * float(drift[2])
    assert "wheel angle is not known" not in notes


def test_a_recording_carries_its_zeros_and_says_them(tmp_path: Path) -> None:
    setup = _setup("vehicle", "spin")
    folder = _folder(tmp_path / "run", setup, _with_offsets(simulated(setup, seed=4), setup, _bench(setup)), "z.toml")
    spin = write_lifted(tmp_path / "spin.mcap", _bench(setup), 20)
    ok("zero", spin, "-o", folder / "z.toml")
    known = vehicle_from_file(folder / "vehicle.toml")
    assert known.attachments["z.toml"] == (folder / "z.toml").read_bytes()
    alone = tmp_path / "alone.mcap"
    with RecordingWriter(alone, attachments=known.attachments, flush_every_s=None, sync_every_s=None) as writer:
        for batch in Recording.open(folder / "run.mcap").frame_batches():
            writer.write_frames(batch)
    (printed,) = ok("process", alone, "--json").json
    assert printed["quality"]["zeros"]["drawbar_pull"]["recordings"] == ["spin.mcap"]
    systematic = printed["quality"]["sensors"]["drawbar_pull"]["systematic_sigma"]
    (one,) = load_zeros(folder / "z.toml").zero
    assert systematic == pytest.approx(one.channels["WFT_Forces.Fx"].offset_sigma)
    (other,) = ok("process", alone, "--zero", folder / "z.toml", "--json").json
    assert other["summary"] == printed["summary"]
    text = ok("process", alone)
    assert "zero ±" in text.out
    assert "60 min before the run" in " ".join(text.err.split())  # long lines are folded
    (folder / "z.toml").unlink()  # a vehicle.toml without it beside it: what the recording carries holds
    (again,) = ok("process", alone, "--vehicle", folder / "vehicle.toml", "--json").json
    assert again["summary"] == printed["summary"]
    nowhere = invoke("process", folder / "run.mcap")
    assert nowhere.code == 2
    assert "no 'z.toml' lies beside vehicle.toml" in nowhere.err
    broken = tmp_path / "broken.toml"
    broken.write_text("[[zero]]\n")
    assert invoke("process", alone, "--zero", broken).code == 2


def test_the_logger_attaches_the_zeros_that_vehicle_toml_names(tmp_path: Path) -> None:
    ok("zero", write_lifted(tmp_path / "spin.mcap", Bench(), 1), "-o", tmp_path / "zero.toml")
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[[bus]]\nchannel = "zeros"\ninterface = "virtual"\n[transducer]\nzero_file = "zero.toml"\n')
    with busy("zeros"):
        ok("log", vehicle, "--duration", 0.3, "-o", tmp_path / "logged.mcap")
    carried = Recording.open(tmp_path / "logged.mcap").attachments
    assert carried["zero.toml"] == (tmp_path / "zero.toml").read_bytes()
    (tmp_path / "zero.toml").write_text("[[zero]]\n")
    wrong = invoke("log", vehicle, "--duration", 0.3, "-o", tmp_path / "again.mcap")
    assert wrong.code == 2
    assert not (tmp_path / "again.mcap").exists()
