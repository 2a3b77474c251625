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
from vcan.session import WHEELSOIL

pytestmark = pytest.mark.vcan

TESTS = Path(__file__).parents[1]
DOCTOR = f"{WHEELSOIL} doctor vehicle.toml --out . --listen 1 --json 2> /dev/null"


def line(report: Path, check: str) -> dict[str, Any]:
    (found,) = [line for line in json.loads(report.read_text())["lines"] if line["check"] == check]
    return found


@pytest.mark.slow
def test_a_virtual_bus_up_down_and_with_a_small_buffer(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    vehicle_folder(tmp_path, channel='"vcan0"', interface='"socketcan"')
    (tmp_path / "send.py").write_text(
        f"import sys, time; sys.path.insert(0, {str(TESTS)!r})\n"
        "from pathlib import Path\nfrom doctor_support import nodes\n"
        "with nodes(Path('vehicle.toml')):\n    Path('sending').touch()\n    time.sleep(60)\n"
    )
    script = f"""
cd {tmp_path}
{sys.executable} send.py &
sender=$!
while [ ! -e sending ]; do sleep 0.1; done
echo 8388608 > /proc/sys/net/core/rmem_max
{DOCTOR} > well.json; echo $? > code
{sys.executable} - <<'END'
import ctypes, os, subprocess, sys
# without CAP_NET_ADMIN (12) in the bounding set, the receive buffer is what rmem_max allows
open("/proc/sys/net/core/rmem_max", "w").write("212992")
ctypes.CDLL(None).prctl(24, 12, 0, 0, 0)
with open("small.json", "w") as out:
    subprocess.run([{str(WHEELSOIL)!r}, *"doctor vehicle.toml --out . --listen 1 --json".split()], stdout=out)
END
kill $sender; wait $sender
{DOCTOR} > silent.json
ip link set vcan0 down
{DOCTOR} > down.json
ip link del vcan0
{DOCTOR} > gone.json
exit 0
"""
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
import fcntl, os, struct, subprocess, sys, threading, time, tty
adapter, serial = os.openpty()
tty.setraw(serial)

def answer_nothing():
    while os.read(adapter, 4096):
        pass

threading.Thread(target=answer_nothing, daemon=True).start()
fcntl.ioctl(serial, 0x5423, struct.pack("i", 17))  # TIOCSETD, N_SLCAN
name = fcntl.ioctl(serial, 0x8910, bytes(16)).split(b"\\0")[0].decode()  # SIOCGIFNAME

def doctor(report):
    with open(report, "w") as out:
        subprocess.run([WHEELSOIL, *"doctor vehicle.toml --out . --listen 0.3 --json".split()], stdout=out)

def set_link(*words):
    subprocess.run(["ip", "link", "set", name, *words], check=True)

assert name == "can0", name
doctor("unset.json")
set_link("type", "can", "bitrate", "500000")
set_link("up")
doctor("wrong_rate.json")
set_link("down")
set_link("type", "can", "bitrate", "1000000")
set_link("txqueuelen", "5")
set_link("up")
doctor("right_rate.json")
os.write(adapter, b"sp140140\\r")  # the adapter tells of an error-passive controller
time.sleep(0.2)
doctor("passive.json")
os.write(adapter, b"sb255255\\r")
time.sleep(0.2)
doctor("bus_off.json")
"""


@pytest.mark.slow
def test_a_controller_with_a_bit_rate_of_its_own(vcan: Callable[..., GuestResult], tmp_path: Path) -> None:
    vehicle_folder(tmp_path, channel='"can0"', interface='"socketcan"')
    (tmp_path / "adapter.py").write_text(f"WHEELSOIL = {str(WHEELSOIL)!r}\n{ADAPTER}")
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
