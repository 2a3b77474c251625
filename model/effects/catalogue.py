"""Every known effect: those that ship, and those of installed packages (docs/effects/README.md)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, get_args

from daq import CHANNELS, ConfigError, Fault
from model.effects.base import Abscissa, Effect, Needs, Parameter
from model.effects.contact_patch import (
    ExitAngle,
    ExitGrowth,
    Grouser,
    InterfaceFriction,
    ShearSoftening,
    StressPeakShift,
    TyreFlattening,
)
from model.effects.slip_sinkage import ClosedFormSinkage, Ding, Lyasko, SecondOrder, SkidSinkage, Vasilev
from model.effects.soil_stiffness import MultiPass, RateStiffness, TrackDrift
from model.effects.speed_errors import SpeedBias, SpeedLatency, WheelRadius
from model.effects.transducer import (
    BodyPitch,
    Crosstalk,
    DrawbarPullGain,
    DrawbarPullZero,
    LoadGain,
    LoadZero,
    TorqueGain,
    TorqueZero,
    ZeroDrift,
)
from model.effects.wheel_forces import Bulldozing, Slope, WheelInertia

PHYSICAL: tuple[type[Effect], ...] = (
    Vasilev,
    Lyasko,
    Ding,
    SecondOrder,
    SkidSinkage,
    StressPeakShift,
    InterfaceFriction,
    Bulldozing,
    ExitAngle,
    ExitGrowth,
    RateStiffness,
    MultiPass,
    TrackDrift,
    ShearSoftening,
    Grouser,
    TyreFlattening,
    Slope,
    WheelInertia,
    ClosedFormSinkage,
)
MEASUREMENT: tuple[type[Effect], ...] = (
    WheelRadius,
    SpeedLatency,
    SpeedBias,
    BodyPitch,
    DrawbarPullGain,
    TorqueGain,
    Crosstalk,
    LoadGain,
    DrawbarPullZero,
    TorqueZero,
    LoadZero,
    ZeroDrift,
)

GROUP = "wheelsoil.effects"
_SHOWN_IN = tuple(channel.role for channel in CHANNELS if channel.required)
"""Where an effect may show."""


_AT = "@"


def parted(key: str) -> tuple[str, str]:
    """Return an effect's or a family's name, and the wheel that it is of alone; "" where it is of all of them."""
    plain, _, wheel = key.partition(_AT)
    return plain, wheel


_AT_WHEELS: dict[tuple[str, str], type[Effect]] = {}


def at_wheel(effect: type[Effect], wheel: str) -> type[Effect]:
    """Return an effect that acts at one of several wheels alone: a family of its own, called ``family@wheel``.

    `KeyError` where it acts at all of them.
    """
    if not effect.goes_with_a_wheel():
        raise KeyError(effect.key())
    if (effect.key(), wheel) not in _AT_WHEELS:
        stated = {"name": f"{effect.name}{_AT}{wheel}", "__module__": __name__, "__doc__": effect.__doc__}
        _AT_WHEELS[effect.key(), wheel] = type(f"{effect.key()}{_AT}{wheel}", (effect,), stated)
    return _AT_WHEELS[effect.key(), wheel]


def __getattr__(name: str) -> type[Effect]:
    """Return an effect at one wheel by its key: how one process tells it to another."""
    plain, wheel = parted(name)
    if not wheel or plain not in EFFECTS:
        raise AttributeError(name)
    return at_wheel(EFFECTS[plain], wheel)


class Library(Mapping[str, type[Effect]]):
    """Effects by their short name: form where the family has several, else family.

    ``family@wheel`` is that of one of several wheels; these are not listed (`at_wheel`).
    Installed packages add theirs by entry points of the group ``wheelsoil.effects``. They are read when the first
    effect is asked for: a package that brings effects imports this one first.

    Parameters
    ----------
    own : tuple of Effect classes
        What is there without any other package; it comes first.

    Raises
    ------
    ConfigError
        On first use: lists every entry point that cannot be loaded, is no effect, lacks something, or takes a name
        that is taken.
    """

    def __init__(self, own: tuple[type[Effect], ...]) -> None:
        self._own = own

    def __getitem__(self, key: str) -> type[Effect]:
        plain, wheel = parted(key)
        return at_wheel(self._effects[plain], wheel) if wheel else self._effects[plain]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    @cached_property
    def _effects(self) -> dict[str, type[Effect]]:
        known = {effect.key(): effect for effect in self._own}
        owner = dict.fromkeys(known, "wheelsoil")
        faults: list[Fault] = []
        for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
            found, wrong = _loaded(entry)
            faults += wrong
            if found is None:
                continue
            key = found.key()
            if key in known:
                faults.append(_fault(entry, f"takes the name {key!r}", f"{owner[key]} has an effect of that name"))
            else:
                known[key], owner[key] = found, _package(entry)
        ConfigError.stop_if_any(faults)
        return known


def _loaded(entry: EntryPoint) -> tuple[type[Effect] | None, list[Fault]]:
    """Return the effect of an entry point, or what is wrong with it."""
    try:
        found = entry.load()
    except Exception as error:  # noqa: BLE001 - another package's file may fail in any way when it is imported
        return None, [_fault(entry, "cannot be loaded", f"{type(error).__name__}: {error}")]
    if not (isinstance(found, type) and issubclass(found, Effect)):
        return None, [_fault(entry, "is no effect", repr(found), "a subclass of model.effects.Effect")]
    wrong = [_fault(entry, *misfit) for misfit in _misfits(found)]
    return (None, wrong) if wrong else (found, [])


def _misfits(effect: type[Effect]) -> Iterable[tuple[str, str, str]]:
    """Yield what is wrong with an effect's statements: what, found, expected."""
    if not isinstance(effect.parameters, tuple) or not effect.parameters:
        yield "has no tuple of parameters", repr(effect.parameters), "(Parameter(...), ...)"
        return
    if not str(effect.key()).isidentifier():
        yield "has a name that cannot be typed", repr(effect.key()), "letters, digits and underscores"
    if effect.kind not in ("physical", "measurement"):
        yield "is of an unknown kind", repr(effect.kind), "physical or measurement"
    if not isinstance(effect.shows, tuple) or not effect.shows or not set(effect.shows) <= set(_SHOWN_IN):
        yield "shows where no channel is", repr(effect.shows), f"a tuple of {', '.join(_SHOWN_IN)}"
    if not isinstance(effect.needs, Needs):
        yield "does not say in the usual form what it needs", repr(effect.needs), "a model.effects.Needs"
    try:
        effect.error_sentence(above=True, channel="", size="", percent="")
    except (AttributeError, LookupError, TypeError, ValueError):
        expected = "a text with {channel}, {size}, {percent} or {word above/word below} at most"
        yield "has an error_text that cannot be written out", repr(effect.error_text), expected
    if effect.abscissa not in get_args(Abscissa):
        yield "has a figure over an unknown abscissa", repr(effect.abscissa), ", ".join(get_args(Abscissa)[1:])
    for p in effect.parameters:
        if not isinstance(p, Parameter):
            yield "has a parameter that is none", repr(p), "a model.effects.Parameter"
        elif not (p.lower <= p.neutral <= p.upper and p.lower <= p.start <= p.upper and p.prior_scale > 0):
            yield (
                f"has a parameter {p.name!r} that is out of order",
                _numbers(p),
                "lower <= neutral, start <= upper; scale > 0",
            )


def _numbers(p: Parameter) -> str:
    return f"lower {p.lower:g}, neutral {p.neutral:g}, start {p.start:g}, upper {p.upper:g}, scale {p.prior_scale:g}"


def _fault(entry: EntryPoint, what: str, found: Any, expected: str = "") -> Fault:
    package = _package(entry)
    return Fault(
        f"the effect {entry.name!r} of package {package!r} {what}",
        where=f"entry point {entry.name} = {entry.value}",
        found=str(found),
        expected=expected,
        next_step=f"mend {package}, or uninstall it",
    )


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else "unknown"


EFFECTS = Library((*PHYSICAL, *MEASUREMENT))
"""Every known effect: form where the family has several, else family."""
