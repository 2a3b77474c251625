"""What the page's list says of campaigns and runs, as plain values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from daq.errors import Fault
from processing.by_hand import with_by_hand
from processing.processed_run import Reason
from wheelsoil.view.campaigns import ViewedCampaign, ViewedRun

_BY_DESIGN = (Reason.STANDSTILL, Reason.TOO_SLOW, Reason.FILTER_EDGE)


def campaign_entry(campaign: ViewedCampaign) -> dict[str, Any]:
    """Return a campaign as /api/list shows it."""
    terrain, wheel = campaign.first.terrain, campaign.first.vehicle.wheel
    keeps = campaign.keeps()
    diagnosis = campaign.diagnosis
    found = diagnosis.found or {}
    return {
        "key": campaign.key,
        "name": campaign.name,
        "path": str(campaign.folder),
        "terrain": campaign.soil_name or (terrain.soil.name if terrain else None),
        "vehicle": campaign.first.vehicle.vehicle.name,
        "wheel": {"radius_m": wheel.radius_m, "width_m": wheel.width_m} if wheel else None,
        "runs": [_run_entry(run, run.key in keeps, keeps.get(run.key)) for run in campaign.runs],
        "diagnosis": {
            "state": diagnosis.state,
            "verdict": found.get("verdict"),
            "sentence": found.get("sentence"),
            "why": told(diagnosis.faults),
        },
        "choice": campaign.choice.to_mapping(),
        "saved_at": str(campaign.saved_at) if campaign.saved_at else None,
    }


def told(faults: Iterable[Fault]) -> str | None:
    """Return faults in one line; None where there is none."""
    return "; ".join(f"{fault.what} ({fault.found})" if fault.found else fault.what for fault in faults) or None


def faults_as_json(faults: Iterable[Fault]) -> dict[str, Any]:
    """Return faults as the page takes them."""
    return {"faults": [asdict(fault) for fault in faults]}


def fault_of_ours(error: BaseException, where: str = "") -> Fault:
    """Return an error that is none of ours as a fault; only the last line of what it says."""
    said = str(error).strip().splitlines()[-1:] or [type(error).__name__]
    return Fault("a fault in the page", where, said[0], next_step="please report it")


def _run_entry(run: ViewedRun, use: bool, keep: tuple[tuple[float, float], ...] | None) -> dict[str, Any]:
    info, seen = run.run.info, run.seen
    entry = {
        "key": run.key,
        "id": run.run.id,
        "file": run.run.path.name,
        "direction": info.direction,
        "pass_number": info.pass_number,
        "added_load_kg": info.added_load_kg,
        "inflation_kpa": info.inflation_kpa,
        "state": run.state,
        "why": told(run.faults) if run.state == "failed" else None,
        "use": use,
        "duration_s": None,
        "usable_share": None,
        "grade": None,
        "notes": [],
        "sha256": None,
    }
    if seen is None:
        return entry
    samples = len(seen.reason)
    moving = np.count_nonzero(~np.isin(seen.reason, _BY_DESIGN))
    reason = seen.reason if keep is None else with_by_hand(seen.reason, np.arange(samples) / seen.rate_hz, keep)
    used = np.count_nonzero(reason == Reason.USED)
    return entry | {
        "duration_s": samples / seen.rate_hz,
        "usable_share": used / moving if moving else 0.0,
        "grade": seen.grade,
        "notes": [*seen.grade_reasons, *(note for note in seen.notes if note not in seen.grade_reasons)],
        "sha256": seen.sha256,
    }
