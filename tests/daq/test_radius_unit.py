"""Values of vehicle.toml that a wrong unit makes impossible."""

from __future__ import annotations

import pytest

from daq import ConfigError, VehicleConfig, parse_toml


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


@pytest.mark.parametrize(
    ("latency_s", "sound"), [(0.07, True), (-0.02, True), (5.0, True), (70.0, False), (-70, False)]
)
def test_a_latency_in_ms_is_refused(latency_s: float, sound: bool) -> None:
    text = f"[sensors.ground_speed]\nlatency_s = {latency_s}\n"
    if sound:
        assert parse_toml(text, VehicleConfig, "vehicle.toml").latency_s("ground_speed") == latency_s
        return
    with pytest.raises(ConfigError, match="latency_s"):
        parse_toml(text, VehicleConfig, "vehicle.toml")


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ("outboard_mass_kg = 75\noutboard_inertia_kgm2 = 8", ""),
        ("outboard_inertia_kgm2 = 8", ""),
        ("outboard_mass_kg = 75000", "75000 g are 75 kg"),
        ("outboard_mass_kg = 75\noutboard_inertia_kgm2 = 80000", "80000 kg cm2 are 8 kg m2"),
        ("outboard_mass_kg = 75\noutboard_inertia_kgm2 = 20", "of all the mass at the tread"),
        ("outboard_inertia_kgm2 = 8000", "of all the mass at the tread"),
    ],
)
def test_outboard_parts_are_no_heavier_than_steel(parts: str, said: str) -> None:
    """Whether mass_kg is there or not."""
    text = f"[wheel]\nradius_m = 0.47\nwidth_m = 0.318\n{parts}\n"
    if not said:
        assert parse_toml(text, VehicleConfig, "vehicle.toml").wheel is not None
        return
    with pytest.raises(ConfigError, match=said):
        parse_toml(text, VehicleConfig, "vehicle.toml")
