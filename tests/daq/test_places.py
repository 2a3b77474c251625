"""Places and masses in vehicle.toml, angles in terrain.toml: what is wrong is refused with its key."""

from __future__ import annotations

import pytest

from daq import ConfigError, TerrainConfig, VehicleConfig, parse_toml

WHEEL = "[wheel]\nradius_m = 0.47\nwidth_m = 0.3\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[sensors.ground_speed]\nx_m = 1500\ny_m = 0", "sensors.ground_speed.x_m: 1500 m .* 1500 mm are 1.5 m"),
        ("[sensors.ground_speed]\nz_m = 40.0", r"sensors.ground_speed.z_m: 40 m is on no vehicle.* 30 m"),
        ("[sensors.ground_speed]\nz_m = nan", r"z_m: .*finite"),
        ("[sensors.ground_speed]\ny_m = 0.2", "x_m and y_m go together"),
        ("[sensors.wheel_speed]\nz_m = 0.2", "wheel_speed takes no z_m: only ground_speed"),
        (f"{WHEEL}y_m = 0.9", "wheel: x_m and y_m go together"),
        (f"{WHEEL}z_m = 0.9", r"unknown key 'wheel.z_m'"),
        (f"{WHEEL}axle = 2", r"wheel.axle = 2 needs the number of axles: add axles under \[vehicle\]"),
        (f"[vehicle]\naxles = 2\n{WHEEL}", "vehicle.axles = 2 needs the wheel's: add axle"),
        (f"[vehicle]\naxles = 2\n{WHEEL}axle = 3", "wheel.axle = 3 is not on a vehicle with vehicle.axles = 2"),
        (f"[vehicle]\naxles = 2\n{WHEEL}axle = 0", "wheel.axle: .*greater than or equal to 1"),
        ("[signals]\nyawrate = 'Imu.Yaw'", "yaw_rate"),
        (f"[vehicle]\nmass_kg = 3600\n{WHEEL}outboard_mass_kg = 75000", r"outboard_mass_kg.* 75000 g are 75 kg"),
        (f"[vehicle]\nmass_kg = 3.6\n{WHEEL}outboard_mass_kg = 75", r"of which it is a part.* 3.6 t are 3600 kg"),
    ],
)
def test_a_place_that_cannot_be_is_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_toml(text, VehicleConfig, "vehicle.toml")


SOIL = """[soil]
name = "field"
cohesion_kpa = 5
friction_angle_deg = {}
shear_modulus_m = 0.02
sinkage_exponent = 1
cohesive_modulus_kn = 1
frictional_modulus_kn = 500
"""


def test_a_friction_angle_in_radians_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"0.244 rad are 14.0 degrees: write friction_angle_deg = 14.0"):
        parse_toml(SOIL.format(0.244), TerrainConfig, "terrain.toml")
    for angle in (0, 1.5, 14, 59):
        assert parse_toml(SOIL.format(angle), TerrainConfig, "terrain.toml").soil.friction_angle_deg == angle


def test_without_a_place_the_settings_are_what_they_were() -> None:
    text = f"{WHEEL}[sensors.ground_speed]\nlatency_s = 0.1\n"
    dumped = parse_toml(text, VehicleConfig, "vehicle.toml").model_dump(mode="json")
    assert dumped["sensors"] == {"ground_speed": {"latency_s": 0.1, "sigma": None}}
    assert not {"x_m", "y_m", "axle"} & dumped["wheel"].keys()
    assert "axles" not in dumped["vehicle"]
    again = parse_toml(f"{text}x_m = 1.0\ny_m = -2.0\n", VehicleConfig, "vehicle.toml")
    assert again.model_dump(exclude_none=True)["sensors"]["ground_speed"] == {
        "latency_s": 0.1,
        "x_m": 1.0,
        "y_m": -2.0,
    }
