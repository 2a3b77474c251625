"""Map of the track in metres, coloured by slip and by used samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from daq import BoolArray, DataError, FloatArray
from processing import ProcessedRun
from wheelsoil.report.content import Contents, Panels, Table, grouped, section
from wheelsoil.report.figures import ALL_RUNS, Trace, axes, points
from wheelsoil.report.figures import numbers as plotted
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.wording.numbers import number

_EARTH_M = 6_371_008.8
_POINTS_IN_ALL, _MOST = 3000, 250
_SLIPS = (
    ("braking", -np.inf, 0.0, "#56B4E9", "triangle-down-open"),
    ("slip 0 to 0.2", 0.0, 0.2, "#bdbdbd", "circle"),
    ("slip 0.2 to 0.5", 0.2, 0.5, "#E69F00", "square"),
    ("slip above 0.5", 0.5, np.inf, "#111111", "diamond"),
)
_USE = (("used", True, "#0072B2", "circle"), ("excluded", False, "#D55E00", "x"))
_READING = (
    "every mark is a position of the antenna, in metres east and north of the mean of all runs, to one scale; "
    "a ring is the start of a run. Runs that should share a rut must coincide; a different soil at one end of the "
    "field shows as a patch."
)


@dataclass(frozen=True)
class _Track:
    """Some positions of a run: metres east and north, slip (NaN if excluded), use; the extent is of all samples."""

    name: str
    time_s: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    slip: FloatArray
    used: BoolArray
    length_m: float
    extent_m: tuple[float, float]


@section("track", "Map of the track")
def track(inputs: ReportInputs) -> Contents:
    """Build the section: coloured by slip and by use, all runs or one; `DataError` if no run has a position."""
    tracks, origin = _tracks(inputs.runs)
    choices = [ALL_RUNS, *(track.name for track in tracks)] if len(tracks) > 1 else [tracks[0].name]
    shown = [(choice, [track for track in tracks if choice in (ALL_RUNS, track.name)]) for choice in choices]
    figures = [
        grouped(key, title, [(choice, draw(of_choice)) for choice, of_choice in shown], _plane())
        for key, title, draw in (
            ("track-slip", "By slip", _by_slip),
            ("track-use", "Used and excluded samples", _by_use),
        )
    ]
    if not any(np.isfinite(track.slip).any() for track in tracks):
        del figures[0]
    numbers = {"origin_latitude_deg": origin[0], "origin_longitude_deg": origin[1], "tracks": _extents(tracks)}
    rows = [
        [name, number(fact["length_m"]), number(fact["east_extent_m"]), number(fact["north_extent_m"])]
        for name, fact in _extents(tracks).items()
    ]
    note = f"Origin: {origin[0]:.6f}° north, {origin[1]:.6f}° east. Distance: integrated ground speed."
    head = ["run", "distance (m)", "east–west extent (m)", "north–south extent (m)"]
    return [Panels(figures, _READING, choices), Table("Tracks", head, rows, note)], numbers


def _tracks(runs: tuple[ProcessedRun, ...]) -> tuple[list[_Track], tuple[float, float]]:
    placed = [run for run in runs if known_places(run).any()]
    if not placed:
        raise DataError.of("the position was not measured: no run has latitude and longitude")
    latitude = float(np.mean(np.concatenate([run.latitude_deg[known_places(run)] for run in placed])))
    longitudes = np.concatenate([run.longitude_deg[known_places(run)] for run in placed])
    longitude = float(_wrapped(longitudes[0] + np.mean(_wrapped(longitudes - longitudes[0]))))
    most = min(_MOST, max(60, _POINTS_IN_ALL // len(placed)))
    return [_track(run, latitude, longitude, most) for run in placed], (latitude, longitude)


def known_places(run: ProcessedRun) -> BoolArray:
    """Return which samples have a position, shape (n,)."""
    return np.asarray(np.isfinite(run.latitude_deg) & np.isfinite(run.longitude_deg))


def _wrapped(degrees: FloatArray) -> FloatArray:
    """Return angles wrapped to -180 to 180 degrees, for runs across the 180th meridian."""
    return (degrees + 180.0) % 360.0 - 180.0


def _track(run: ProcessedRun, latitude: float, longitude: float, most: int) -> _Track:
    """Return a run on the tangent plane at a position (degrees)."""
    known = np.flatnonzero(known_places(run))
    rows = known[np.unique(np.linspace(0, len(known) - 1, min(most, len(known))).astype(int))]
    north = _EARTH_M * np.radians(run.latitude_deg - latitude)
    east = _EARTH_M * np.cos(np.radians(latitude)) * np.radians(_wrapped(run.longitude_deg - longitude))
    distance = run.distance_m[np.isfinite(run.distance_m)]
    length = float(np.ptp(distance)) if len(distance) else float("nan")
    extent = (float(np.ptp(east[known])), float(np.ptp(north[known])))
    slip = np.where(run.used, run.slip, np.nan)
    return _Track(run.run.id, run.time_s[rows], east[rows], north[rows], slip[rows], run.used[rows], length, extent)


def places(runs: tuple[ProcessedRun, ...]) -> dict[str, dict[str, list[float | None]]]:
    """Return where each run was over its time, metres east and north of the mean of all; nothing without positions."""
    if not any(known_places(run).any() for run in runs):
        return {}
    return {
        track.name: {"x": plotted(track.time_s), "east": plotted(track.east_m, 5), "north": plotted(track.north_m, 5)}
        for track in _tracks(runs)[0]
    }


def _extents(tracks: list[_Track]) -> dict[str, dict[str, float]]:
    return {
        track.name: {
            "length_m": track.length_m,
            "east_extent_m": track.extent_m[0],
            "north_extent_m": track.extent_m[1],
        }
        for track in tracks
    }


def _by_slip(tracks: list[_Track]) -> list[Trace]:
    traces = _starts(tracks)
    for name, low, high, colour, symbol in _SLIPS:
        traces += _marks(tracks, [(t.slip > low) & (t.slip <= high) for t in tracks], name, colour, symbol)
    return traces


def _by_use(tracks: list[_Track]) -> list[Trace]:
    traces = _starts(tracks)
    for name, used, colour, symbol in _USE:
        traces += _marks(tracks, [t.used == used for t in tracks], name, colour, symbol)
    return traces


def _marks(tracks: list[_Track], rows: list[BoolArray], name: str, colour: str, symbol: str) -> list[Trace]:
    east = np.concatenate([track.east_m[keep] for track, keep in zip(tracks, rows, strict=True)])
    north = np.concatenate([track.north_m[keep] for track, keep in zip(tracks, rows, strict=True)])
    return [points(plotted(east), plotted(north), name, (colour, symbol))] if len(east) else []


def _starts(tracks: list[_Track]) -> list[Trace]:
    east = np.array([track.east_m[0] for track in tracks])
    north = np.array([track.north_m[0] for track in tracks])
    ring = points(plotted(east), plotted(north), "start", ("#111111", "circle-open"), 15.0)
    return [ring | {"texts": [track.name for track in tracks]}]


def _plane() -> dict[str, Any]:
    """Return a layout whose axes have one scale."""
    return axes("east (m)", "north (m)", height=430, one_scale=True)
