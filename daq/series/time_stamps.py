"""Time columns of decoded series: which they are, in what unit, and their values as nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq import (
    TRANSDUCER_ROLES,
    BoolArray,
    Channel,
    ConfigError,
    DataError,
    Fault,
    FloatArray,
    IntArray,
    Quantity,
    SeriesSection,
    TimeUnitError,
    find_unit,
    nearest,
)
from daq.can.roles import plain_name, unit_behind
from daq.limits import EARLIEST_DATE_NS, LAST_TIME_NS
from daq.series.blocks import SeriesReport

if TYPE_CHECKING:
    import pandas as pd

_WORDS = "ts|time|times?[ _]?stamps?|timestampepoch|zeit|zeitstempel|date[ _]?time|utc|epoch|elapsed"
_SUFFIX = r"(?:_(?P<suffix>ns|us|ms|s|sec|min|h))?"
_EXACT = re.compile(rf"(?:t|(?i:{_WORDS}))(?:[ _](?i:utc|epoch|unix|rel|abs|relative|absolute))?[ _]?\d*{_SUFFIX}$")
_LOOSE = re.compile(rf"(?:t[ _].*|(?i:(?:.*[ _./])?(?:{_WORDS})(?:[ _].*)?)){_SUFFIX}$")
_EPOCH_UNITS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""A date after 1990 is above these in each unit, and below the one before it."""
_EPOCH_S = EARLIEST_DATE_NS / 1e9
_SHORTEST_STEP_S, _LONGEST_STEP_S = 1e-5, 1.5
"""Usual intervals of numbers that are seconds without saying so; others may be ms, minutes or days."""
_SLOWEST_STEP_S, _LONG_S, _USUAL_STEP_S, _OF_WHEEL = 2.0, 600.0, 0.01, (*TRANSDUCER_ROLES, "wheel_speed")
_SMALLER = ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)
_LAST_NS = float(LAST_TIME_NS)
_ZONE = re.compile(r"(?:Z|UTC|[+-]\d\d:?\d\d)\s*$")
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d")
_DAY_FIRST = re.compile(r"\d{1,2}\.\d{1,2}\.\d{4}[ T,]+\d")
_PARTED = re.compile(r"\d{1,2}([/-])\d{1,2}\1\d{4}[ T,]+\d")
_PARTS = r"^(\d{1,2})[./-](\d{1,2})[./-](\d{4})[ T,]+(\d.*)$"
_PASSED = re.compile(r"-?\d+ days?\b")
_CLOCK = re.compile(r"\d{1,2}:\d\d:\d\d(?:[.,]\d+)?$")
_TIME = re.compile("|".join(kind.pattern for kind in (_ISO, _DAY_FIRST, _PARTED, _CLOCK, _PASSED)))
_KINDS = "ISO 8601, DD.MM.YYYY hh:mm:ss, hh:mm:ss, 0 days hh:mm:ss, or [series] time_format"
_MONTHS = 12


def is_time_name(header: str) -> bool:
    """Return whether a column is called like a time column: ``t``, ``Time [s]``, ``timestamp_ms``, ``Zeit``, ..."""
    return bool(_EXACT.match(plain_name(header)))


def is_time_text(cell: str) -> bool:
    """Return whether a cell is a date or a time of the day."""
    return bool(_TIME.match(cell))


def time_columns(units: Mapping[str, str], dates: Sequence[str], layout: SeriesSection, source: str) -> dict[str, str]:
    """Return the time column of each other column: the last one before it, or else the first one after it.

    Of time columns side by side the first one counts. `units` is in the order of the file; a column with the unit of
    something else is no time. `dates` are those columns that hold dates or times of the day. The result is empty where
    the file has no time column and `layout` gives a rate.

    `DataError` where there is no time column or a named one is not there, `ConfigError` where `layout` gives a rate
    beside one.
    """
    columns = tuple(units)
    absent = [name for name in layout.times if name not in columns]
    if absent:
        faults = [
            Fault(
                f"no column is called {n!r}",
                "vehicle.toml [series] time",
                source,
                nearest(n, columns),
                "correct the name",
            )
            for n in absent
        ]
        raise DataError(*faults)
    possible = [name for name in columns if not units[name] or find_unit(units[name], (Quantity.TIME,))]
    times = list(layout.times)
    times = times or [name for name in columns if name in dates or (name in possible and is_time_name(name))]
    refuse_rate(layout, times[0] if times else "", source)
    if layout.rate_hz is not None:
        return {}
    times = times or [name for name in possible if _LOOSE.match(plain_name(name))]
    if not times:
        what = "no column looks like a time"
        found, expected = f"columns {', '.join(columns[:12])}", "a column like time, t or timestamp"
        step = (
            'name it in vehicle.toml: [series] time = "COLUMN", or give rate_hz; '
            "a table of single-wheel tests is for `wheelsoil fit --table`"
        )
        raise DataError.of(what, source, found, expected, step)
    chosen, latest, before = {}, times[0], ""
    for name in columns:
        if name not in times:
            chosen[name] = latest
        elif before not in times:
            latest = name
        before = name
    return chosen


