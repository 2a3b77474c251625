"""Values of vehicle.toml that a wrong unit makes impossible."""

from __future__ import annotations

import pytest

from daq import ConfigError, VehicleConfig
from daq.config import parse_toml


@pytest.mark.parametrize(
    ("radius", "said", "unsaid"),
    [
        (470.0, "470 mm are 0.47 m", "inches"),
        (18.5, "18.5 inches are 0.4699 m", "mm"),
        (60.0, "60 mm are 0.06 m", "none"),
    ],
)
def test_a_radius_in_mm_or_inches_is_told_from_metres(radius: float, said: str, unsaid: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_toml(f"[wheel]\nradius_m = {radius}\nwidth_m = 0.3\n", VehicleConfig, "vehicle.toml")
    assert said in str(caught.value)
    assert unsaid not in str(caught.value)
