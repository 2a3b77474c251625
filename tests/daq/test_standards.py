"""Tables and rules of the standards, transcribed from them."""

from __future__ import annotations

import numpy as np
import pytest

from daq.can.frames import FD_LENGTHS
from daq.can.identify import parameter_groups


def test_the_lengths_of_a_can_fd_frame() -> None:
    """ISO 11898-1:2015, Table 5: data length codes 0 to 15."""
    assert FD_LENGTHS == (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


@pytest.mark.parametrize(
    ("can_id", "group"),
    [
        (0x18FEF100, 0xFEF1),  # CCVS1, 65265: broadcast, PDU2
        (0x0CF00400, 0xF004),  # EEC1, 61444: the lowest PDU2 format, 240
        (0x18EAFF00, 0xEA00),  # request, 59904: PDU1, sent to everybody
        (0x18EF1234, 0xEF00),  # proprietary A, 61184: the highest PDU1 format, 239, to address 0x12
        (0x0C000327, 0x0000),  # TSC1, 0: to address 3
        (0x19F80102, 0x1F801),  # data page 1
    ],
)
def test_parameter_groups_of_j1939(can_id: int, group: int) -> None:
    """SAE J1939-21, 5.1.2 and 5.2: below PDU format 240 the specific byte is a destination address."""
    assert parameter_groups(np.array([can_id], np.uint32)).tolist() == [group]
