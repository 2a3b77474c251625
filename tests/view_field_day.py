"""Campaigns of a day in the field, some of which lack something, and the analyst's page on all of them."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnosis_samples import diagnosis
from view_client import View, taken_from
from view_in_process import viewing_here

from model.progress import note_share
from wheelsoil.to_json import plain
from wheelsoil.view import jobs
from wheelsoil.wording.diagnosis_json import diagnosis_json

SCRIPT = "<script>document.title='taken'</script><img src=x onerror=alert(1)>"
_RECORDINGS = Path(__file__).parents[1] / "recordings"
_OVER = "diagnosed"


@dataclass(frozen=True)
class FieldDay:
    """The page: campaign c1 has two runs on clay, c2 one on sand, each of the others is named after what it is.

    A diagnosis is one made by hand, and takes until the file `over` is there.
    """

    view: View
    clay: Path
    over: Path


@contextmanager
def field_day_in(home: Path) -> Iterator[FieldDay]:
    """The page on new folders in `home`, with all runs processed."""
    clay = taken_from(_RECORDINGS / "clay", home / "clay field", 2)
    sandy = taken_from(_RECORDINGS / "sandy", home / "sandy", 1)
    odd = [_markup(home), _height(home), *(_lacking(home, role) for role in ("driving_torque", "ground_speed"))]
    with viewing_here(clay, sandy, *odd, _broken(home), instead={jobs.diagnose_members: made_by_hand}) as view:
        view.settled()
        yield FieldDay(view, clay, home / _OVER)


def made_by_hand(_members: object, paths: Sequence[Path], *_: object) -> dict[str, Any]:
    """What `jobs.diagnose_members` returns, of a diagnosis that costs nothing."""
    note_share(0.25)
    while not (paths[0].parent / _OVER).exists():
        time.sleep(0.02)
    found = diagnosis("named")
    shown: dict[str, Any] = plain(diagnosis_json(found) | jobs.shown_of(found))
    return shown


def _markup(home: Path) -> Path:
    folder = taken_from(_RECORDINGS / "clay", home / "<b>markup", 1)
    (folder / "runs.toml").write_text(f'[[run]]\nfile = "run-1.mcap"\nid = "{SCRIPT}"\n', encoding="utf-8")
    return folder


def _height(home: Path) -> Path:
    """The one length in the recording, 27 m, stands in for a measured sinkage of 27 mm."""
    folder = taken_from(_RECORDINGS / "clay", home / "measured sinkage", 1)
    return _with_vehicle(folder, r"\[signals\]", '[signals]\nsinkage = {signal = "GNSS_3.Altitude", unit = "mm"}')


def _lacking(home: Path, role: str) -> Path:
    return _with_vehicle(taken_from(_RECORDINGS / "clay", home / f"no {role}", 1), rf"(?m)^{role} =.*\n", "")


def _broken(home: Path) -> Path:
    """No wheel is described, and one recording is cut off in its head."""
    folder = taken_from(_RECORDINGS / "clay", home / "broken", 1)
    (folder / "run-0.mcap").write_bytes((folder / "run-1.mcap").read_bytes()[:3000])
    return _with_vehicle(folder, r"(?s)\[wheel\].*?\n\n", "")


def _with_vehicle(folder: Path, pattern: str, text: str) -> Path:
    """The folder, one place of its vehicle.toml changed."""
    file = folder / "vehicle.toml"
    changed, count = re.subn(pattern, lambda _: text, file.read_text(encoding="utf-8"))
    assert count == 1
    file.write_text(changed, encoding="utf-8")
    return folder
