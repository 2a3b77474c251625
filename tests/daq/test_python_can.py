"""Interfaces of python-can: those that cannot be opened say why, and a multicast bus hears its own group only."""

from __future__ import annotations

import importlib
import importlib.metadata
import itertools
import os
import sys
from contextlib import ExitStack, closing

import can
import pytest

from daq import BusSection, HardwareError
from daq.sources.python_can import _EXTRAS, PythonCanSource, open_bus


def test_an_interface_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    importlib.import_module("can.interfaces.udp_multicast")  # what is loaded now is back after the test
    monkeypatch.setitem(sys.modules, "msgpack", None)  # as where it is not installed
    for name in [name for name in sys.modules if name.startswith("can.interfaces.udp_multicast")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(HardwareError, match="msgpack") as caught:
        open_bus(BusSection(channel="239.74.163.2", interface="udp_multicast"))
    (fault,) = caught.value.faults
    assert "pip install 'python-can[multicast]'" in fault.next_step
    assert "plugged in" not in fault.next_step


def test_python_can_has_the_extras_that_are_named() -> None:
    known = importlib.metadata.metadata("python-can").get_all("Provides-Extra") or []
    assert {name.replace("_", "-") for name in _EXTRAS.values()} <= {name.replace("_", "-") for name in known}


def test_an_interface_without_its_driver_is_no_traceback() -> None:
    """python-can's kvaser without its library fails with a NameError; where the library is, no channel 900 is."""
    with pytest.raises(HardwareError, match="kvaser interface cannot be opened"):
        open_bus(BusSection(channel="900", interface="kvaser"))


def test_an_adapter_that_is_not_there_is_to_be_plugged_in() -> None:
    with pytest.raises(HardwareError, match="socketcan interface cannot be opened") as caught:
        open_bus(BusSection(channel="nowhere0", interface="socketcan"))
    assert "plugged in" in caught.value.faults[0].next_step


@pytest.mark.parametrize("group", ["239.74.163.{}", "ff15::7079:7468:6f6e:6465:6d6f:{:x}"])
def test_a_multicast_bus_hears_its_own_group_only(group: str) -> None:
    """All of them share a port: without more, each would hear what any program of this machine has joined."""
    number = 1 + os.getpid() % 250
    with ExitStack() as stack:
        try:
            near, other, sender = (
                stack.enter_context(open_bus(BusSection(channel=group.format(n), interface="udp_multicast")))
                for n in (number, number + 1, number)
            )
            other.send(can.Message(arbitration_id=1))
            sender.send(can.Message(arbitration_id=2))
        except (HardwareError, can.CanError) as error:
            assert "msgpack" not in str(error)
            pytest.skip(f"no multicast here: {error}")
        heard = near.recv(5.0)
        assert heard is not None
        assert heard.arbitration_id == 2


def test_a_multicast_source_counts_what_it_lost() -> None:
    bus = BusSection(channel=f"239.74.164.{1 + os.getpid() % 250}", interface="udp_multicast")
    try:
        source, sender = PythonCanSource(bus, 4096), open_bus(bus)
    except HardwareError as error:
        pytest.skip(f"no multicast here: {error}")
    with closing(source), sender:
        if source.counters.dropped is None:
            pytest.skip("the system does not count")
        for number in range(200):
            sender.send(can.Message(arbitration_id=number))
        got = 0
        while count := len(source.read(0.2)):
            got += count
        lost = source.counters.dropped
        assert lost and got + lost == 200
        assert source.remarks == ()


def test_the_interface_is_let_go_of_once(monkeypatch: pytest.MonkeyPatch) -> None:
    source = PythonCanSource(BusSection(channel="let go", interface="virtual"))
    shutdown, count = source._bus.shutdown, itertools.count()
    monkeypatch.setattr(source._bus, "shutdown", lambda: (next(count), shutdown()))
    source.close()
    source.close()
    assert next(count) == 1


def test_what_came_before_a_failure_is_kept() -> None:
    source = PythonCanSource(BusSection(channel="failing", interface="virtual"))
    with closing(source), can.Bus("failing", interface="virtual") as sender:
        for number in range(3):
            sender.send(can.Message(arbitration_id=number))
        receive, left = source._bus.recv, iter(range(3))

        def fail_in_the_end(timeout: float | None = None) -> can.Message | None:
            if next(left, None) is None:
                raise OSError("unplugged")
            return receive(timeout)

        source._bus.recv = fail_in_the_end  # type: ignore[method-assign]
        assert source.read(0.1).frames["can_id"].tolist() == [0, 1, 2]
        with pytest.raises(HardwareError, match="unplugged"):
            source.read(0.1)
