"""Files that are well formed and easily read wrong, drawn by a seed, and what a reader makes of them.

A file of 200 rows is written in one of the ways in which programs write tables, and then something is done to it that
leaves a table. Reading it right, refusing it and losing rows by name are all good. Another number at a time, a time
that was not written, and fewer numbers without a word are what is counted.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq import WheelsoilError
from daq.logs import parse_columns, read_log
from daq.series import read_series

_ROWS = 200
_USUAL = ("times have no date", "dates have no time zone", "the time column states no unit", "rows are out of order")
_JUNE_S = np.datetime64("2024-05-31T10:00:00", "s").astype(float)
Texts = list[str]


@dataclass(frozen=True)
class Drawn:
    """A table as texts, and what it means."""

    header: Texts
    rows: list[Texts]
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    sign: str = ","
    newline: str = "\n"
    above: list[str] = field(default_factory=list)
    lines: dict[int, str] = field(default_factory=dict)
    """Lines that stand before a row of this number."""

    def text(self) -> str:
        """Return the table as it is written."""
        lines = [*self.above, self.sign.join(self.header)]
        for i, row in enumerate(self.rows):
            lines += [self.lines[i]] if i in self.lines else []
            lines.append(self.sign.join(row))
        return self.newline.join(lines) + self.newline


def drawn(rng: np.random.Generator) -> Drawn:
    """Return a table of a time and two columns, right and in one of the usual ways."""
    step_s = float(rng.choice([0.001, 0.01, 0.1, 1.0]))
    time_s = np.arange(_ROWS) * step_s
    decimals = int(rng.integers(0, 5))
    scale = 10.0 ** rng.integers(0, 5)
    values = np.round(scale * (1 + np.cumsum(rng.normal(size=(_ROWS, 2)), axis=0) / 20), decimals)
    form = f"{{:.{decimals}f}}" if rng.integers(2) else "{:.12g}"
    rows = [
        [f"{t:.3f}", *(form.format(value) for value in row)] for t, row in zip(time_s, values.tolist(), strict=True)
    ]
    newline = str(rng.choice(["\n", "\r\n"]))
    return Drawn(["time [s]", "Fz [N]", "T [Nm]"], rows, time_s, values, str(rng.choice([",", ";", "\t"])), newline)


def _wider(table: Drawn, rng: np.random.Generator) -> Drawn:
    start = int(rng.integers(_ROWS))
    end = int(rng.integers(start, _ROWS)) + 1
    return replace(table, rows=[[*row, "7"] if start <= i < end else row for i, row in enumerate(table.rows)])


def _exchanged(table: Drawn, rng: np.random.Generator) -> Drawn:
    at = int(rng.integers(1, _ROWS))
    header = table.sign.join([table.header[0], table.header[2], table.header[1]])
    rows = [[t, b, a] if i >= at else [t, a, b] for i, (t, a, b) in enumerate(table.rows)]
    return replace(table, rows=rows, lines={at: header})


def _other_header(table: Drawn, rng: np.random.Generator) -> Drawn:
    at = int(rng.integers(1, _ROWS))
    rows = [[t, b, a] if i >= at else [t, a, b] for i, (t, a, b) in enumerate(table.rows)]
    return replace(table, rows=rows, lines={at: table.sign.join(("t [s]", "moment", "load"))})


def _words(table: Drawn, rng: np.random.Generator) -> Drawn:
    at = int(rng.integers(0, 2) * rng.integers(_ROWS))
    words = [str(rng.choice(["ERR", "over", "0.5", ""])) for _ in range(2)]
    rows = [["ERR", *words] if i == at else row for i, row in enumerate(table.rows)]
    return replace(table, rows=rows)


def _quoted(table: Drawn, rng: np.random.Generator) -> Drawn:
    at = int(rng.integers(_ROWS))
    return replace(table, rows=[[row[0], f'"{row[1]}', row[2]] if i == at else row for i, row in enumerate(table.rows)])


def _thousands(table: Drawn, rng: np.random.Generator) -> Drawn:
    part, point = (",", ".") if rng.integers(2) else (".", ",")
    part = str(rng.choice([part, "'", " "]))
    decimals = int(rng.integers(0, 4))
    values = np.round(table.values, decimals)

    def cell(value: float) -> str:
        text = f"{value:,.{decimals}f}".replace(",", "\0").replace(".", point).replace("\0", part)
        return f'"{text}"' if table.sign in text else text

    rows = [[row[0].replace(".", point), *map(cell, new)] for row, new in zip(table.rows, values.tolist(), strict=True)]
    rows = [[f'"{row[0]}"' if table.sign in row[0] else row[0], *row[1:]] for row in rows]
    return replace(table, rows=rows, values=values)


def _decimal_commas(table: Drawn, _: np.random.Generator) -> Drawn:
    return replace(table, rows=[[cell.replace(".", ",") for cell in row] for row in table.rows])


def _dates(table: Drawn, rng: np.random.Generator) -> Drawn:
    days = np.arange(_ROWS) // int(rng.integers(60, 300))
    first, sign = int(rng.integers(1, 8)), str(rng.choice(list("./-")))
    order = "{d:02d}{s}{m:02d}" if sign == "." or rng.integers(2) else "{m:02d}{s}{d:02d}"
    stamps = [
        f"{order.format(d=first + day, m=6, s=sign)}{sign}2024 10:{i // 60:02d}:{i % 60:02d}"
        for i, day in enumerate(days)
    ]
    time_s = _JUNE_S + (first + days) * 86_400.0 + np.arange(_ROWS)
    rows = [[stamp, *row[1:]] for stamp, row in zip(stamps, table.rows, strict=True)]
    return replace(table, header=["time", *table.header[1:]], rows=rows, time_s=time_s)


def _units_above(table: Drawn, rng: np.random.Generator) -> Drawn:
    above = [table.sign.join(("ms", "N", "Nm"))]
    names = ["Time", "Fz", "T"] if rng.integers(2) else ["t", "load", "moment"]
    above = [table.sign.join(["Time", "Load", "Torque"]), *above] if rng.integers(2) else above
    time_s = 0.0125 * np.arange(_ROWS)
    rows = [[f"{1000 * t:.1f}", *row[1:]] for t, row in zip(time_s, table.rows, strict=True)]
    return replace(table, header=names, rows=rows, time_s=time_s, above=above)


def _timedeltas(table: Drawn, rng: np.random.Generator) -> Drawn:
    days = int(rng.integers(3))
    texts = [f"{days} days 00:{int(t // 60):02d}:{t % 60:09.6f}" for t in table.time_s]
    rows = [[text, *row[1:]] for text, row in zip(texts, table.rows, strict=True)]
    return replace(table, header=["time", *table.header[1:]], rows=rows, time_s=table.time_s + 86_400.0 * days)


def _unit_in_name(table: Drawn, rng: np.random.Generator) -> Drawn:
    unit, factor = (("ms", 1e3), ("us", 1e6), ("ns", 1e9))[rng.integers(3)]
    name = str(rng.choice([f"ts_{unit}", f"time_{unit}", f"t_{unit}", f"timestamp ({unit})", f"TS [{unit}]"]))
    rows = [[f"{t * factor:.0f}", *row[1:]] for t, row in zip(table.time_s, table.rows, strict=True)]
    return replace(table, header=[name, *table.header[1:]], rows=rows)


KINDS: dict[str, Callable[[Drawn, np.random.Generator], Drawn]] = {
    "as it is": lambda table, _: table,
    "rows of another width": _wider,
    "header that exchanges columns": _exchanged,
    "another header": _other_header,
    "row of words": _words,
    "quotation mark": _quoted,
    "thousands": _thousands,
    "decimal commas": _decimal_commas,
    "dates": _dates,
    "units above the names": _units_above,
    "timedeltas": _timedeltas,
    "unit in the name of the time": _unit_in_name,
}


def outcome_of(kind: str, seed: int, folder: Path) -> str:
    """Return what becomes of one file: ``"right"``, ``"said"``, or ``"wrong"`` where it is so without a word."""
    rng = np.random.default_rng(seed)
    if kind == DECIMAL_IDENTIFIERS:
        return _outcome_of_frames(rng, folder)
    table = KINDS[kind](drawn(rng), rng)
    data, packed = table.text().encode(), rng.integers(8) == 0
    path = folder / ("run.csv.gz" if packed else "run.csv")
    if packed:
        data = gzip.compress(data)
        data = data[: int(rng.integers(len(data) // 2, len(data) + 1))]
    path.write_bytes(data)
    try:
        series = read_series(path)
        blocks = [block for together in series.blocks() for block in together]
    except WheelsoilError:
        return "said"
    said = any(not any(usual in text for usual in _USUAL) for text in series.report.remarks())
    time_s = np.concatenate([block.time_ns for block in blocks]) / 1e9
    columns = [np.concatenate([block.columns[name] for block in blocks]) for name in blocks[0].columns]
    return _compared(table, time_s, np.reshape(columns, (len(columns), len(time_s))).T, said=said)


def _compared(table: Drawn, time_s: NDArray[np.float64], values: NDArray[np.float64], *, said: bool) -> str:
    """Return the outcome: what was read is right where it is a part of what was written, and a part has to be said."""
    at = np.searchsorted(table.time_s, time_s - 1e-6)
    if at.max(initial=0) >= _ROWS or not np.allclose(table.time_s[at], time_s, rtol=0, atol=1e-6):
        return "wrong"
    if values.shape[1] == table.values.shape[1]:
        there = np.isfinite(values)
        if not np.allclose(values[there], table.values[at][there], rtol=1e-9, atol=1e-9):
            return "wrong"
        if there.sum() == table.values.size:
            return "right"
    return "said" if said else "wrong"


DECIMAL_IDENTIFIERS = "decimal identifiers"


def _outcome_of_frames(rng: np.random.Generator, folder: Path) -> str:
    known = rng.integers(0, 0x800, int(rng.integers(1, 30)))
    ids = rng.choice(known, _ROWS)
    form = "d" if rng.integers(2) else "X"
    path = folder / "frames.csv"
    path.write_text("Stamp,Id,Payload\n" + "".join(f"{i}.5,{one:{form}},0011\n" for i, one in enumerate(ids.tolist())))
    try:
        reading = read_log(path, columns=parse_columns("time=Stamp,id=Id,data=Payload"))
        found = np.concatenate([batch.frames["can_id"] for batch in reading])
    except WheelsoilError:
        return "said"
    if np.array_equal(found, ids):
        return "right"
    return "said" if reading.report.bad or reading.report.readings else "wrong"
