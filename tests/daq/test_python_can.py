"""Interfaces of python-can that cannot be opened: what is missing, and what to do."""

from __future__ import annotations

import importlib.metadata
import sys

import pytest

from daq.config import BusSection
from daq.errors import HardwareError
from daq.python_can import _EXTRAS, open_bus


def test_an_interface_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "msgpack", None)  # as where it is not installed
    monkeypatch.delitem(sys.modules, "can.interfaces.udp_multicast.utils", raising=False)
    monkeypatch.delitem(sys.modules, "can.interfaces.udp_multicast.bus", raising=False)
    monkeypatch.delitem(sys.modules, "can.interfaces.udp_multicast", raising=False)
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
