"""Reason codes of the health monitor: what each means, where it comes from and what to do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Code:
    """A kind of trouble.

    Attributes
    ----------
    name : str
        Stable: programs and docs/health.md know it by this.
    meaning : str
        What was seen, with its threshold.
    cause : str
        What it mostly comes from.
    next_step : str
        What to do about it.
    """

    name: str
    meaning: str
    cause: str
    next_step: str


_ALL = (
    Code(
        "bus_down",
        "the interface is down or gone",
        "`ip link set ... down`, a pulled adapter, a suspended USB port",
        "ip link set {bus} up; check adapter and cable; the logger goes on by itself",
    ),
    Code(
        "bus_off",
        "the controller has left the bus after too many errors",
        "wrong bit rate, a short circuit, no termination",
        "check bit rate, wiring and termination; ip link set {bus} type can restart-ms 100",
    ),
    Code(
        "bus_silent",
        "no frame for 2 s on a bus that carried some, or for 5 s since the start",
        "sender without power, plug, wrong bit rate",
        "check power and plug of the senders on {bus}, and its bit rate",
    ),
    Code(
        "kernel_drops",
        "frames were lost in the kernel, because they were not fetched in time",
        "receive buffer too small, a busy machine",
        "raise receive_buffer_kb in [logger] and `sysctl net.core.rmem_max`; end other programs",
    ),
    Code(
        "queue_drops",
        "the logger gave up frames, because its queue was full",
        "a disk that is too slow",
        "record to a faster disk; raise queue_mb in [logger]",
    ),
    Code(
        "unknown_frames",
        "more than 5 % of the frames of a bus are in no DBC, or none is known after 5 s",
        "a DBC of another vehicle or version, or senders that nobody described",
        "wheelsoil doctor vehicle.toml; give [[bus]] {bus} the DBC of these identifiers",
    ),
    Code(
        "message_missing",
        "a message that came regularly does not come any more, or a role's has not come within 5 s",
        "sender without power, plug, a DBC that does not fit",
        "check the sender and its plug",
    ),
)

CODES: dict[str, Code] = {code.name: code for code in _ALL}
"""Every code by its name."""
