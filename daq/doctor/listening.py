"""Listens to every bus for a while, as the logger would."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass

from daq.can_source import Source, SourceCounters
from daq.config import BusSection, LoggerSection
from daq.doctor.links import stamp_age_s
from daq.errors import ConfigError, Fault, HardwareError
from daq.frames import FrameBatch, concatenate
from daq.interfaces import open_source

_READ_S = 0.05


@dataclass(frozen=True)
class Heard:
    """What came from one bus.

    Attributes
    ----------
    section : BusSection
    frames : FrameBatch
    seconds : float
        How long it was listened to.
    counters : SourceCounters or None
        None where it could not be opened.
    fault : Fault or None
        Why it could not be opened, or what ended it.
    stamp_age_s : float or None
        See `daq.doctor.links.stamp_age_s`; None also where the interface is not SocketCAN's.
    """

    section: BusSection
    frames: FrameBatch
    seconds: float = 0.0
    counters: SourceCounters | None = None
    fault: Fault | None = None
    stamp_age_s: float | None = None

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return len(self.frames) / self.seconds if self.seconds else 0.0


def is_socketcan(section: BusSection) -> bool:
    """Whether a bus is one of the kernel's."""
    return section.interface in (None, "socketcan")


def listen(sections: Mapping[str, BusSection], logger: LoggerSection, seconds: float) -> dict[str, Heard]:
    """Listen to all buses at once, with the receive buffer that the logger would ask for."""
    heard: dict[str, Heard] = {}

    def run(name: str, section: BusSection) -> None:
        heard[name] = _listen(section, logger, seconds)

    threads = [threading.Thread(target=run, args=item, daemon=True) for item in sections.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return {name: heard[name] for name in sections}


def _listen(section: BusSection, logger: LoggerSection, seconds: float) -> Heard:
    nothing = FrameBatch.empty((section.channel,))
    try:
        source = open_source(section, logger.receive_buffer_bytes)
    except (ConfigError, HardwareError) as error:
        return Heard(section, nothing, fault=error.faults[0])
    started = time.monotonic()
    batches: list[FrameBatch] = [nothing]
    fault = None
    try:
        _read_until(source, started + seconds, batches)
    except HardwareError as error:
        fault = error.faults[0]
    elapsed_s = time.monotonic() - started
    counters = source.counters
    source.close()
    frames = concatenate(batches)
    age_s = stamp_age_s(section.channel, 1.0) if is_socketcan(section) and len(frames) else None
    return Heard(section, frames, elapsed_s, counters, fault, age_s)


def _read_until(source: Source, deadline: float, batches: list[FrameBatch]) -> None:
    while (left_s := deadline - time.monotonic()) > 0:
        batches.append(source.read(min(_READ_S, left_s)))