def refuse_rate(layout: SeriesSection, time: str, source: str) -> None:
    """Raise ConfigError where `layout` gives a rate and the file has times of its own, called `time`."""
    if layout.rate_hz is not None and time:
        what = f"a rate is given, and the file has times of its own ({time})"
        step = "remove rate_hz from [series] of vehicle.toml, or the times from the file where they are wrong"
        raise ConfigError.of(what, source, f"rate_hz = {layout.rate_hz:g}", "one of both", step)


class TimeStamps:
    """Turns the cells of one time column into nanoseconds; the unit is settled by the first cells.

    `unit` is as the file or its header states it, empty where it does not.
    """

    def __init__(self, column: str, unit: str, layout: SeriesSection, report: SeriesReport) -> None:
        self._column, self._layout, self._report = column, layout, report
        self._unit = layout.time_unit or unit or unit_behind(column)
        self._factor_ns: float | None = None
        self._format = layout.time_format
        self._text_kind: str | None = None

    def of(self, cells: NDArray[Any]) -> tuple[IntArray, BoolArray]:
        """Return nanoseconds, and which of them are usable; DataError if cells like these are not understood."""
        if cells.dtype.kind in "Mm":
            time_ns = cells.astype(f"{cells.dtype.kind}8[ns]")
            usable = ~np.isnat(time_ns)
            return np.where(usable, time_ns.astype(np.int64), 0), usable
        if cells.dtype.kind in "iu" and cells.dtype.itemsize == 8:
            factor = self._factor(cells)
            whole = int(factor) if factor >= 1 and factor == int(factor) else 0
            if whole and (not len(cells) or np.abs(cells).max() < _LAST_NS / whole):
                return cells.astype(np.int64) * whole, np.ones(len(cells), np.bool_)
        if cells.dtype.kind in "fiub":
            values = cells.astype(np.float64, copy=False)
            with np.errstate(invalid="ignore", over="ignore"):
                usable = np.abs(values * self._factor(values)) < _LAST_NS
            return self._rounded(values if usable.all() else np.where(usable, values, 0.0)), usable
        return self._of_texts(cells)

    def _rounded(self, values: FloatArray) -> IntArray:
        """Scale seconds and their fraction apart: a date in float seconds has no more than 0.24 us as it is."""
        factor = self._factor_ns or 1.0
        whole = np.floor(values)
        time_ns: IntArray = whole.astype(np.int64) * int(factor) + np.rint((values - whole) * factor).astype(np.int64)
        if factor == 1e9 and len(values) and values[0] > _EPOCH_S:
            time_ns = (time_ns + 500) // 1000 * 1000
        return time_ns

    def _factor(self, cells: NDArray[Any]) -> float:
        """Return nanoseconds of one; settled once, from the unit stated or the size of the first stamps."""
        if self._factor_ns is None:
            text = self._unit
            match = _EXACT.match(plain_name(self._column)) or _LOOSE.match(plain_name(self._column))
            if not text and match:
                text = match["suffix"] or ""
            if not text:
                text = self._by_size(cells)
            unit = find_unit(text, (Quantity.TIME,))
            if unit is None:
                where = f"{self._report.path}, column {self._column!r}"
                raise DataError.of(
                    "the unit of time is not known",
                    where,
                    repr(text),
                    "s, ms, us, ns, min or h",
                    'write it behind the column: "time [s]"',
                )
            self._factor_ns = float(round(unit.factor * 1e9))
            self._report.stamp_s = unit.factor
        return self._factor_ns

    def _by_size(self, cells: NDArray[Any]) -> str:
        finite = cells[np.isfinite(cells)]
        first = abs(float(finite[0])) if len(finite) else 0.0
        if first >= _EPOCH_S:
            return next((unit for least, unit in _EPOCH_UNITS if first >= least), "s")
        steps_s = np.diff(np.unique(finite))  # stamps may repeat: of several rows, or rounded
        step_s = float(np.median(steps_s)) if len(steps_s) else 0.0
        if np.any(finite != np.floor(finite)) and _SHORTEST_STEP_S <= step_s <= _LONGEST_STEP_S:
            self._report.note_reading("the time column states no unit: taken for s ([series] time_unit sets it)")
            return "s"
        where = f"{self._report.path}, column {self._column!r}"
        found = ", ".join(f"{cell:g}" for cell in finite[:4])
        step = 'state it in vehicle.toml: [series] time_unit = "ms", or in the header: "time [ms]"'
        raise DataError.of("the unit of time is not stated", where, found, "s, ms, us or ns", step)

    def _of_texts(self, cells: NDArray[Any]) -> tuple[IntArray, BoolArray]:
        import pandas as pd

        texts = pd.Series(cells).fillna("").astype(str).str.strip()
        first = next((text for text in texts if text), "")
        if self._text_kind is None:
            self._text_kind = self._kind(first)
            if self._text_kind == "parted":
                self._text_kind = self._order_of_parts(texts)
        points = texts.str.replace(r",(\d{1,9})(?!\d)", r".\1", regex=True)
        if self._text_kind == "passed":
            passed = pd.to_timedelta(points, errors="coerce")
            usable = passed.notna().to_numpy()
            time_ns = passed.fillna(pd.Timedelta(0)).to_numpy("timedelta64[ns]").astype(np.int64)
        else:
            self._report.unzoned |= not _ZONE.search(first)
            dates = self._dates(texts if self._text_kind == "format" else points)
            usable = dates.notna().to_numpy()
            filled = dates.fillna(pd.Timestamp(0, tz="UTC")).dt.tz_convert(None)
            time_ns = filled.to_numpy("datetime64[ns]").astype(np.int64)
        return time_ns, usable

    def _dates(self, texts: pd.Series[str]) -> pd.Series[pd.Timestamp]:
        import pandas as pd

        if self._text_kind in ("day_first", "month_first"):
            parts = texts.str.extract(_PARTS)
            day, month = (parts[i].str.zfill(2) for i in ((0, 1) if self._text_kind == "day_first" else (1, 0)))
            whole = parts[2] + "-" + month + "-" + day + " " + parts[3]
            return pd.to_datetime(whole, errors="coerce", utc=True, format="ISO8601")
        form = self._format if self._text_kind == "format" else "ISO8601"
        return pd.to_datetime(texts, errors="coerce", utc=True, format=form)

    def _order_of_parts(self, texts: pd.Series[str]) -> str:
        """Return whether day or month comes first in dates that have both in numbers: where one is above 12."""
        parts = texts.str.extract(_PARTS).dropna()
        first, second = (int(parts[i].astype(int).max()) if len(parts) else 0 for i in (0, 1))
        if (first > _MONTHS) == (second > _MONTHS):
            where, found = f"{self._report.path}, column {self._column!r}", repr(next(text for text in texts if text))
            step = 'say which: vehicle.toml [series] time_format = "%d/%m/%Y %H:%M:%S.%f", or "%m/%d/%Y ..."'
            raise ConfigError.of("day or month may come first in the dates", where, found, "a number above 12", step)
        kind, largest = ("day_first", first) if first > _MONTHS else ("month_first", second)
        words = kind.replace("_", " ")
        self._report.note_reading(f"dates of {self._column!r} read with the {words}, because one has {largest} there")
        return kind

    def _kind(self, first: str) -> str:
        if self._format:
            return "format"
        kinds = (("iso", _ISO), ("day_first", _DAY_FIRST), ("parted", _PARTED), ("passed", _CLOCK), ("passed", _PASSED))
        for kind, pattern in kinds:
            if pattern.match(first):
                return kind
        where = f"{self._report.path}, column {self._column!r}"
        step = 'say how it is written: [series] time_format = "%d/%m/%Y %H:%M:%S.%f"'
        raise DataError.of("the time stamps are not understood", where, repr(first), _KINDS, step)


