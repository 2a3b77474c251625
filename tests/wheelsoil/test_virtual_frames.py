"""Channels of the virtual test through frames and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_support import simulated

from daq import Channel, DataError, Quantity, find_unit
from daq.can import Decoder, FrameBatch, load_database, shipped_dbc
from daq.logs import read_log, write_candump
from daq.recording import Recording, RecordingWriter
from model.simulation import Steering, TransducerSetup, VirtualSetup
from wheelsoil.simulation.campaign import frames_sha256
from wheelsoil.simulation.vehicle import _LAYOUT, DBC_FILES, MOTION_DBC, virtual_frames

SHORT = VirtualSetup(duration_s=20.0, steering=Steering(0.15, 2.7, 0.9j))
DATABASES = tuple(load_database(shipped_dbc(name)) for name in (*DBC_FILES, MOTION_DBC))
MESSAGES = {message.name: message for database in DATABASES for message in database.messages}


@pytest.fixture(scope="module")
def frames() -> FrameBatch:
    return virtual_frames(simulated(SHORT, 2))


@pytest.fixture(scope="module")
def decoded(frames: FrameBatch) -> dict[str, Channel]:
    return {name: channel for (_, name), channel in Decoder({"can0": DATABASES}).decode(frames).items()}


def test_every_channel_comes_back_within_half_a_bit(decoded: dict[str, Channel]) -> None:
    run = simulated(SHORT, 2)
    seen = set()
    for sensor, layout in _LAYOUT.items():
        for message, signals in layout:
            for name, quantity in signals.items():
                signal, sent = MESSAGES[message].by_name[name], run.sensors[sensor][quantity]
                unit = find_unit(signal.unit, (Quantity(sent.unit),)) if sent.unit else None
                factor, offset = (unit.factor, unit.offset) if unit else (1.0, 0.0)
                got = decoded[f"{message}.{name}"].values * factor + offset
                apart = np.abs(got - sent.values)
                if sent.unit == "rad" and signal.minimum == 0:
                    apart = np.minimum(apart, 2 * np.pi - apart)
                assert apart.max() <= 0.5 * abs(signal.scale) * factor * (1 + 1e-6), (message, name)
                seen.add((sensor, quantity))
    assert seen == {(sensor, name) for sensor, channels in run.sensors.items() for name in channels}


def test_values_lie_in_the_ranges_that_the_dbc_states(decoded: dict[str, Channel]) -> None:
    for name, channel in decoded.items():
        message, signal = name.split(".")
        stated = MESSAGES[message].by_name[signal]
        if channel.labels and set(np.unique(channel.values)) <= {655.34}:
            continue  # "Not available" lies behind the range on purpose
        assert stated.minimum is not None
        assert stated.maximum is not None
        assert channel.values.min() >= stated.minimum, name
        assert channel.values.max() <= stated.maximum, name


def test_what_nothing_measures_is_not_available(decoded: dict[str, Channel]) -> None:
    for wheel in ("FrontLeft", "FrontRight", "RearRight"):
        assert np.all(decoded[f"WheelSpeeds.{wheel}"].values == pytest.approx(32767 * 0.02))
    assert np.all(decoded["GNSS_3.Solution"].values == 1)


def test_rolling_counters_roll(decoded: dict[str, Channel]) -> None:
    for message in ("WFT_Forces", "WFT_Moments", "WFT_Wheel", "WheelSpeeds", "GNSS_3", "VehicleMotion"):
        steps = np.diff(decoded[f"{message}.Counter"].values) % 16
        assert np.all(steps == 1), message


def test_the_bus_carries_one_frame_at_a_time(frames: FrameBatch) -> None:
    bits = np.rint((47 + 8 * frames.frames["length"].astype(float)) * 1.1)
    apart = np.diff(frames.frames["time_ns"])
    assert np.all(apart >= bits[1:] * 1000)
    assert len(frames) == pytest.approx(20 * (3 * 1000 + 2 * 100 + 3 * 20), rel=1e-3)
    late = np.median(apart[frames.frames["can_id"][1:] == 257])
    assert late == pytest.approx(113_000, abs=1000)  # the moments follow the forces at once


def test_frames_survive_recording_and_log(frames: FrameBatch, tmp_path) -> None:
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.write_frames(frames)
    read = list(Recording.open(tmp_path / "run.mcap").frame_batches())
    assert frames_sha256(FrameBatch(np.concatenate([b.frames for b in read]), ("can0",))) == frames_sha256(frames)
    write_candump([frames], tmp_path / "run.log")
    logged = list(read_log(tmp_path / "run.log"))
    assert frames_sha256(FrameBatch(np.concatenate([b.frames for b in logged]), ("can0",))) == frames_sha256(frames)


def test_a_force_beyond_its_signal_is_refused() -> None:
    loud = replace(SHORT, transducer=TransducerSetup(drawbar_pull_noise_n=50_000.0))
    with pytest.raises(DataError, match=r"exceeds the range of WFT_Forces\.Fx"):
        virtual_frames(simulated(loud, 2))
