"""Roles -> signals: units, buses, signs, rim speed, and every fault at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import ROLES, Channel, ConfigError, Quantity, Use, VehicleConfig, find_unit, known_units
from daq.can import Database, SignalRef, load_database, resolve_roles, shipped_dbc

HUB = """VERSION ""
BU_: A
BO_ 300 Hub: 8 A
 SG_ Force_Z : 0|16@1- (0.01,0) [0|0] "{force}" A
 SG_ Rim : 16|16@1+ (0.01,0) [0|0] "{rim}" A
 SG_ Raw : 32|16@1+ (1,0) [0|0] "" A
 SG_ Odd : 48|16@1+ (1,0) [0|0] "furlong" A
VAL_ 300 Rim 65535 "Signal not available" 65534 "Error" 0 "standstill" ;
"""


def hub(force: str = "kN", rim: str = "km/h") -> Database:
    return load_database(HUB.format(force=force, rim=rim).encode(), "hub.dbc")


def vehicle(signals: dict[str, str], radius_m: float | None = 0.5) -> VehicleConfig:
    wheel: dict[str, Any] = {} if radius_m is None else {"wheel": {"radius_m": radius_m, "width_m": 0.3}}
    return VehicleConfig.model_validate({"signals": signals, **wheel})


def resolve(signals: dict[str, str], *, radius_m: float | None = 0.5, **units: str) -> dict[str, SignalRef]:
    return resolve_roles(vehicle(signals, radius_m), {"can0": [hub(**units)]}, list(signals))


def si(ref: SignalRef, *values: float) -> list[float]:
    channel = Channel(ref.name, ref.unit, np.arange(len(values)), np.array(values))
    converted = ref.to_si(channel)
    assert (converted.name, converted.unit) == (ref.role, ref.si_unit)
    return [float(value) for value in converted.values]


def test_a_force_in_kilonewton_and_with_its_sign_turned() -> None:
    assert si(resolve({"vertical_load": "Hub.Force_Z"})["vertical_load"], 8.5) == [8500.0]
    turned = resolve({"vertical_load": "-Hub.Force_Z"})["vertical_load"]
    assert si(turned, 8.5) == [-8500.0]
    assert turned.key == ("can0", "Hub.Force_Z")


def test_a_rim_speed_becomes_an_angular_speed_with_the_radius() -> None:
    ref = resolve({"wheel_speed": "Hub.Rim"})["wheel_speed"]
    assert si(ref, 36.0) == pytest.approx([10.0 / 0.5], rel=1e-15)
    assert ref.si_unit == "rad/s"
    with pytest.raises(ConfigError, match=r"rim speed(.|\n)*radius_m"):
        resolve({"wheel_speed": "Hub.Rim"}, radius_m=None)
    rpm = resolve({"wheel_speed": "Hub.Rim"}, radius_m=None, rim="1/min")["wheel_speed"]
    assert si(rpm, 30.0) == pytest.approx([math.pi], rel=1e-15)


def test_values_that_the_table_calls_no_data_are_nan() -> None:
    ref = resolve({"ground_speed": "Hub.Rim"})["ground_speed"]
    values = si(ref, 65535 * 0.01, 65534 * 0.01, 0.0, 3.6)
    assert np.isnan(values[:2]).all()
    assert values[2:] == pytest.approx([0.0, 1.0], rel=1e-15)


@pytest.mark.parametrize("label", ["Not available", "SNA", "n/a", "Signal_Error", "INVALID", "sensor fault", "Init"])
@pytest.mark.parametrize("other", ["standstill", "default", "No error", "no_fault", "infinite", "National", "full"])
def test_which_labels_mean_no_data(label: str, other: str) -> None:
    table = f'VAL_ 300 Force_Z 7 "{label}" 8 "{other}" ;\n'
    database = load_database((HUB.format(force="N", rim="km/h") + table).encode(), "hub.dbc")
    found = resolve_roles(vehicle({"vertical_load": "Hub.Force_Z"}), {"can0": [database]}, ["vertical_load"])
    assert tuple(found["vertical_load"].no_data.words) == (7 * 0.01,)


def test_the_top_of_a_j1939_signal_is_no_data() -> None:
    text = 'VERSION ""\nBU_: A\nBO_ 2566844926 CCVS1: 8 A\n SG_ V : 8|16@1+ (0.00390625,0) [0|0] "km/h" A\n'
    text += 'BA_DEF_ "ProtocolType" STRING ;\nBA_DEF_DEF_ "ProtocolType" "";\nBA_ "ProtocolType" "J1939";\n'
    ref = resolve_roles(
        vehicle({"ground_speed": "CCVS1.V"}), {"c": [load_database(text.encode(), "j.dbc")]}, ["ground_speed"]
    )["ground_speed"]
    assert np.isnan(si(ref, 0xFFFF / 256, 0xFE00 / 256)).all()
    assert si(ref, 0xFDFF / 256) == pytest.approx([0xFDFF / 256 / 3.6])


def test_every_fault_at_once_with_what_is_near() -> None:
    signals = {
        "vertical_load": "Hub.Force_X",
        "drawbar_pull": "Hub.Rim",
        "driving_torque": "Hub.Raw",
        "sinkage": "Hub.Odd",
        "course": "can7:Hub.Raw",
    }
    with pytest.raises(ConfigError) as error:
        resolve_roles(vehicle(signals), {"can0": [hub()]}, ["ground_speed"], ROLES)
    text = str(error.value)
    assert len(error.value.faults) == 6
    for part in (
        "'ground_speed' is needed",
        "nearest: Hub.Force_Z",
        "Hub.Rim on can0 measures speed ('km/h'), where force is needed",
        "Hub.Raw on can0 has no unit, where moment is needed",
        "unknown unit 'furlong'",
        "length: m, mm",
        "no [[bus]] has the channel 'can7'",
    ):
        assert part in text


def test_a_role_is_asked_for_only_when_needed() -> None:
    assert resolve_roles(vehicle({"sinkage": "No.Such"}), {"can0": [hub()]}, []) == {}
    found = resolve_roles(vehicle({"vertical_load": "Hub.Force_Z"}), {"can0": [hub()]}, [], ROLES)
    assert list(found) == ["vertical_load"]


@pytest.mark.parametrize(("name", "role", "shown"), [("FL", "brake", ""), ("", "sinkage", ""), ("FL", "sinkage", "FL")])
def test_a_fault_names_the_wheel_where_the_role_is_of_one(name: str, role: str, shown: str) -> None:
    wheel = {"id": name, "radius_m": 0.5, "width_m": 0.3} if name else {"radius_m": 0.5, "width_m": 0.3}
    with pytest.raises(ConfigError) as caught:
        resolve_roles(VehicleConfig.model_validate({"wheel": wheel}), {"can0": [hub()]}, [role])
    assert caught.value.faults[0].where == "vehicle.toml [signals]" + (f", wheel {shown}" if shown else "")


def test_a_signal_on_several_buses_needs_the_bus() -> None:
    databases = {"can0": [hub()], "can1": [hub()]}
    with pytest.raises(ConfigError, match=r'on several buses(.|\n)*"can0:Hub.Force_Z" or "can1:Hub.Force_Z"'):
        resolve_roles(vehicle({"vertical_load": "Hub.Force_Z"}), databases, ["vertical_load"])
    found = resolve_roles(vehicle({"vertical_load": "-can1:Hub.Force_Z"}), databases, ["vertical_load"])
    assert found["vertical_load"].bus == "can1"
    assert found["vertical_load"].si_factor == -1000.0


def test_the_shipped_files_serve_all_roles_but_sinkage_brake_and_slip() -> None:
    path = shipped_dbc("wft.dbc")
    from daq import load_toml
    from daq.can.databases import load_for_vehicle

    config = load_toml(path.with_name("vehicle.toml"), VehicleConfig)
    served = [
        role
        for role, channel in ROLES.items()
        if role not in ("sinkage", "brake", "slip") and channel.use is not Use.EXTRA
    ]
    found = resolve_roles(config, load_for_vehicle(config, path.parent), served)
    assert found["latitude"].si_factor == pytest.approx(math.pi / 180 / 60)
    assert tuple(found["wheel_speed"].no_data.words) == (32767 * 0.02,)
    assert found["ground_speed_valid"].no_data.words == {}


@pytest.mark.parametrize(
    ("text", "quantity", "symbol"),
    [
        ("°", Quantity.ANGLE, "deg"),
        ("Â°", Quantity.ANGLE, "deg"),
        ("\ufffd/s", Quantity.ANGULAR_SPEED, "deg/s"),
        ("º C", Quantity.TEMPERATURE, "degC"),
        ("Deg C", Quantity.TEMPERATURE, "degC"),
        ("kph", Quantity.SPEED, "km/h"),
        ("KM / H", Quantity.SPEED, "km/h"),
        ("Unit_KiloMeterPerHour", Quantity.SPEED, "km/h"),
        ("kn", Quantity.SPEED, "kt"),
        ("kN", Quantity.FORCE, "kN"),
        ("m*s^-1", Quantity.SPEED, "m/s"),
        ("N·m", Quantity.MOMENT, "Nm"),
        ("Unit_NewtoMeter", Quantity.MOMENT, "Nm"),
        ("lb-ft", Quantity.MOMENT, "lbf ft"),
        ("Unit_MinutInver", Quantity.ANGULAR_SPEED, "rpm"),
        ("U/min", Quantity.ANGULAR_SPEED, "rpm"),
        ("min", Quantity.ANGLE, "min"),
        ("min", Quantity.TIME, "min"),
        ("", Quantity.RATIO, "1"),
        ("-", Quantity.RATIO, "1"),
        ("Percent", Quantity.RATIO, "%"),
    ],
)
def test_spellings_of_units(text: str, quantity: Quantity, symbol: str) -> None:
    unit = find_unit(text, [quantity])
    assert unit is not None
    assert unit.symbol == symbol


@pytest.mark.parametrize("text", ["Hz", "1/s", "", "teeth", "m/s^2", "N", "°"])
def test_what_is_no_angular_speed(text: str) -> None:
    assert find_unit(text, [Quantity.ANGULAR_SPEED]) is None


@given(st.sampled_from(list(Quantity)), st.data())
def test_known_symbols_are_found_in_any_case(quantity: Quantity, data: st.DataObject) -> None:
    symbol = data.draw(st.sampled_from(known_units(quantity)))
    spelled = data.draw(st.sampled_from([symbol, symbol.upper(), symbol.lower(), f" {symbol} ", f"[{symbol}]"]))
    unit = find_unit(spelled, [quantity])
    assert unit is not None
    assert (unit.quantity, unit.symbol) == (quantity, symbol)


def test_si_symbols_have_factor_one() -> None:
    for quantity in Quantity:
        unit = find_unit(quantity.value, [quantity])
        assert unit is not None
        assert (unit.factor, unit.offset) == (1.0, 0.0)
    celsius = find_unit("degC", [Quantity.TEMPERATURE])
    fahrenheit = find_unit("°F", [Quantity.TEMPERATURE])
    assert celsius is not None and fahrenheit is not None
    assert 32 * fahrenheit.factor + fahrenheit.offset == pytest.approx(0 * celsius.factor + celsius.offset, abs=1e-9)
