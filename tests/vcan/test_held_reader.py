"""A reader that is held: what is lost is counted exactly, and the page of a logger on vcan0 shows it, as a mark."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from vcan.guest import GuestResult
from vcan.session import PAGE, ROLES, in_folder, info, make_vehicle, received_numbers, sent_log, snapshots

from daq.recording import Recording

pytestmark = pytest.mark.vcan

FREEZE_AT = 48_000


def held(folder: Path, send_s: float, before: str, options: str = "") -> str:
    return f"""{in_folder(folder)}
begin {options}
export FREEZE_AT={FREEZE_AT}
sending 8000 {send_s} sent.log vcan0
{before}
kill -STOP $logger
sleep 1
kill -CONT $logger
wait $sender
sleep 1
end
"""


def check_losses(folder: Path) -> Recording:
    """Hold what was received and what is reported lost against what was sent."""
    sent = int(sent_log(folder / "sent.log")["end"][-1])
    summary = json.loads((folder / "summary.json").read_text())
    [path] = (folder / "out").glob("*.mcap")
    recording = Recording.open(path)
    received = len(received_numbers(recording, freeze_at=FREEZE_AT))
    lost = summary["drops"]["vcan0"]
    print(f"{sent} sent, {received} received, {lost} reported lost")
    assert lost > 1000
    assert received + lost == sent
    assert summary["frames"]["vcan0"] == received
    assert summary["losses"]["kernel.vcan0"] == lost
    assert recording.metadata["run_end"]["drops.vcan0"] == str(lost)
    facts = info(path)
    assert facts["drops"] == {"vcan0": lost}
    assert facts["losses"]["kernel.vcan0"] == lost
    return recording


@pytest.mark.slow
def test_a_held_reader_with_the_usual_buffer_is_counted_exactly(
    vcan: Callable[..., GuestResult], tmp_path: Path
) -> None:
    """104 kB, which the kernel doubles, is its default of 212,992 bytes: 278 frames."""
    make_vehicle(tmp_path, "vcan0", logger="receive_buffer_kb = 104")
    result = vcan(held(tmp_path, 4, "sleep 1", "--no-page"), timeout_s=60)
    assert result.exit_code == 0, result.output
    check_losses(tmp_path)


def watched() -> str:
    """Return what to do before the reader is held: look on, wait for a frozen sensor, put a mark."""
    return f"""
curl --silent --no-buffer {PAGE}/events > watched.txt &
until test $(stat --format %s sent.log) -gt {FREEZE_AT // 80 * 16}; do sleep 0.1; done
for _ in $(seq 60); do if grep --quiet signal_stuck watched.txt; then break; fi; sleep 0.1; done
curl --silent --fail --header 'Content-Type: application/json' --header 'Origin: {PAGE}' \\
  --data '{{"kind": "mark", "text": "stone on the track"}}' {PAGE}/command
"""


@pytest.mark.slow
def test_the_page_shows_a_frozen_sensor_and_losses(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    """A slow machine may lose frames before the reader is held: the page's level is then red throughout."""
    make_vehicle(tmp_path, "vcan0", logger="receive_buffer_kb = 2000", more=ROLES)

    result = vcan(held(tmp_path, 15, watched()), timeout_s=180)

    assert result.exit_code == 0, result.output
    recording = check_losses(tmp_path)
    assert "stone on the track" in [event.text for event in recording.events() if event.name == "mark"]
    shown = snapshots(tmp_path / "watched.txt")
    reasons = [{(reason["code"], reason["level"]) for reason in one["reasons"]} for one in shown]
    assert any(("signal_stuck", "amber") in said for said in reasons), reasons
    assert any(("kernel_drops", "red") in said for said in reasons), reasons
    assert shown[-1]["buses"][0]["kernel_drops"] == int(recording.metadata["run_end"]["drops.vcan0"])
