"""Tables of series that are well formed and easily read wrong, each with what it means, for tests and for fuzzing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan

_STEPS = range(50)
_TIME_S = [i / 100 for i in _STEPS]
_FORCE = [100.5 + i for i in _STEPS]
_TORQUE = [-3.25 * i for i in _STEPS]


@dataclass(frozen=True)
class Case:
    """A table, and how it is to be read.

    Attributes
    ----------
    columns : mapping name -> values
        Empty where the table is refused.
    said : str
        In the remarks, or in the error.
    """

    name: str
    text: str
    columns: Mapping[str, list[float]] = field(default_factory=dict)
    said: str = ""
    time_s: list[float] = field(default_factory=lambda: list(_TIME_S))
    layout: Mapping[str, object] = field(default_factory=dict)
    refused: bool = False
    signals: Mapping[str, object] = field(default_factory=dict)
    """Where the roles are needed to judge a table."""


def table(header: str, *columns: list[object], sign: str = ",") -> str:
    """Return a table of texts."""
    return header + "\n" + "".join(sign.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


def _whole() -> list[str]:
    return table("time [s],Fz [N],T [Nm]", list(_TIME_S), list(_FORCE), list(_TORQUE)).splitlines(keepends=True)


def _dates(form: str) -> list[object]:
    return [form.format(day=1 + i // 2, second=i) for i in _STEPS]


def _days(step: int = 2) -> list[float]:
    return [86_400.0 * (i // step) + i for i in _STEPS]


_HEAD, *_ROWS = _whole()
_BOTH = {"Fz [N]": _FORCE, "T [Nm]": _TORQUE}
_SWAPPED = table("", list(_TIME_S), list(_TORQUE), list(_FORCE)).splitlines(keepends=True)[1:]
_LOADS = [900 + 10 * i for i in _STEPS]
_POINTS = [f"{load // 1000}.{load % 1000:03d}" if load > 999 else str(load) for load in _LOADS]
_LARGE = [4000 + 10 * i for i in _STEPS]
_CLOCK = [f"2024-05-17T10:00:{i:02d}Z" for i in _STEPS]
_SECONDS = [float(i) for i in _STEPS]
_FZ = {"Fz [N]": [float(load) for load in _LOADS]}
_LARGE_FZ = {"Fz [N]": [float(load) for load in _LARGE]}

CASES = (
    Case(
        "decimal commas in one column among points",
        table(
            "time [s];Fz [N];T [Nm];v [m/s]",
            list(_TIME_S),
            list(_FORCE),
            [f"{torque:.2f}".replace(".", ",") for torque in _TORQUE],
            [1.5] * 50,
            sign=";",
        ),
        _BOTH | {"v [m/s]": [1.5] * 50},
        "'T [Nm]' has decimal commas, because of",
    ),
    Case(
        "decimal points, and commas between thousands, in one column",
        table(
            "time [s];Fz [N]",
            list(_STEPS),
            [f"{900 + i}.5" for i in range(25)] + [f"1,{i:03d}" for i in range(25)],
            sign=";",
        ),
        {"Fz [N]": [900.5 + i for i in range(25)] + [1000.0 + i for i in range(25)]},
        "read as parting thousands",
        _SECONDS,
    ),
    Case(
        "rows of another width first",
        _HEAD + "".join(row.replace("\n", ",7\n") for row in _ROWS[:20]) + "".join(_ROWS[20:]),
        {name: values[20:] for name, values in _BOTH.items()},
        "rows unreadable, excluded: 20; the first is line 2",
        _TIME_S[:30],
    ),
    Case(
        "header that exchanges columns",
        _HEAD + "".join(_ROWS[:20]) + "time [s],T [Nm],Fz [N]\n" + "".join(_SWAPPED[20:]),
        _BOTH,
        "columns in another order from line 22",
    ),
    Case(
        "another header",
        _HEAD + "".join(_ROWS[:20]) + "t,pressure,level\n" + "".join(_ROWS[20:]),
        {name: values[:20] for name, values in _BOTH.items()},
        "rows behind another header, excluded: 31",
        _TIME_S[:20],
    ),
    Case("header that is repeated", _HEAD + "".join(_ROWS[:20]) + _HEAD + "".join(_ROWS[20:]), _BOTH),
    Case("first row of words", _HEAD + "ERR,ERR,ERR\n" + "".join(_ROWS), _BOTH, "the first is line 2: 'ERR,ERR,ERR'"),
    Case("first row nearly of words", _HEAD + "ERR,ERR,0.5\n" + "".join(_ROWS), _BOTH, "the first is line 2"),
    Case(
        "quotation mark without its second",
        _HEAD + "".join(_ROWS[:20]) + '0.2,"1,2\n' + "".join(_ROWS[21:]),
        {name: [*values[:20], *values[21:]] for name, values in _BOTH.items()},
        "a quotation mark without its second",
        [*_TIME_S[:20], *_TIME_S[21:]],
    ),
    Case("fewer names than cells", "time [s],Fz [N]\n" + "".join(_ROWS), said="more cells", refused=True),
    Case("points part thousands", table("time;Fz [N]", _CLOCK, _POINTS, sign=";"), _FZ, "'Fz [N]' read as", _SECONDS),
    Case(
        "commas part thousands",
        table("time;Fz [N]", list(_TIME_S), [f"{load:,}" for load in _LARGE], sign=";"),
        _LARGE_FZ,
        "the commas of 'Fz [N]' read as parting thousands, because . is the decimal sign",
    ),
    Case(
        "quoted commas part thousands",
        table("time [s],Fz [N]", list(_TIME_S), [f'"{load:,}"' for load in _LOADS]),
        _FZ,
        "the commas of 'Fz [N]' read as parting thousands",
    ),
    Case(
        "points part thousands and commas decimals",
        table(
            "Zeit [s];Fz [N]",
            [f"{one:.2f}".replace(".", ",") for one in _TIME_S],
            [f"{load // 1000}.{load % 1000:03d},5" for load in _LARGE],
            sign=";",
        ),
        {"Fz [N]": [load + 0.5 for load in _LARGE]},
    ),
    Case(
        "apostrophes part thousands",
        table("time [s];Fz [N]", list(_TIME_S), [f"{load:,}".replace(",", "'") for load in _LARGE], sign=";"),
        _LARGE_FZ,
    ),
    Case(
        "commas of either kind",
        table("time;Fz [N]", _CLOCK, [f"{load:,}" for load in _LARGE], sign=";"),
        said='thousands = ","',
        refused=True,
    ),
    Case(
        "points before decimals and between thousands",
        table("time [s];Fz [N]", list(_TIME_S), ["1.234.567", "12.5"] * (len(_TIME_S) // 2), sign=";"),
        said="may part thousands or decimals",
        refused=True,
    ),
    Case(
        "commas of either kind, decided",
        table("time;Fz [N]", _CLOCK, [f"{load:,}" for load in _LARGE], sign=";"),
        _LARGE_FZ,
        time_s=_SECONDS,
        layout={"thousands": ","},
    ),
    Case(
        "decimal commas between commas",
        table("time [s],Fz [N]", [f"{i // 100},{i % 100:02d}" for i in _STEPS], [f"{100 + i},5" for i in _STEPS]),
        {"Fz [N]": _FORCE},
        "commas read as decimal ones",
    ),
    Case(
        "day first",
        table("time,Fz [N]", _dates("{day:02d}/04/2024 10:00:{second:02d}"), list(_FORCE)),
        {"Fz [N]": _FORCE},
        "read with the day first, because one has 25",
        _days(),
    ),
    Case(
        "month first",
        table("time,Fz [N]", _dates("04/{day:02d}/2024 10:00:{second:02d}"), list(_FORCE)),
        {"Fz [N]": _FORCE},
        "read with the month first, because one has 25",
        _days(),
    ),
    Case(
        "day or month first",
        table("time,Fz [N]", [f"03/04/2024 10:00:{i:02d}" for i in _STEPS], list(_FORCE)),
        said="time_format",
        refused=True,
    ),
    Case(
        "German dates with a month that is none",
        table("time,Fz [N]", [f"03.{12 + i // 25}.2024 10:00:{i:02d}" for i in _STEPS], list(_FORCE)),
        {"Fz [N]": _FORCE[:25]},
        "without a usable time, excluded: 25",
        _SECONDS[:25],
    ),
    Case(
        "row of units between two rows of names",
        table("Time,Fz\nms,kN\nt,load", [10 * i for i in _STEPS], list(_FORCE)),
        {"load": _FORCE},
    ),
    Case(
        "row of units above the names",
        table("ms,kN\nTime,Fz", [10 * i for i in _STEPS], list(_FORCE)),
        {"Fz": _FORCE},
    ),
    Case(
        "timedeltas of pandas",
        table("time,Fz [N]", [f"0 days 00:00:00.{10_000 * i:06d}" for i in _STEPS], list(_FORCE)),
        {"Fz [N]": _FORCE},
    ),
    Case(
        "milliseconds that do not say so",
        table("t,Fz [N]", [f"{10 * i}.{i % 7 + 1}" for i in _STEPS], list(_FORCE)),
        said="the unit of time is not stated",
        refused=True,
    ),
    Case(
        "days of a spreadsheet",
        table("t,Fz [N]", [f"{45000 + i / 8.64e6:.12f}" for i in _STEPS], list(_FORCE)),
        said="the unit of time is not stated",
        refused=True,
    ),
    Case(
        "seconds at 1 Hz that do not say so",
        table("t,Fz [N]", [f"{i}.{i % 7 + 1}" for i in _STEPS], list(_FORCE)),
        {"Fz [N]": _FORCE},
        "the time column states no unit: taken for s",
        [i + (i % 7 + 1) / 10 for i in _STEPS],
    ),
    *(
        Case(
            f"{unit} headed as seconds",
            table("t [s],Fz [N]", [10 * i * much for i in range(4000)], [4000 + i % 9 for i in range(4000)]),
            said=f'time_unit = "{unit}"',
            refused=True,
            signals={"vertical_load": "Fz [N]"},
        )
        for unit, much in (("ms", 1), ("us", 1000))
    ),
    Case("ts_ms", table("ts_ms,Fz [N]", [10 * i for i in _STEPS], list(_FORCE)), {"Fz [N]": _FORCE}),
    Case("rate beside a time", "".join(_whole()), said="times of its own", layout={"rate_hz": 50.0}, refused=True),
    Case(
        "cells without a number",
        _HEAD + "".join(_ROWS).replace("101.5", "over").replace("-13.0\n", "\n"),
        {
            "Fz [N]": [nan if value == 101.5 else value for value in _FORCE],
            "T [Nm]": [nan if value == -13.0 else value for value in _TORQUE],
        },
        "cells that hold no number: 1 in 'Fz [N]'",
    ),
)
