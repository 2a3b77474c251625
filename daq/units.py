"""Unit strings of DBC files -> SI, per physical quantity.

Looked up within the quantity that is expected, so that ``kN`` is a force where a force is due and ``kn`` a knot
where a speed is; tolerant of case, spacing, spelling and of a degree sign lost to an encoding. Units with two meanings
(Hz and 1/s: turns, teeth or radians; lb and kg: mass or force) are unknown on purpose.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from functools import cache

from daq.errors import near_names

STANDARD_GRAVITY_MPS2 = 9.80665
EARTH_RADIUS_M = 6_371_008.8
"""Mean radius."""


class Quantity(Enum):
    """What a number measures; the value is its SI unit here."""

    FORCE = "N"
    MOMENT = "Nm"
    SPEED = "m/s"
    ACCELERATION = "m/s^2"
    ANGULAR_SPEED = "rad/s"
    ANGLE = "rad"
    LENGTH = "m"
    TIME = "s"
    PRESSURE = "Pa"
    TEMPERATURE = "K"
    RATIO = "1"

    @property
    def label(self) -> str:
        """The quantity as a word of a sentence."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class Unit:
    """SI value = number * factor + offset."""

    quantity: Quantity
    symbol: str
    factor: float
    offset: float = 0.0


def unit_text(unit: str) -> str:
    """Return one of our units as people write it: "N m" of "Nm"."""
    return "N m" if unit == Quantity.MOMENT.value else unit


@cache
def unit_suffix(unit: str) -> str:
    """Return one of our units as names end in it: "radps" of "rad/s"; a number without a dimension has none."""
    return "" if unit == Quantity.RATIO.value else unit.lower().replace("/", "p").replace("^", "")


_POUND_FORCE = 4.4482216152605
_FOOT = 0.3048
_DEGREE = math.pi / 180.0

_TABLE: dict[Quantity, dict[str, tuple[float, str]]] = {
    Quantity.FORCE: {
        "N": (1.0, "newton newtons"),
        "daN": (10.0, "decanewton"),
        "kN": (1e3, "kilonewton kilonewtons"),
        "kgf": (STANDARD_GRAVITY_MPS2, "kp kilopond"),
        "lbf": (_POUND_FORCE, "poundforce"),
        "klbf": (1e3 * _POUND_FORCE, "kip kips"),
    },
    Quantity.MOMENT: {
        "Nm": (1.0, "newtonmeter newtonmetre newtonmeters newtomete newtometer"),
        "daNm": (10.0, ""),
        "kNm": (1e3, "kilonewtonmeter kilonewtonmetre"),
        "lbf ft": (_POUND_FORCE * _FOOT, "lbft ftlb ftlbf"),
        "lbf in": (_POUND_FORCE * _FOOT / 12.0, "lbin inlb inlbf"),
    },
    Quantity.SPEED: {
        "m/s": (1.0, "m/sec mps ms1 meter/second meter/secon"),
        "mm/s": (1e-3, "mm/sec"),
        "cm/s": (1e-2, "cm/sec"),
        "km/h": (1.0 / 3.6, "kmh kph km/hr kmph kmh1 kilometer/hour kilometre/hour"),
        "mph": (0.44704, "mi/h mile/h miles/hour"),
        "kt": (1852.0 / 3600.0, "kts kn knot knots"),
        "ft/s": (_FOOT, "fps ft/sec"),
    },
    Quantity.ACCELERATION: {
        "m/s^2": (1.0, "m/s² m/s/s m/sec2 ms-2 mps2 meter/secondsquared meter/secon2"),
        "mm/s^2": (1e-3, "mm/s²"),
        "g": (STANDARD_GRAVITY_MPS2, "gn g0"),
        "mg": (1e-3 * STANDARD_GRAVITY_MPS2, ""),
        "ft/s^2": (_FOOT, "ft/s²"),
    },
    Quantity.ANGULAR_SPEED: {
        "rad/s": (1.0, "rad/sec rads1 radian/second radia/secon"),
        "deg/s": (_DEGREE, "deg/sec dps degs1 degree/s degrees/s degree/second degreofarc/secon"),
        "rpm": (2.0 * math.pi / 60.0, "1/min min1 /min r/min rev/min u/min upm minutinver"),
        "rev/s": (2.0 * math.pi, "r/s rps u/s"),
    },
    Quantity.ANGLE: {
        "rad": (1.0, "radian radians"),
        "mrad": (1e-3, ""),
        "deg": (_DEGREE, "degree degrees degreofarc"),
        "min": (_DEGREE / 60.0, "arcmin minute minutes minut arcminute arcminutes ' ′"),
        "arcsec": (_DEGREE / 3600.0, "arcsecond arcseconds ″"),
        "rev": (2.0 * math.pi, "turn revolution"),
    },
    Quantity.LENGTH: {
        "m": (1.0, "meter metre meters metres"),
        "mm": (1e-3, "millimeter millimetre millimeters"),
        "cm": (1e-2, "centimeter centimetre"),
        "um": (1e-6, "µm μm micrometer"),
        "km": (1e3, "kilometer kilometre"),
        "in": (_FOOT / 12.0, "inch inches"),
        "ft": (_FOOT, "foot feet"),
    },
    Quantity.TIME: {
        "s": (1.0, "sec second seconds secon"),
        "ms": (1e-3, "msec millisecond milliseconds millisecon"),
        "us": (1e-6, "µs μs microsecond microseconds"),
        "ns": (1e-9, "nanosecond"),
        "min": (60.0, "minute minutes minut"),
        "h": (3600.0, "hr hour hours"),
    },
    Quantity.PRESSURE: {
        "Pa": (1.0, "pascal pascals"),
        "hPa": (1e2, "hectopascal mbar millibar"),
        "kPa": (1e3, "kilopascal kilopascals"),
        "bar": (1e5, "bars"),
        "psi": (_POUND_FORCE / (_FOOT / 12.0) ** 2, "lbf/in2"),
    },
    Quantity.TEMPERATURE: {
        "K": (1.0, "kelvin degk"),
        "degC": (1.0, "c celsius degreec degreesc degrecelsi degcelsius"),
        "degF": (5.0 / 9.0, "f fahrenheit degreef degreesf"),
    },
    Quantity.RATIO: {
        "1": (1.0, "unitless none count counts bool boolean flag number binary on/off yes/no"),
        "%": (1e-2, "percent cent prozent"),
        "permille": (1e-3, "‰"),
    },
}
"""Factor to SI and further spellings of each symbol, by quantity; the SI unit first."""
_OFFSETS = {"degC": 273.15, "degF": 459.67 * 5.0 / 9.0}
_DEGREE_SIGNS = ("Â°", "°", "º", "˚", "\N{REPLACEMENT CHARACTER}")
_DROPPED = str.maketrans("", "", " \t_·⋅*×^.-[]()\N{NO-BREAK SPACE}")