def unstretched(channels: dict[str, Channel], layout: SeriesSection, report: SeriesReport) -> dict[str, Channel]:
    """Return the channels; TimeUnitError where numbers make a wheel's slower than any logger: their unit is smaller.

    [series] of vehicle.toml decides where it states a unit.
    """
    for channel in channels.values() if report.stamp_s and not layout.time_unit else ():
        time_s = channel.time_ns[np.isfinite(channel.values)] / 1e9
        step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
        if channel.name in _OF_WHEEL and step_s > _SLOWEST_STEP_S and time_s[-1] - time_s[0] > _LONG_S:
            unit, _ = min(_SMALLER, key=lambda of: abs(np.log(step_s / report.stamp_s * of[1] / _USUAL_STEP_S)))
            raise TimeUnitError.of(
                "the unit of time seems to be another one",
                found=f"{channel.name} every {step_s:.4g} s for {(time_s[-1] - time_s[0]) / 3600:.3g} h",
                expected="0.5 Hz or more",
                next_step=f'write time_unit = "{unit}" under [series] of vehicle.toml; if it is right, state it there',
            )
    return channels


def at_rate(count: int, start_row: int, rate_hz: float) -> IntArray:
    """Return the time stamps of rows that have none, from a rate."""
    time_ns: IntArray = np.rint((start_row + np.arange(count)) * (1e9 / rate_hz)).astype(np.int64)
    return time_ns
