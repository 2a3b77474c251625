"""Reason codes: what each means, what it mostly comes from and what to do; docs/health.md has the same table.

``{bus}`` in a next step stands for the bus of the reason.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Code:
    """A kind of trouble.

    Attributes
    ----------
    name : str
        Stable: programs know it by this.
    levels : str
        Which it can have, and when.
    meaning : str
        What was observed, with its threshold.
    cause : str
        What it mostly comes from.
    next_step : str
        What to do about it.
    """

    name: str
    levels: str
    meaning: str
    cause: str
    next_step: str


_BUSES = (
    Code(
        "bus_down",
        "red, amber without a role",
        "the interface is down or gone",
        "`ip link set ... down`, a pulled adapter, a suspended USB port",
        "ip link set {bus} up; check the adapter and its cable: recording continues by itself when it is back",
    ),
    Code(
        "bus_off",
        "red, amber without a role",
        "the controller has left the bus after too many errors",
        "a wrong bit rate, a short circuit, no termination",
        "check bit rate, wiring and termination; ip link set {bus} type can restart-ms 100",
    ),
    Code(
        "bus_returned",
        "amber",
        "the bus was lost and came back in the last 60 s: frames of that time are not recorded",
        "a loose plug or adapter",
        "check the plug and the adapter of {bus}, and repeat the run if it fell into it",
    ),
    Code(
        "bus_silent",
        "red, amber without a role",
        "no frame for 2 s, or none for 5 s since the start",
        "senders without power, an open plug, a wrong bit rate",
        "check power and plugs of the senders on {bus}, and its bit rate: ip -details link show {bus}",
    ),
    Code(
        "bus_error_passive",
        "amber",
        "the controller is error passive: more than 127 errors",
        "wiring, termination, a wrong bit rate or sample point",
        "check wiring, termination (60 ohm between the lines) and the bit rate of {bus}",
    ),
    Code(
        "bus_error_warning",
        "amber",
        "the controller warns: more than 95 errors",
        "wiring, termination, a wrong bit rate or sample point",
        "check wiring, termination (60 ohm between the lines) and the bit rate of {bus}",
    ),
    Code(
        "bus_no_ack",
        "amber",
        "a frame that was sent from here got no acknowledgement",
        "no other node is on the bus",
        "check the plug of {bus}, and that another node is on and not listen-only",
    ),
    Code(
        "bus_errors",
        "amber",
        "error frames in the last 10 s",
        "wiring, a node with another bit rate, interference",
        "check wiring, screen and termination of {bus}; take nodes off one by one",
    ),
    Code(
        "controller_overflow",
        "red",
        "the controller overwrote frames before the driver fetched them, in the last 10 s",
        "a controller with few buffers, a busy machine",
        "use an adapter with deeper buffers; end other programs",
    ),
    Code(
        "kernel_drops",
        "red for 10 s after the last, then amber",
        "the kernel lost frames, because they were not fetched in time",
        "a receive buffer that is too small, a busy machine",
        "sudo sysctl net.core.rmem_max=8388608, or raise receive_buffer_kb in [logger]; end other programs",
    ),
    Code(
        "queue_drops",
        "red for 10 s after the last, then amber",
        "the logger gave up frames, because its queue was full",
        "a disk that is too slow",
        "record to a faster disk, or raise queue_mb in [logger]",
    ),
    Code(
        "unknown_frames",
        "amber",
        "more than 5 % of the frames of a bus are in none of its DBCs",
        "a DBC of another version, undescribed senders",
        "wheelsoil doctor vehicle.toml; give {bus} their DBC, or list it in [health] may_carry_unknown",
    ),
    Code(
        "dbc_does_not_fit",
        "amber",
        "a bus carries frames, but for 5 s since the start none of its DBCs' messages",
        "the DBC of another bus or vehicle, buses exchanged",
        "wheelsoil doctor vehicle.toml; check which DBC belongs to {bus}: the frames are recorded all the same",
    ),
    Code(
        "source_stuck",
        "red",
        "the driver of an interface does not answer",
        "a hung adapter or driver",
        "take the adapter out and put it in again, or restart the logger",
    ),
)
_MESSAGES = (
    Code(
        "message_missing",
        "red with a role, else amber",
        "a regular message has not come for 1 s and five times its longest interval, or one with a role for 5 s "
        "since the start",
        "a sender without power, an open plug, a DBC that does not fit",
        "check the sender and its plug; if it may be silent, list it in [health] may_be_silent",
    ),
    Code(
        "counter_jump",
        "red with a role, else amber",
        "a rolling counter says that frames were lost in the last 10 s",
        "frames lost in a gateway, in telemetry, in the kernel or on an overloaded bus",
        "look for drops of the bus; else check telemetry and gateway of the sender",
    ),
    Code(
        "counter_repeated",
        "red with a role, else amber",
        "a rolling counter stood still in more than half of the frames of the last 10 s",
        "a frozen sender that repeats its last frame, a gateway that sends on a timer of its own",
        "restart the sender",
    ),
    Code(
        "frames_doubled",
        "amber",
        "3 or more frames in the last 10 s had the counter of the frame before",
        "a gateway or a second sender that repeats frames",
        "look for two senders of this identifier, and for a loop between buses",
    ),
    Code(
        "frames_missing",
        "amber",
        "by its usual rate a message without counter lacks more than 2 % of the frames of the last 10 s",
        "a sender that pauses, frames lost in a gateway or in the kernel",
        "look for drops of the bus; else check the sender",
    ),
    Code(
        "rate_changed",
        "amber",
        "a message has come at another rate than learned for three blocks of 3 s, in the last 10 s",
        "a sender that was set up anew, or changed its mode",
        "check the set-up of the sender",
    ),
)
_SIGNALS = (
    Code(
        "role_unusable",
        "amber",
        "a role of vehicle.toml names no signal, or one with the wrong unit",
        "a mistyped name, another DBC",
        "correct [signals] in vehicle.toml",
    ),
    Code(
        "health_name_unknown",
        "amber",
        "a name in [health] of vehicle.toml that no DBC or bus has, so that it excuses nothing",
        "a mistyped name, another DBC",
        "correct [health] in vehicle.toml",
    ),
    Code(
        "signal_stuck",
        "amber",
        "a signal that used to change has been the same for 1 s and four times longer than ever before "
        "(at a standstill: 10 s and twenty times)",
        "a frozen sensor behind a bus node that still sends, a broken wire",
        "check the sensor and its cable; if it may stay the same, list it in [health] may_be_constant",
    ),
    Code(
        "signal_constant",
        "amber",
        "a signal has never changed, although the vehicle has moved for 10 s",
        "a sensor that is not connected or not switched on",
        "check the sensor; if it may stay the same, list it in [health] may_be_constant",
    ),
    Code(
        "signal_saturated",
        "red",
        "3 samples in a row at the end of what the bits hold",
        "overload, a broken bridge, a wrong measuring range",
        "check the measuring range of the sensor, its zero and its cable",
    ),
    Code(
        "signal_out_of_range",
        "amber",
        "outside of the range that the DBC gives",
        "overload, a DBC whose range is wrong",
        "check the sensor; if the DBC is wrong, list the signal in [health] may_leave_range",
    ),
    Code(
        "signal_not_available",
        "amber",
        "the sender says by a special value that it has none",
        "a sender that starts, or whose sensor failed",
        "wait until the sender is ready; then check its sensor",
    ),
    Code(
        "transducer_status",
        "amber",
        "the status of the transducer is not 0",
        "warming up, overrange, telemetry lost, zeroing",
        "wait until the transducer is ready; for a fault see its manual",
    ),
    Code(
        "wheel_speed_zero",
        "amber",
        "the wheel speed is exactly 0 for 1 s while the ground speed is over 1 m/s",
        "a tooth sensor without signal, a locked wheel",
        "check the wheel speed sensor, unless the wheel is braked to a stop",
    ),
    Code(
        "ground_speed_zero",
        "amber",
        "the ground speed is exactly 0 for 3 s while the rim runs at over 1 m/s",
        "a receiver that holds its position, a wheel that is lifted or spins on the spot",
        "check the receiver, unless the wheel is lifted or slips wholly",
    ),
)
_GNSS = (
    Code(
        "gnss_no_fix",
        "red",
        "no valid fix for 1.5 s and five messages, none for 10 s since the start, or a position of 0, 0",
        "trees, a tunnel, the antenna or its cable",
        "check the antenna and the view of the sky; the run has no ground speed meanwhile",
    ),
    Code(
        "gnss_clock_residual",
        "amber",
        "GNSS time jitters by more than 50 ms (one sigma) against the host's clock",
        "a receiver or gateway that delays its messages, a busy bus",
        "look at the load of the bus and at the receiver's output rate",
    ),
    Code(
        "gnss_clock_drift",
        "amber",
        "the host's clock drifts by more than 100 ppm against GNSS time",
        "a poor or overheated clock, a GNSS time that is not one",
        "check that gnss_time names the receiver's UTC; times between runs are fitted anyhow",
    ),
)
_HOST = (
    Code(
        "disk_low",
        "amber, red under 10 minutes",
        "the disk lasts for less than disk_warn_min of [logger]",
        "old recordings",
        "free the disk or record elsewhere: recording ends by itself at disk_reserve_mb",
    ),
    Code(
        "queue_filling",
        "amber, red over 75 %",
        "more than a quarter of the queue before the disk is full",
        "a disk that is too slow, a busy machine",
        "end other programs that write; record to a faster disk",
    ),
    Code(
        "inspection_skipped",
        "amber",
        "frames of the last 10 s were recorded, but not decoded: they are in the file, the values on the page are not",
        "a busy machine",
        "end other programs; lower decoded_rate_hz in [logger]",
    ),
    Code(
        "inspection_failed",
        "amber",
        "the inspection of frames failed in the last 10 s; they are recorded all the same",
        "a fault in the program, a strange frame",
        "restart the logger when there is time, and report the text",
    ),
    Code(
        "file_gone",
        "red",
        "the file that is written was moved or removed in the last 60 s",
        "somebody who cleared the folder, a program that moves files away",
        "look for the file, and repeat the run if it is gone; leave the folder alone while it is recorded into",
    ),
    Code(
        "inspection_stuck",
        "red",
        "looking at frames has taken more than 5 s: they are recorded, but the values on the page are old",
        "a fault in the program, a machine that is much too slow",
        "restart the logger when there is time, and report it",
    ),
    Code(
        "cpu_busy",
        "amber",
        "the logger has taken more than 90 % of a processor core for 5 s",
        "a slow machine, too many identifiers",
        "lower decoded_rate_hz in [logger]; give buses only the DBCs they need",
    ),
    Code(
        "clock_stepped",
        "amber",
        "the host's clock was set in the last 60 s; time in the file advances evenly",
        "NTP after a start without network, somebody who set it",
        "let the clock settle before the logger is started: chronyc waitsync",
    ),
)

CODES: dict[str, Code] = {code.name: code for code in (*_BUSES, *_MESSAGES, *_SIGNALS, *_GNSS, *_HOST)}
"""Every code by its name, in the order of the table."""