def find_unit(text: str, quantities: Collection[Quantity]) -> Unit | None:
    """Return the unit that `text` means for one of `quantities`, None where it means none.

    An empty text is a dimensionless number: a `Quantity.RATIO`.
    """
    spelled = _normalized(text)
    for quantity in quantities:
        symbol = _spellings(quantity).get(spelled)
        if symbol is not None:
            return Unit(quantity, symbol, _TABLE[quantity][symbol][0], _OFFSETS.get(symbol, 0.0))
    return None


def known_units(quantity: Quantity) -> tuple[str, ...]:
    """Return the symbols known for a quantity, SI first."""
    return tuple(_TABLE[quantity])


def explain_unknown(text: str, quantities: Collection[Quantity]) -> tuple[str, str]:
    """Return what is wrong with a unit and what would be right, for a message."""
    wanted = " or ".join(quantity.label for quantity in quantities)
    known = "; ".join(f"{quantity.label}: {', '.join(known_units(quantity))}" for quantity in quantities)
    other = find_unit(text, [q for q in Quantity if q not in quantities and (text or q is not Quantity.RATIO)])
    if not text.strip():
        return f"has no unit, where {wanted} is needed", known
    if other is not None:
        return f"measures {other.quantity.label} ({text!r}), where {wanted} is needed", known
    close = near_names(_normalized(text), [name for q in quantities for name in _spellings(q)])
    hint = f" (nearest: {', '.join(close)})" if close else ""
    return f"has the unknown unit {text!r}{hint}", known


def _normalized(text: str) -> str:
    for sign in _DEGREE_SIGNS:
        text = text.replace(sign, "deg")
    spelling = text.strip().lower().removeprefix("unit_").translate(_DROPPED).replace("per", "/")
    return spelling or ("" if text.strip() in ("", "-") else text.strip())


@cache
def _spellings(quantity: Quantity) -> dict[str, str]:
    spellings = {"": "1"} if quantity is Quantity.RATIO else {}
    for symbol, (_, others) in _TABLE[quantity].items():
        spellings |= {_normalized(name): symbol for name in (symbol, *others.split())}
    return spellings
