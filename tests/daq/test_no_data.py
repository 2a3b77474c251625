"""Codes that a sender uses for no value: those that the DBC declares, and what it leaves open."""

from __future__ import annotations

import numpy as np
import pytest

from daq.can import NoData, load_database, no_data_of
from daq.runs import SignalTally

DBC = """VERSION ""
BU_: A
BO_ 300 Hub: 8 A
 SG_ Ranged : 0|16@1+ (0.01,0) [0|300] "km/h" A
 SG_ Open : 16|16@1+ (0.01,0) [0|655.35] "km/h" A
 SG_ Signed : 32|16@1- (2,0) [-65000|65000] "N" A
 SG_ Gear : 48|8@1+ (1,0) [0|0] "" A
 SG_ Short : 56|4@1+ (1,0) [0|5] "" A
 SG_ Valid : 60|1@1+ (1,0) [0|1] "" A
VAL_ 300 Ranged 65534 "Error" 0 "standstill" ;
VAL_ 300 Gear 0 "neutral" 1 "first" 254 "error" 255 "SNA" ;
VAL_ 300 Valid 0 "Invalid" 1 "Valid" ;
"""


def _none(signal: str) -> NoData:
    (message,) = load_database(DBC.encode(), "hub.dbc").messages
    return no_data_of(message, message.by_name[signal])


def test_declared_codes_and_extremes_outside_the_range_are_no_value() -> None:
    assert _none("Ranged").words == {65534 * 0.01: "Error", 65535 * 0.01: "extreme code outside the DBC's range"}
    assert sorted(_none("Signed").words) == [-65536.0, 65534.0]
    values = np.array([0.0, 1.0, 65534 * 0.01, 65535 * 0.01])
    assert _none("Ranged").is_value(values).tolist() == [True, True, False, False]


def test_all_bits_set_within_the_declared_range_stays_a_value_and_is_told() -> None:
    assert _none("Open") == NoData(all_bits_set=655.35)


def test_a_state_is_a_value_of_an_enumeration() -> None:
    assert _none("Gear").words == {255.0: "SNA"}
    assert _none("Valid") == NoData()
    assert _none("Short") == NoData()


def test_a_tally_counts_the_absent_by_their_reason() -> None:
    tally = SignalTally()
    none = {name: _none(name) for name in ("Ranged", "Open")}
    columns = {"Ranged": np.array([5.0, 655.34, 655.35, np.nan]), "Open": np.array([5.0, 6.0, 655.35, 655.35])}
    for _ in range(2):
        tally.take("can0", "Hub", np.arange(4) * 10**7, columns, dict.fromkeys(columns, "km/h"), none)
    ranged, still_open = tally.facts()[0].signals
    assert ranged.absent == {"Error": 2, "extreme code outside the DBC's range": 2}
    assert (ranged.least, ranged.most, ranged.share) == (5.0, 5.0, 0.25)
    assert (still_open.most, still_open.share, still_open.all_bits_set) == (655.35, 1.0, 4)


def test_a_force_at_its_extreme_code_is_not_measured() -> None:
    assert not _none("Signed").is_value(np.array([65534.0, -65536.0])).any()
    assert _none("Signed").is_value(np.array([65000.0, -2.0])).all()


@pytest.mark.parametrize("value", [0xFE00, 0xFFFF])
def test_the_top_of_a_j1939_range_has_a_reason(value: int) -> None:
    assert list(NoData(above=0xFE00 / 256).masks(np.array([value / 256]))) == ["error or not available (J1939)"]
