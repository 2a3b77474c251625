"""What happens on a test day: interfaces that go and come, a clock that is set, a disk that is full."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from vcan.disks import disk
from vcan.guest import GuestResult
from vcan.session import in_folder, info, make_vehicle, received_numbers, sent_log, snapshots, watch

from daq.can import FrameFlag
from daq.recording import Recording

pytestmark = pytest.mark.vcan


def rough(folder: Path) -> str:
    return f"""{in_folder(folder)}
add_bus vcan1
begin
{watch("watched.txt")}
sending 2000 1000 sent.log vcan0
cansend vcan1 123#01
sleep 1
ip link set vcan1 down
sleep 1.5
ip link set vcan1 up
sleep 1
cansend vcan1 123#02
sleep 0.5
ip link del vcan1
sleep 1.5
add_bus vcan1
sleep 3.5
cansend vcan1 123#03
date -s "+1 hour"
sleep 1.5
date -s "-1 hour"
sleep 1.5
kill $sender
sleep 1
end
"""


@pytest.mark.slow
def test_interfaces_come_back_and_a_clock_may_be_set(guest: Callable[..., GuestResult], tmp_path: Path) -> None:
    make_vehicle(tmp_path, "vcan0", "vcan1")

    result = guest(rough(tmp_path), timeout_s=90)

    assert result.exit_code == 0, result.output
    [path] = (tmp_path / "out").glob("*.mcap")
    recording = Recording.open(path)
    sent = sent_log(tmp_path / "sent.log")
    number = received_numbers(recording)
    assert np.array_equal(number, np.arange(sent["end"][-1]))
    frames = recording.frames("vcan0").frames
    sure = (frames["flags"] & FrameFlag.UNCERTAIN_TIME) == 0
    assert sure.mean() > 0.9
    due_ns = sent["time_ns"][np.searchsorted(sent["end"], number, side="right")]
    late_s = (frames["time_ns"] - due_ns)[sure] / 1e9
    assert late_s.max() - late_s.min() < 1.0  # the steps are of 3,600
    assert recording.frames("vcan1").frames["data"][:, 0].tolist() == [1, 2, 3]
    facts = info(path)
    texts = [event["text"] for event in facts["events"] if event["name"] == "bus"]
    assert len(texts) == 4, texts
    assert [text for text in texts if "back after" in text] == texts[1::2]
    clock = [event["text"] for event in facts["events"] if event["name"] == "clock"]
    assert len(clock) == 2, clock
    assert "+3" in clock[0] and "-3" in clock[1], clock
    assert facts["clock_steps"]
    stepped = [
        one["what"]
        for snapshot in snapshots(tmp_path / "watched.txt")
        for one in snapshot["reasons"]
        if one["code"] == "clock_stepped"
    ]
    assert "+3" in stepped[0] and "-3" in stepped[-1], stepped


def filled(folder: Path) -> str:
    return f"""{in_folder(folder)}
mkdir -p small
mount -t tmpfs -o size=8m none small
out=small/guarded
begin
{watch("guarded.events")}
sending 8000 1000 sent.log vcan0
sleep 2
head -c 5500000 /dev/zero > small/filler
wait $logger && code=0 || code=$?
echo $code > guarded.code
mv said.txt guarded.txt
rm small/filler
sed -i 's/disk_reserve_mb = 3/disk_reserve_mb = 0.001/' vehicle.toml
out=small/defeated
begin
{watch("defeated.events")}
sleep 2
cat /dev/zero > small/filler || true
wait $logger && code=0 || code=$?
echo $code > defeated.code
mv said.txt defeated.txt
mount -t sysfs none /sys
mkdir card
mount -o errors=remount-ro /dev/ubda card
out=card/failed
begin
{watch("failed.events")}
sleep 2
echo 1 > /sys/fs/ext4/ubda/trigger_fs_error
wait $logger && code=0 || code=$?
echo $code > failed.code
mv said.txt failed.txt
kill $sender
cp -a small/guarded small/defeated card/failed .
"""


@pytest.mark.slow
def test_a_full_or_failed_disk_ends_it_with_a_valid_file(guest: Callable[..., GuestResult], tmp_path: Path) -> None:
    """The guard ends it in time; where another program is quicker, or the card fails, what was written stays."""
    make_vehicle(tmp_path, "vcan0", logger="disk_reserve_mb = 3")

    result = guest(filled(tmp_path), timeout_s=240, disks=[disk(tmp_path / "card.img", 64)])

    assert result.exit_code == 0, result.output
    for name, found in (
        ("guarded", "the disk is full up to the reserve"),
        ("defeated", "No space left on device"),
        ("failed", "Read-only file system"),
    ):
        said = (tmp_path / f"{name}.txt").read_text()
        assert (tmp_path / f"{name}.code").read_text() == "4\n", said
        assert found in said and "Traceback" not in said
        last = snapshots(tmp_path / f"{name}.events")[-1]
        [shown] = [one for one in last["reasons"] if one["code"] == "disk_failed"]
        assert last["level"] == shown["level"] == "red" and found in shown["what"], last
        [path] = (tmp_path / name).glob("*.mcap")
        recording = Recording.open(path)
        number = received_numbers(recording)
        assert len(number) > 1000
        assert (np.diff(number) == 1).all()
        if name == "guarded":
            assert not recording.loss
            assert recording.metadata["run_end"]["exit_status"] == "disk full or failed"


def refused(folder: Path) -> str:
    return f"""{in_folder(folder)}
attempt() {{ name=$1; shift; "$WHEELSOIL" log "$@" > $name.txt 2>&1 && code=0 || code=$?; echo $code > $name.code; }}
sed 's/vcan0/vcan7/' vehicle.toml > missing.toml
attempt missing missing.toml --out missing
mkdir locked
mount -t tmpfs -o ro none locked
attempt locked vehicle.toml --out locked
ip link set vcan0 down
begin --no-page
attempt second vehicle.toml --out out
ip link set vcan0 up
sleep 1
cansend vcan0 300#0000000000000000
sleep 1
end
"""


@pytest.mark.slow
def test_what_cannot_be_is_reported_and_leaves_nothing(guest: Callable[..., GuestResult], tmp_path: Path) -> None:
    make_vehicle(tmp_path, "vcan0")

    result = guest(refused(tmp_path), timeout_s=120)

    assert result.exit_code == 0, result.output
    for name, code, what in (
        ("missing", 4, "there is no interface vcan7"),
        ("locked", 2, "the folder cannot be written to"),
        ("second", 4, "another logger records into this folder"),
    ):
        said = (tmp_path / f"{name}.txt").read_text()
        assert (tmp_path / f"{name}.code").read_text() == f"{code}\n", said
        assert what in said
        assert "Traceback" not in said
    assert not (tmp_path / "missing").exists()
    assert not list((tmp_path / "locked").iterdir())
    assert "vcan0 is down" in (tmp_path / "said.txt").read_text()
    [path] = (tmp_path / "out").glob("*.mcap")
    assert received_numbers(Recording.open(path)).tolist() == [0]
