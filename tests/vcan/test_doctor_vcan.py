"""The doctor before real SocketCAN interfaces: a virtual bus, and a controller behind a serial adapter."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from doctor_support import vehicle_folder
from vcan.guest import GuestResult

pytestmark = pytest.mark.vcan

TESTS = Path(__file__).parents[1]


def driver(steps: str) -> str:
    """Return a program that runs the doctor between other steps; the first run is `examine`, which loads it."""
    return (
        f"import sys; sys.path.insert(0, {str(TESTS)!r})\n"
        "from pathlib import Path\n"
        "from vcan.doctors import examine, examine_apart, forked, without_capabilities\n" + steps
    )


def line(report: Path, check: str) -> dict[str, Any]:
    (found,) = [line for line in json.loads(report.read_text())["lines"] if line["check"] == check]
    return found


BUS = """
import os, signal, subprocess, time
from doctor_support import nodes

def send():
    with nodes(Path("vehicle.toml")):
        Path("sending").touch()
        time.sleep(120)
    return 0

def most_bytes(count):
    Path("/proc/sys/net/core/rmem_max").write_text(str(count))

sender = forked(send)
while not Path("sending").exists():
    time.sleep(0.1)
most_bytes(8388608)
Path("code").write_text(str(examine(Path("well.json"))))
most_bytes(212992)
examine_apart(Path("small.json"), before=without_capabilities)
os.kill(sender, signal.SIGTERM)
os.waitpid(sender, 0)
examine_apart(Path("silent.json"))
subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
examine_apart(Path("down.json"))
subprocess.run(["ip", "link", "del", "vcan0"], check=True)
examine_apart(Path("gone.json"))
"""


@pytest.mark.slow
def test_a_virtual_bus_up_down_and_with_a_small_buffer(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    vehicle_folder(tmp_path, channel='"vcan0"', interface='"socketcan"')
    (tmp_path / "bus.py").write_text(driver(BUS))
    script = f"cd {tmp_path}; {sys.executable} bus.py"
    result = vcan(script, timeout_s=180)
    assert result.exit_code == 0, result.output
    well = json.loads((tmp_path / "well.json").read_text())
    assert [one for one in well["lines"] if one["verdict"] == "fail"] == []
    assert (tmp_path / "code").read_text().strip() == "0"
    for check in ("interface", "bit rate", "receive buffer", "time stamps", "traffic", "DBC coverage", "GNSS time"):
        assert line(tmp_path / "well.json", check)["verdict"] == "pass", check
    small = line(tmp_path / "small.json", "receive buffer")
    assert small["verdict"] == "warn"
    assert "212992 instead of 8388608" in small["found"]
    assert "silent" in line(tmp_path / "silent.json", "traffic")["found"]
    assert "is down" in line(tmp_path / "down.json", "interface")["found"]
    assert line(tmp_path / "down.json", "interface")["next_step"] == "ip link set vcan0 up"
    assert "no interface vcan0" in line(tmp_path / "gone.json", "interface")["found"]


ADAPTER = """
import fcntl, os, signal, struct, subprocess, time, tty
adapter, serial = os.openpty()
tty.setraw(serial)

def answer_nothing():
    while os.read(adapter, 4096):
        pass
    return 0

reader = forked(answer_nothing)
fcntl.ioctl(serial, 0x5423, struct.pack("i", 17))  # TIOCSETD, N_SLCAN
name = fcntl.ioctl(serial, 0x8910, bytes(16)).split(b"\\0")[0].decode()  # SIOCGIFNAME

def set_link(*words):
    subprocess.run(["ip", "link", "set", name, *words], check=True)

assert name == "can0", name
examine(Path("unset.json"), 0.3)
set_link("type", "can", "bitrate", "500000")
set_link("up")
examine_apart(Path("wrong_rate.json"), 0.3)
set_link("down")
set_link("type", "can", "bitrate", "1000000")
set_link("txqueuelen", "5")
set_link("up")
examine_apart(Path("right_rate.json"), 0.3)
os.write(adapter, b"sp140140\\r")  # the adapter tells of an error-passive controller
time.sleep(0.2)
examine_apart(Path("passive.json"), 0.3)
os.write(adapter, b"sb255255\\r")
time.sleep(0.2)
examine_apart(Path("bus_off.json"), 0.3)
os.kill(reader, signal.SIGTERM)
"""


@pytest.mark.slow
def test_a_controller_with_a_bit_rate_of_its_own(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    vehicle_folder(tmp_path, channel='"can0"', interface='"socketcan"')
    (tmp_path / "adapter.py").write_text(driver(ADAPTER))
    script = f"""
cd {tmp_path}
insmod "$(ls /usr/lib/uml/modules/*/kernel/drivers/net/can/slcan/slcan.ko)" || exit 77
mkdir -p /dev/pts; mount -t devpts devpts /dev/pts
{sys.executable} adapter.py
"""
    result = vcan(script, timeout_s=180)
    if result.exit_code == 77:
        pytest.skip("the serial adapter's driver is only in the guest")
    assert result.exit_code == 0, result.output
    unset = line(tmp_path / "unset.json", "bit rate")
    assert (unset["verdict"], unset["found"]) == ("fail", "the interface has no bit rate")
    assert "is down" in line(tmp_path / "unset.json", "interface")["found"]
    wrong = line(tmp_path / "wrong_rate.json", "bit rate")
    assert wrong["verdict"] == "fail"
    assert "500000 bit/s, vehicle.toml says 1000000" in wrong["found"]
    assert "bitrate 1000000" in wrong["next_step"]
    right = tmp_path / "right_rate.json"
    assert line(right, "bit rate")["found"] == "1000000 bit/s"
    assert line(right, "controller")["found"] == "ERROR-ACTIVE"
    assert "for ever" in line(right, "bus-off")["found"]
    assert line(right, "send queue")["verdict"] == "warn"
    assert "silent" in line(right, "traffic")["found"]
    assert line(tmp_path / "passive.json", "controller")["verdict"] == "warn"
    assert line(tmp_path / "bus_off.json", "controller")["verdict"] == "fail"
