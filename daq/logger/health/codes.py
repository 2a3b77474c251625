"""Every code of a reason: its level, what it means, what it mostly comes from and what to do."""

from __future__ import annotations

from typing import NamedTuple


class HealthCode(NamedTuple):
    """What is known of a code beforehand; ``{bus}`` in `next_step` is the bus of the reason."""

    level: str
    meaning: str
    mostly_from: str
    next_step: str


CODES = {
    "bus_down": HealthCode(
        "red, amber without a role",
        "the interface is down or gone",
        "`ip link set ... down`, a pulled adapter, a suspended USB port",
        "ip link set {bus} up; check the adapter and its cable: recording continues by itself when it is back",
    ),
    "bus_off": HealthCode(
        "red, amber without a role",
        "the controller has left the bus after too many errors",
        "a wrong bit rate, a short circuit, no termination",
        "check bit rate, wiring and termination; ip link set {bus} type can restart-ms 100",
    ),
    "bus_returned": HealthCode(
        "amber",
        "the bus came back in the last 60 s: frames of that time are not recorded",
        "a loose plug or adapter",
        "check the plug and the adapter of {bus}, and repeat the run if it fell into it",
    ),
    "bus_silent": HealthCode(
        "red, amber without a role",
        "no frame for 2 s, or none for 5 s since the start",
        "senders without power, an open plug, a wrong bit rate",
        "check power and plugs of the senders on {bus}, and its bit rate: ip -details link show {bus}",
    ),
    "bus_error_passive": HealthCode(
        "amber",
        "the controller is error passive: more than 127 errors",
        "wiring, termination, a wrong bit rate or sample point",
        "check wiring, termination (60 ohm between the lines) and the bit rate of {bus}",
    ),
    "bus_error_warning": HealthCode(
        "amber",
        "the controller warns: more than 95 errors",
        "wiring, termination, a wrong bit rate or sample point",
        "check wiring, termination (60 ohm between the lines) and the bit rate of {bus}",
    ),
    "bus_no_ack": HealthCode(
        "amber",
        "a frame sent from here got no acknowledgement",
        "no other node is on the bus",
        "check the plug of {bus}, and that another node is on and not listen-only",
    ),
    "bus_errors": HealthCode(
        "amber",
        "error frames in the last 10 s",
        "wiring, a node with another bit rate, interference",
        "check wiring, screen and termination of {bus}; take nodes off one by one",
    ),
    "controller_overflow": HealthCode(
        "red",
        "the controller overwrote frames before the driver fetched them, in the last 10 s",
        "a controller with few buffers, a busy machine",
        "use an adapter with deeper buffers; end other programs",
    ),
    "kernel_drops": HealthCode(
        "red for 10 s after the last, then amber",
        "the kernel lost frames that were not fetched in time",
        "a small receive buffer, a busy machine",
        "sudo sysctl net.core.rmem_max=8388608, or raise receive_buffer_kb in [logger]; end other programs",
    ),
    "queue_drops": HealthCode(
        "red for 10 s after the last, then amber",
        "the logger gave up frames, its queue was full",
        "a slow disk",
        "record to a faster disk, or raise queue_mb in [logger]",
    ),
    "unknown_frames": HealthCode(
        "amber",
        "more than 5 % of the frames of a bus are in none of its DBCs",
        "a DBC of another version, undescribed senders",
        "wheelsoil doctor vehicle.toml; give {bus} their DBC, or list it in [health] may_carry_unknown",
    ),
    "dbc_does_not_fit": HealthCode(
        "amber",
        "frames, but for 5 s since the start none of the DBCs' messages",
        "the DBC of another bus or vehicle, buses exchanged",
        "wheelsoil doctor vehicle.toml; check which DBC belongs to {bus}: the frames are recorded all the same",
    ),
    "source_stuck": HealthCode(
        "red",
        "the driver of an interface does not answer",
        "a hung adapter or driver",
        "take the adapter out and put it in again, or restart the logger",
    ),
    "message_missing": HealthCode(
        "red with a role, else amber",
        "a regular message missing for 1 s and five times its longest interval, or one with a role for 5 s since "
        "the start",
        "a sender without power, an open plug, a wrong DBC",
        "check the sender and its plug; if it may be silent, list it in [health] may_be_silent",
    ),
    "counter_jump": HealthCode(
        "red with a role, else amber",
        "by a rolling counter frames were lost in the last 10 s",
        "gateway, telemetry, kernel, an overloaded bus",
        "look for drops of the bus; else check telemetry and gateway of the sender",
    ),
    "counter_repeated": HealthCode(
        "red with a role, else amber",
        "a rolling counter unchanged in more than half of the frames of the last 10 s",
        "a frozen sender, a gateway with a timer of its own",
        "restart the sender",
    ),
    "frames_doubled": HealthCode(
        "amber",
        "3 or more frames in the last 10 s had the counter of the frame before",
        "a gateway or a second sender that repeats frames",
        "look for two senders of this identifier, and for a loop between buses",
    ),
    "frames_missing": HealthCode(
        "amber",
        "a message without counter lacks more than 2 % of its frames of the last 10 s",
        "a sender that pauses, a gateway, the kernel",
        "look for drops of the bus; else check the sender",
    ),
    "rate_changed": HealthCode(
        "amber",
        "another rate than learned for three blocks of 3 s",
        "a sender that was set up anew",
        "check the set-up of the sender",
    ),
    "role_unusable": HealthCode(
        "amber",
        "a role of vehicle.toml names no signal, or one with the wrong unit",
        "a mistyped name, another DBC",
        "correct [signals] in vehicle.toml",
    ),
    "health_name_unknown": HealthCode(
        "amber",
        "a name in [health] that no DBC or bus has",
        "a mistyped name, another DBC",
        "correct [health] in vehicle.toml",
    ),
    "signal_stuck": HealthCode(
        "amber",
        "a signal that used to change is the same for 1 s and four times longer than ever before (at a "
        "standstill: 10 s and twenty times)",
        "a frozen sensor, a broken wire",
        "check the sensor and its cable; if it may stay the same, list it in [health] may_be_constant",
    ),
    "signal_constant": HealthCode(
        "amber",
        "never changed, although the vehicle has moved for 10 s",
        "a sensor that is not connected or switched on",
        "check the sensor; if it may stay the same, list it in [health] may_be_constant",
    ),
    "signal_saturated": HealthCode(
        "red",
        "3 samples in a row at the end of what the bits hold",
        "overload, a broken bridge, a wrong measuring range",
        "check the measuring range of the sensor, its zero and its cable",
    ),
    "signal_out_of_range": HealthCode(
        "amber",
        "outside of the range that the DBC gives",
        "overload, a DBC whose range is wrong",
        "check the sensor; if the DBC is wrong, list the signal in [health] may_leave_range",
    ),
    "signal_not_available": HealthCode(
        "amber",
        "a special value says that there is none",
        "a sender that starts, a failed sensor",
        "wait until the sender is ready; then check its sensor",
    ),
    "transducer_status": HealthCode(
        "amber",
        "the status of the transducer is not 0",
        "warming up, overrange, telemetry lost, zeroing",
        "wait until the transducer is ready; for a fault see its manual",
    ),
    "wheel_speed_zero": HealthCode(
        "amber",
        "wheel speed exactly 0 for 1 s at a ground speed over 1 m/s",
        "a tooth sensor without signal, a locked wheel",
        "check the wheel speed sensor, unless the wheel is braked to a stop",
    ),
    "ground_speed_zero": HealthCode(
        "amber",
        "ground speed exactly 0 for 3 s at a rim speed over 1 m/s",
        "a receiver that holds its position, a lifted or spinning wheel",
        "check the receiver, unless the wheel is lifted or slips wholly",
    ),
    "gnss_no_fix": HealthCode(
        "red",
        "no valid fix for 1.5 s and five messages, none for 10 s since the start, or a position of 0, 0",
        "trees, a tunnel, the antenna or its cable",
        "check the antenna and the view of the sky; the run has no ground speed meanwhile",
    ),
    "gnss_clock_residual": HealthCode(
        "amber",
        "GNSS time jitters by more than 50 ms (one sigma)",
        "a receiver or gateway that delays, a busy bus",
        "look at the load of the bus and at the receiver's output rate",
    ),
    "gnss_clock_drift": HealthCode(
        "amber",
        "the host's clock drifts by more than 100 ppm against GNSS time",
        "a poor or overheated clock, a GNSS time that is not one",
        "check that gnss_time names the receiver's UTC; times between runs are fitted anyhow",
    ),
    "disk_low": HealthCode(
        "amber, red under 10 minutes",
        "the disk lasts for less than disk_warn_min of [logger]",
        "old recordings",
        "free the disk or record elsewhere: recording ends by itself at disk_reserve_mb",
    ),
    "disk_failed": HealthCode(
        "red",
        "the disk was full, or a write failed: recording has ended",
        "a full disk, a card with errors",
        "free or change the disk, and start the logger again; what was written before stays readable",
    ),
    "queue_filling": HealthCode(
        "amber, red over 75 %",
        "more than a quarter of the queue before the disk is full",
        "a disk that is too slow, a busy machine",
        "end other programs that write; record to a faster disk",
    ),
    "inspection_skipped": HealthCode(
        "amber",
        "frames of the last 10 s were recorded, but not decoded",
        "a busy machine",
        "end other programs; lower decoded_rate_hz in [logger]",
    ),
    "inspection_failed": HealthCode(
        "amber",
        "the inspection failed in the last 10 s; frames are recorded",
        "a fault in the program, a strange frame",
        "restart the logger when there is time, and report the text",
    ),
    "folder_closed": HealthCode(
        "amber",
        "no file can be made where the next part, run or time between runs begins",
        "changed owner or permissions",
        "let the logger's user write to the folder: no other run or part can begin there",
    ),
    "file_gone": HealthCode(
        "red",
        "the file was moved or removed in the last 60 s",
        "a cleared folder, a program that moves files",
        "look for the file, and repeat the run if it is gone; leave the folder alone while it is recorded into",
    ),
    "inspection_stuck": HealthCode(
        "red",
        "the inspection has taken more than 5 s: frames are recorded, the page is old",
        "a fault in the program, a slow machine",
        "restart the logger when there is time, and report it",
    ),
    "cpu_busy": HealthCode(
        "amber",
        "over 90 % of a processor core for 5 s",
        "a slow machine, too many identifiers",
        "lower decoded_rate_hz in [logger]; give buses only the DBCs they need",
    ),
    "clock_stepped": HealthCode(
        "amber",
        "the host's clock was set in the last 60 s; time in the file advances evenly",
        "NTP after a start without network",
        "let the clock settle before the logger is started: chronyc waitsync",
    ),
}
"""Code -> what is known of it; docs/health_codes.md is made of it."""
