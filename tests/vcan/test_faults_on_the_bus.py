"""Faulty sensors and strange traffic on real buses: health says so in the file, and nothing is lost uncounted."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from vcan import numbered
from vcan.guest import GuestResult
from vcan.session import WHEELSOIL, in_folder, sent_log

from daq.can import FrameBatch, shipped_dbc
from daq.recording import Recording, RecordingWriter

pytestmark = [pytest.mark.vcan, pytest.mark.slow]

CLAY = Path(__file__).parents[2] / "recordings" / "clay"
GNSS_IDS, FORCES_ID = (769, 770, 771), 256
FORCE_BYTES = 6
LOST_S, FROZEN_FROM_S = (8.0, 28.0), 30.0
FLOOD_HZ = 50_000


def faulty_run() -> FrameBatch:
    """Return a run without GNSS for 20 s, and with forces that are frozen from 30 s on while their counter runs."""
    batch = Recording.open(CLAY / "run-1.mcap").frames()
    frames = batch.frames.copy()
    at_s = (frames["time_ns"] - frames["time_ns"][0]) / 1e9
    frozen = (frames["can_id"] == FORCES_ID) & (at_s > FROZEN_FROM_S)
    frames["data"][frozen, :FORCE_BYTES] = frames["data"][np.flatnonzero(frozen)[0], :FORCE_BYTES]
    lost = np.isin(frames["can_id"], GNSS_IDS) & (at_s > LOST_S[0]) & (at_s < LOST_S[1])
    return FrameBatch(frames[~lost], ("vcan0",))


def prepare(folder: Path) -> FrameBatch:
    for name in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc"):
        shutil.copy(shipped_dbc(name), folder)
    text = (CLAY / "vehicle.toml").read_text().replace('channel = "can0"', 'channel = "vcan0"')
    text += '\n[[bus]]\nchannel = "vcan1"\ndbc = ["wheel_speed.dbc"]\n[[bus]]\nchannel = "vcan2"\n'
    (folder / "vehicle.toml").write_text(text, encoding="utf-8")
    run = faulty_run()
    with RecordingWriter(folder / "faulty.mcap") as writer:
        writer.write_frames(run)
    return run


def script(folder: Path) -> str:
    return f"""{in_folder(folder)}
add_bus vcan1
add_bus vcan2
begin --no-page
sending 500 20 wrong.log vcan1
{WHEELSOIL} replay faulty.mcap
sending {FLOOD_HZ} 5 flood.log vcan2
wait $sender
sleep 1
end
"""


def codes(path: Path) -> dict[str, dict[str, list[float]]]:
    """Return for each status of /diagnostics at which times it carried which reason codes."""
    found: dict[str, dict[str, list[float]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, array in reader.iter_decoded_messages(topics=["/diagnostics"]):
            for status in array.status:
                for text in status.message.split("; "):
                    code = text.partition(":")[0]
                    found.setdefault(status.name, {}).setdefault(code, []).append(message.log_time / 1e9)
    return found


def test_health_tells_faults_and_nothing_is_lost_uncounted(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    run = prepare(tmp_path)

    result = vcan(script(tmp_path), timeout_s=240)

    assert result.exit_code == 0, result.output
    [path] = (tmp_path / "out").glob("*.mcap")
    recording = Recording.open(path)
    received = recording.frames("vcan0").frames
    assert np.array_equal(received["data"], run.frames["data"])
    reported = codes(path)
    start_s = received["time_ns"][0] / 1e9
    no_fix = np.array(reported["gnss"]["gnss_no_fix"]) - start_s
    during = (no_fix > LOST_S[0] + 2) & (no_fix < LOST_S[1])
    assert during.sum() > 10, no_fix
    stuck = {name: times for name, found in reported.items() for code, times in found.items() if code == "signal_stuck"}
    assert stuck, reported
    assert min(min(times) for times in stuck.values()) - start_s > FROZEN_FROM_S
    assert "dbc_does_not_fit" in reported["vcan1"], reported["vcan1"]

    summary = json.loads((tmp_path / "summary.json").read_text())
    for bus, log in (("vcan1", "wrong.log"), ("vcan2", "flood.log")):
        sent = sent_log(tmp_path / log)
        frames = recording.frames(bus).frames
        assert len(frames) + summary["drops"][bus] == sent["end"][-1]
        assert (np.diff(numbered.numbers(frames).astype(np.int64)) > 0).all()
    rate_hz = sent["end"][-1] / ((sent["time_ns"][-1] - sent["time_ns"][0]) / 1e9)
    print(f"{sent['end'][-1]} unknown frames at {rate_hz:.0f} /s, {summary['drops']['vcan2']} of them lost and counted")
