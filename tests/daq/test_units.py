"""Every factor and offset of the table of units against independent sources."""

from __future__ import annotations

import pytest
from scipy import constants

from daq import Quantity, find_unit, known_units

NIST_SP_811: dict[Quantity, dict[str, float]] = {
    Quantity.FORCE: {
        "N": 1.0,
        "daN": 1.0e1,
        "kN": 1.0e3,
        "kgf": 9.80665,
        "lbf": 4.448222,
        "klbf": 4.448222e3,
    },
    Quantity.MOMENT: {
        "Nm": 1.0,
        "daNm": 1.0e1,
        "kNm": 1.0e3,
        "lbf ft": 1.355818,
        "lbf in": 1.129848e-1,
    },
    Quantity.SPEED: {
        "m/s": 1.0,
        "mm/s": 1.0e-3,
        "cm/s": 1.0e-2,
        "km/h": 2.777778e-1,
        "mph": 4.4704e-1,
        "kt": 5.144444e-1,
        "ft/s": 3.048e-1,
    },
    Quantity.ACCELERATION: {
        "m/s^2": 1.0,
        "mm/s^2": 1.0e-3,
        "g": 9.80665,
        "mg": 9.80665e-3,
        "ft/s^2": 3.048e-1,
    },
    Quantity.ANGULAR_SPEED: {
        "rad/s": 1.0,
        "deg/s": 1.745329e-2,
        "rpm": 1.047198e-1,
        "rev/s": 6.283185,
    },
    Quantity.ANGLE: {
        "rad": 1.0,
        "mrad": 1.0e-3,
        "deg": 1.745329e-2,
        "min": 2.908882e-4,
        "arcsec": 4.848137e-6,
        "rev": 6.283185,
    },
    Quantity.LENGTH: {
        "m": 1.0,
        "mm": 1.0e-3,
        "cm": 1.0e-2,
        "um": 1.0e-6,
        "km": 1.0e3,
        "in": 2.54e-2,
        "ft": 3.048e-1,
    },
    Quantity.TIME: {
        "s": 1.0,
        "ms": 1.0e-3,
        "us": 1.0e-6,
        "ns": 1.0e-9,
        "min": 6.0e1,
        "h": 3.6e3,
    },
    Quantity.PRESSURE: {"Pa": 1.0, "hPa": 1.0e2, "kPa": 1.0e3, "bar": 1.0e5, "psi": 6.894757e3},
    Quantity.TEMPERATURE: {"K": 1.0, "degC": 1.0, "degF": 5.555556e-1},
    Quantity.RATIO: {"1": 1.0, "%": 1.0e-2, "permille": 1.0e-3},
}
"""Thompson & Taylor (2008), NIST Special Publication 811, appendix B.8 and prefixes of Table 5, to seven digits."""

EXACT: dict[tuple[Quantity, str], float] = {
    (Quantity.FORCE, "kgf"): constants.kgf,
    (Quantity.FORCE, "lbf"): constants.lbf,
    (Quantity.FORCE, "klbf"): constants.lbf * constants.kilo,
    (Quantity.MOMENT, "lbf ft"): constants.lbf * constants.foot,
    (Quantity.MOMENT, "lbf in"): constants.lbf * constants.inch,
    (Quantity.SPEED, "km/h"): constants.kmh,
    (Quantity.SPEED, "mph"): constants.mph,
    (Quantity.SPEED, "kt"): constants.knot,
    (Quantity.SPEED, "ft/s"): constants.foot,
    (Quantity.ACCELERATION, "g"): constants.g,
    (Quantity.ACCELERATION, "ft/s^2"): constants.foot,
    (Quantity.ANGLE, "deg"): constants.degree,
    (Quantity.ANGLE, "min"): constants.arcminute,
    (Quantity.ANGLE, "arcsec"): constants.arcsecond,
    (Quantity.LENGTH, "in"): constants.inch,
    (Quantity.LENGTH, "ft"): constants.foot,
    (Quantity.PRESSURE, "bar"): constants.bar,
    (Quantity.PRESSURE, "psi"): constants.psi,
    (Quantity.TIME, "min"): constants.minute,
    (Quantity.TIME, "h"): constants.hour,
}
"""CODATA and the international yard and pound, as scipy has them."""


@pytest.mark.parametrize("quantity", Quantity)
def test_every_factor_is_that_of_nist_sp_811(quantity: Quantity) -> None:
    assert set(known_units(quantity)) == set(NIST_SP_811[quantity])
    for symbol, factor in NIST_SP_811[quantity].items():
        unit = find_unit(symbol, [quantity])
        assert unit is not None
        assert unit.factor == pytest.approx(factor, rel=5e-7), symbol


@pytest.mark.parametrize(("quantity", "symbol"), EXACT)
def test_factors_that_are_defined_are_exact(quantity: Quantity, symbol: str) -> None:
    unit = find_unit(symbol, [quantity])
    assert unit is not None
    assert unit.factor == pytest.approx(EXACT[quantity, symbol], rel=1e-14)


@pytest.mark.parametrize(
    ("symbol", "reading", "kelvin"),
    [
        ("K", 300.0, 300.0),
        ("degC", 0.01, 273.16),  # triple point of water
        ("degC", -273.15, 0.0),
        ("degF", 32.0, 273.15),
        ("degF", 212.0, 373.15),
        ("degF", -459.67, 0.0),
        ("degF", -40.0, 233.15),
    ],
)
def test_temperatures_by_fixed_points(symbol: str, reading: float, kelvin: float) -> None:
    unit = find_unit(symbol, [Quantity.TEMPERATURE])
    assert unit is not None
    assert reading * unit.factor + unit.offset == pytest.approx(kelvin, abs=1e-9)


def test_only_temperatures_have_an_offset() -> None:
    for quantity in set(Quantity) - {Quantity.TEMPERATURE}:
        for symbol in known_units(quantity):
            unit = find_unit(symbol, [quantity])
            assert unit is not None
            assert unit.offset == 0.0, symbol
