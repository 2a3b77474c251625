"""A busy bus for minutes, with decoding and the page: nothing is lost, and the logger does not grow.

By hand for half an hour: ``pytest -m study -s tests/vcan/test_soak.py``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from vcan.guest import GuestResult
from vcan.session import ROLES, in_folder, make_vehicle, received_numbers, sent_log

from daq.recording import Recording

pytestmark = pytest.mark.vcan

RATE_HZ = 8000
WARM_UP_S = 25
MOST_GROWTH = 0.05


def soaking(folder: Path, seconds: int) -> str:
    """Return a script: a logger, a sender, a client of the page, and a measurement of the memory every second."""
    return f"""{in_folder(folder)}
begin
sending {RATE_HZ} {seconds} sent.log vcan0
curl --silent --no-buffer http://127.0.0.1:8100/events > watched.txt &
phone=$!
while kill -0 $sender 2> /dev/null; do
  read up rest < /proc/uptime
  while read name value unit; do test "$name" != VmRSS: || echo $up $value; done < /proc/$logger/status >> rss.txt
  sleep 1
done
sleep 1
end
kill $phone 2> /dev/null || true
"""


@pytest.mark.parametrize(
    "seconds", [pytest.param(60, marks=pytest.mark.slow), pytest.param(1800, marks=pytest.mark.study)]
)
def test_a_busy_bus_for_long(vcan: Callable[..., GuestResult], tmp_path: Path, seconds: int) -> None:
    make_vehicle(tmp_path, "vcan0", logger="rotate_mb = 20", more=ROLES)

    result = vcan(soaking(tmp_path, seconds), timeout_s=seconds + 120)

    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    sent = int(sent_log(tmp_path / "sent.log")["end"][-1])
    up_s, rss_kb = np.loadtxt(tmp_path / "rss.txt").T
    settled = rss_kb[up_s > up_s[0] + WARM_UP_S]
    growth = float(np.median(settled[-10:]) / np.median(settled[:10]) - 1)
    print(f"{seconds} s: {sent:,} frames sent, {summary['frames']['vcan0']:,} recorded, lost {summary['losses']}")
    print(f"RSS {settled[:10].mean() / 1024:.1f} MiB, {settled[-10:].mean() / 1024:.1f} MiB at the end: {growth:+.2%}")
    assert summary["frames"] == {"vcan0": sent}
    assert summary["drops"] == {"vcan0": 0}
    assert summary["losses"] == {}
    parts = [received_numbers(Recording.open(tmp_path / path)) for path in summary["paths"]]
    assert np.array_equal(np.concatenate(parts), np.arange(sent))
    assert abs(growth) < MOST_GROWTH
    assert (tmp_path / "watched.txt").read_text().count("data:") > seconds
