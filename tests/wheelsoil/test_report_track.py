"""The map of the track: places on a plane, wherever on earth, and extents of all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.sections.track import track


def extents(material: ReportInputs) -> list[float]:
    return [
        fact[f"{axis}_extent_m"]
        for fact in track.build(material).numbers["tracks"].values()
        for axis in ("east", "north")
    ]


def test_runs_across_the_180th_meridian_are_as_wide_as_elsewhere(material):
    middle = np.nanmean(material.runs[0].longitude_deg)
    moved = tuple(
        replace(run, longitude_deg=(run.longitude_deg - middle + 360.0) % 360.0 - 180.0) for run in material.runs
    )
    assert max(np.nanmax(run.longitude_deg) - np.nanmin(run.longitude_deg) for run in moved) > 359
    section = track.build(replace(material, runs=moved))
    assert extents(replace(material, runs=moved)) == pytest.approx(extents(material), rel=1e-6)
    assert abs(section.numbers["origin_longitude_deg"]) == pytest.approx(180.0, abs=0.01)


def test_a_single_jump_of_the_position_is_in_the_extent(material):
    run = material.runs[0]
    latitude = run.latitude_deg.copy()
    latitude[np.flatnonzero(np.isfinite(latitude))[1]] += 0.01
    jumped = replace(material, runs=(replace(run, latitude_deg=latitude), *material.runs[1:]))
    assert extents(jumped)[1] > 1000
