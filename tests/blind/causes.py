"""What may be hidden.

A row with ``variant`` set uses a formula that the engine does not have; its family is still the right answer.
"""

from __future__ import annotations

from blind.outside_causes import OUTSIDE
from blind.sensor_causes import MEASUREMENT
from blind.soil_causes import PHYSICAL
from blind.tilts import TILTS

ALL = {hidden.key: hidden for hidden in (*PHYSICAL, *MEASUREMENT, *TILTS, *OUTSIDE)}
KNOWN = {key: hidden for key, hidden in ALL.items() if not hidden.outside and hidden not in TILTS}
"""Every form of the engine's library that a balanced simulation without further sensors can have, and the variants."""
FAMILIES = tuple(dict.fromkeys(hidden.family for hidden in KNOWN.values()))
RIVALS = (
    ("peak_at_rest", "peak_with_slip"),
    *((key,) for key, hidden in KNOWN.items() if not hidden.variant and hidden.family != "stress_peak_shift"),
)
"""What the engine may hold against the truth: each with every parameter it has."""
