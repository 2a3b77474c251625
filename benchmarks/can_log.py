"""The test logs: a wheel force transducer, wheel speeds, GNSS and a multiplexed message on one bus."""

from __future__ import annotations

import numpy as np

from daq.can import (
    CLASSIC_DTYPE,
    Database,
    FrameArray,
    FrameBatch,
    Message,
    encode,
    load_database,
    merge,
    rolling_counter,
    shipped_dbc,
)

AUX_DBC = """VERSION ""

BS_:

BU_: Body Logger

BO_ 800 Aux: 8 Body
 SG_ Which M : 0|4@1+ (1,0) [0|3] "" Logger
 SG_ OilTemperature m0 : 8|16@1- (0.1,0) [-50|200] "degC" Logger
 SG_ OilPressure m0 : 24|16@1+ (0.01,0) [0|20] "bar" Logger
 SG_ FuelLevel m1 : 8|16@1+ (0.1,0) [0|100] "%" Logger
 SG_ Pitch m1 : 24|12@1- (0.01,0) [-20|20] "deg" Logger

BA_DEF_ BO_  "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_  "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 800 20;
"""
BUS = "can0"
START_NS = 1_700_000_000_000_000_000


def databases() -> list[Database]:
    """Return the three DBCs that ship, and one with the multiplexed message."""
    shipped = [load_database(shipped_dbc(name)) for name in ("wft.dbc", "wheel_speed.dbc", "gnss.dbc")]
    return [*shipped, load_database(AUX_DBC.encode(), "aux.dbc")]


def merged_dbc() -> str:
    """Return all of these databases as one DBC, as peers that open one at a time like it best."""
    import cantools.database

    merged = cantools.database.Database()
    for database in databases():
        merged.add_dbc_string(database.content.decode())
    return str(merged.as_dbc_string())


def test_log(seconds: float, known: list[Database]) -> FrameBatch:
    """Return every message of these databases at its cycle time: 3.21 kframes/s.

    Signals wander slowly over a tenth of their range with noise of a few bits, as measured ones do.
    """
    rng = np.random.default_rng(0)
    return merge([_frames(message, seconds, rng) for database in known for message in database.messages])


def wft_frames(count: int) -> FrameArray:
    """Return frames as a wheel force transducer sends them: three messages at 1 kHz, four 16-bit signals each."""
    rng = np.random.default_rng(0)
    number = np.arange(count)
    signals = 8000 * np.sin(number[:, None] * [1e-4, 2e-4, 3e-4, 5e-5]) + rng.normal(scale=20, size=(count, 4))
    frames = np.zeros(count, CLASSIC_DTYPE)
    frames["time_ns"] = START_NS + number // 3 * 1_000_000 + rng.integers(0, 90_000, count)
    frames["can_id"] = 0x100 + number % 3
    frames["length"] = 8
    frames["data"] = signals.astype("<i2").view(np.uint8)
    return frames


def _frames(message: Message, seconds: float, rng: np.random.Generator) -> FrameBatch:
    assert message.cycle_time_s is not None
    count = round(seconds / message.cycle_time_s)
    time_ns = START_NS + (np.arange(count) * message.cycle_time_s * 1e9).astype(np.int64) + message.can_id * 1000
    values = {}
    for signal in message.signals:
        low, high = signal.minimum or 0.0, signal.maximum or 0.0
        wave = np.sin(np.arange(count) * message.cycle_time_s * rng.uniform(0.1, 2.0))
        noise = rng.normal(scale=3 * abs(signal.scale), size=count)
        values[signal.name] = np.clip((low + high) / 2 + 0.05 * (high - low) * wave + noise, low, high)
        if signal.name == "Counter":
            values[signal.name] = rolling_counter(count, signal)
        elif signal.name == "Which":
            values[signal.name] = np.arange(count) % 2.0
    return encode(message, values, time_ns, BUS).frames
