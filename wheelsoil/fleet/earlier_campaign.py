"""What a store has of the campaign before some runs, for a report that says what has changed since."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from math import nan
from typing import Any

from daq import OUTPUTS, ConfigError
from wheelsoil.fleet import Damage, Store
from wheelsoil.fleet.holdings import Holdings, read
from wheelsoil.wording.names import SOIL_UNITS
from wheelsoil.workflows.diagnosis import Processed
from wheelsoil.workflows.key_figures import CALIBRATED_SOIL, MODELS
from wheelsoil.workflows.last_report import LEAST_COMPARED, LastReport, Stated, half_interval, sizes_with_interval

_PULL = ("pull_at_slip_0_2_n", "pull_at_slip_0_2_lower95_n", "pull_at_slip_0_2_upper95_n")
_SUBJECT = {"transducer": "transducer", "wheel radius r": "wheel_radius_m", "wheel width b": "wheel_width_m"}
_CAMPAIGN = ("wheel", "state", "path", "vehicle", *_SUBJECT.values(), "terrain", "start", "used_share", *_PULL)
_ESTIMATE = ("parameter", "unit", "value", "lower95", "upper95")
OF_A_CAUSE = ("family", "role", "probability", *_ESTIMATE)
_TABLES = ("campaigns", "coefficients", "causes", "gains")
_SOILS = (CALIBRATED_SOIL, MODELS["named"])


def last_campaign(store: Store, processed: Processed) -> tuple[LastReport, tuple[Damage, ...]]:
    """Return the latest earlier campaign of the vehicle and terrain of some runs, and what was set aside for it.

    One with the transducer of the runs comes before one with another, and one that has their wheel among several before
    one of a single wheel; their own folder does not count.

    Parameters
    ----------
    processed : sequence of (Run, ProcessedRun)
        Of one vehicle and terrain.

    Raises
    ------
    ConfigError
        There is none, or the store cannot be read.
    """

    def find(holdings: Holdings) -> LastReport:
        rows = holdings.table("campaigns", _CAMPAIGN).to_pylist()
        row = _before(rows, processed, store.url)
        stated = tuple(_stated(holdings, row))
        start = row["start"]
        driven = f"{start.day} {start:%B %Y}"
        texts = {name: row[key] if name == key else f"{row[key]:g} m" for name, key in _SUBJECT.items() if row[key]}
        return LastReport(
            row["campaign"], start.isoformat(), row["terrain"] or "", stated, "campaign", texts, driven=driven
        )

    return read(store, _TABLES, find)


def _before(rows: list[dict[str, Any]], processed: Processed, url: str) -> dict[str, Any]:
    first = processed[0][0]
    vehicle, serial = first.vehicle.vehicle.name, first.vehicle.transducer.serial
    terrain = first.terrain.soil.name if first.terrain else ""
    own = {str(run.path.absolute().parent) for run, _ in processed}
    # When the first run began, as a store has it; None where no run has a date.
    starts = [run.start_ns for _, run in processed if run.start_ns > 0]
    start = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=min(starts) // 1000) if starts else None
    wheel = first.vehicle.wheel.id if first.vehicle.wheel else ""
    rows = [row | {"wheel": row["wheel"] or ""} for row in rows if row["wheel"] in (None, "", wheel)]
    others = [row for row in rows if row["state"] == "done" and row["path"] not in own]
    alike = [row for row in others if (row["vehicle"] or "", row["terrain"] or "") == (vehicle, terrain)]
    earlier = [row for row in alike if row["start"] is not None and (start is None or row["start"] < start)]
    if not earlier:
        day = f", before {start:%Y-%m-%d %H:%M} UTC" if start else ""
        raise ConfigError.of(
            "the store has no earlier campaign of this vehicle and terrain",
            url,
            found=f"{len(others)} other campaigns, {len(alike)} of this vehicle and terrain",
            expected=f"vehicle {vehicle!r} on {terrain!r}{f', wheel {wheel}' if wheel else ''}{day}",
            next_step="add it by `wheelsoil fleet run ROOT --store STORE`, or give the JSON file of the last report",
        )
    order = ("wheel", "start", "campaign")
    return max(earlier, key=lambda row: ((row["transducer"] or "") == serial, *(row[key] for key in order)))


def _stated(holdings: Holdings, row: Mapping[str, Any]) -> Iterator[Stated]:
    """Yield what is compared of a campaign, by the names that `stated_in` gives."""
    for soil in _rows(holdings, "coefficients", row, ("model", *_ESTIMATE)):
        if soil["model"] in _SOILS:
            yield _of_estimate("soil", ("soil", soil["parameter"]), soil, SOIL_UNITS.get(soil["parameter"], ""))
    yield from causes_stated(_rows(holdings, "causes", row, OF_A_CAUSE))
    if row[_PULL[0]] is not None:
        pull = dict(zip(("value", "lower95", "upper95"), (row[key] for key in _PULL), strict=True))
        yield _of_estimate("pull", ("pull_at_slip_0.2",), pull, "N")
    channels = {output.role: (channel, output.unit_text) for channel, output in OUTPUTS.items()}
    for gain in _rows(holdings, "gains", row, ("channel", "model", "R0")):
        if gain["model"] == "base" and gain["R0"] is not None:
            channel, unit = channels[gain["channel"]]
            yield Stated("error", ("error", channel, CALIBRATED_SOIL), gain["R0"], nan, unit)
    if row["used_share"] is not None:
        yield Stated("data", ("used_share",), row["used_share"], nan, "")


def causes_stated(rows: Iterable[Mapping[str, Any]]) -> Iterator[Stated]:
    """Yield the sizes of a campaign's causes, of rows with the columns `OF_A_CAUSE`."""
    sizes: dict[str, list[Stated]] = {}
    for cause in rows:
        if cause["role"] != "candidate" and cause["parameter"]:
            unit = "" if cause["unit"] == "1" else cause["unit"] or ""
            size = _of_estimate("cause", (cause["family"], cause["parameter"]), cause, unit)
            probable = cause["probability"] is None or cause["probability"] >= LEAST_COMPARED
            barred = cause["role"] == "barred"
            size = replace(size, compared=probable and not barred, barred=probable and barred)
            sizes.setdefault(cause["family"], []).append(size)
    for each in sizes.values():
        yield from sizes_with_interval(each)


def _rows(holdings: Holdings, table: str, of: Mapping[str, Any], columns: Iterable[str]) -> list[dict[str, Any]]:
    from pyarrow import dataset

    rows = holdings.where(table, [*columns, "wheel"], dataset.field("campaign") == of["campaign"]).to_pylist()
    return [row for row in rows if (row["wheel"] or "") == of["wheel"]]


def _of_estimate(kind: str, name: tuple[str, ...], row: Mapping[str, Any], unit: str) -> Stated:
    value, low, high = (nan if row[key] is None else float(row[key]) for key in ("value", "lower95", "upper95"))
    return Stated(kind, name, value, half_interval(value, low, high), unit)
