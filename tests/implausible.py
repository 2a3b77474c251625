"""The note of an implausible run, for what prints or grades it."""

from __future__ import annotations

from math import nan

from daq import Note, Severity
from processing import RunCode


def implausible(*mends: str, sound: float = 1e-6) -> Note:
    """Return the note of a run for which some mistakes are equally probable."""
    shares = tuple((1 - sound) / len(mends) for _ in mends)
    values = {
        "sound": sound,
        "mends": mends,
        "shares": shares,
        "slip": -0.72,
        "traction": 0.4,
        "pull": 0.3,
        "load_share": nan,
        "track": nan,
        "radius_m": 18.5,
        "signals": {"ground_speed": "GNSS.Speed", "driving_torque": "WFT.My", "drawbar_pull": "WFT.Fx"},
        "units": {"drawbar_pull": "kN"},
        "signs": {"drawbar_pull": -1},
    }
    return Note(RunCode.IMPLAUSIBLE, Severity.FAULT if sound < 1e-3 else Severity.DOUBT, values)
