"""How a fleet's store grows: plan, status, SQL, diagnosis and report with 1,000 campaigns and more.

``python -m benchmarks.fleet_growth STORE 1000 10000``: STORE is what ``wheelsoil fleet run`` made of a few campaigns.
Their rows under other names, in packs as ``wheelsoil fleet compact`` makes them, are the large stores; each campaign
has a folder with three empty files. Each command is a process of its own: CPU seconds (of all threads; a loaded machine
does not change them much) and peak memory are those of the whole process. Prints a Markdown table.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wheelsoil.fleet import COLUMNS, Manifest, Store, holdings_of, open_store, plan_fleet
from wheelsoil.fleet.manifests import PACKS, sealed, stated, text_of_pack
from wheelsoil.fleet.packs import CAMPAIGNS_OF_A_GROUP, CAMPAIGNS_OF_A_PACK
from wheelsoil.fleet.tables import packed_schema_of

SQL = "select verdict, count(*) as campaigns, median(R0_base) from diagnoses group by verdict"
OF_SAMPLES = "select round(slip, 1) as slip, count(*) from samples where used group by 1 order by 1"
_SERIALS = 40
"""Transducers of the large stores; with 100,000 campaigns 2,500 for each."""
_COMMAND = "from wheelsoil.cli.app import main; main()"
_MAKE = "import sys; from benchmarks.fleet_growth import make; make(*sys.argv[1:])"
_PLAN = "import sys; from benchmarks.fleet_growth import plan; plan(*sys.argv[1:])"
_FILES = ("run-1.mcap", "vehicle.toml", "terrain.toml")


class Copies:
    """The campaigns of a store again and again, under other names."""

    def __init__(self, origin: Store) -> None:
        holdings = holdings_of(origin)
        done = [one for one in holdings.manifests.values() if one.state == "done"]
        self.originals = [done[i % len(done)] for i in range(CAMPAIGNS_OF_A_GROUP)]
        self.rows: dict[str, tuple[pa.Table, pa.Array]] = {}
        for name in COLUMNS:
            table = holdings.table(name)
            places: dict[str, list[int]] = {}
            for i, campaign in enumerate(table["campaign"].to_pylist()):
                places.setdefault(campaign, []).append(i)
            own = [places.get(one.campaign, []) for one in self.originals]
            which = pa.array([at for at, rows in enumerate(own) for _ in rows], pa.int32())
            if len(which):
                taken = pa.array([i for rows in own for i in rows], pa.int64())
                self.rows[name] = (table.take(taken).combine_chunks(), which)

    def pack(self, store: Store, campaigns: Sequence[tuple[str, dict[str, list[int]]]]) -> None:
        """Write some campaigns, of a name and source files each, as one pack."""
        buffers = {name: BytesIO() for name in self.rows}
        options: dict[str, Any] = {"compression": "zstd", "write_page_checksum": True}
        writers = {name: pq.ParquetWriter(buffers[name], packed_schema_of(name), **options) for name in buffers}
        groups: list[list[Manifest]] = []
        for start in range(0, len(campaigns), CAMPAIGNS_OF_A_GROUP):
            some = [name for name, _ in campaigns[start : start + CAMPAIGNS_OF_A_GROUP]]
            contents = [hashlib.sha256(name.encode()).hexdigest()[:16] for name in some]
            serials = [f"WFT-{int(content, 16) % _SERIALS}" for content in contents]
            for name, (rows, which) in self.rows.items():
                for column, values in (("campaign", some), ("content", contents), ("transducer", serials)):
                    place = rows.schema.get_field_index(column)
                    if place >= 0:
                        rows = rows.set_column(place, rows.schema.field(place), pa.array(values).take(which))
                writers[name].write_table(rows.cast(packed_schema_of(name)), row_group_size=len(rows))
            whole = zip(self.originals, some, contents, strict=True)
            groups.append([replace(one, campaign=name, content=content) for one, name, content in whole])
        for writer in writers.values():
            writer.close()
        data = {f"{name}.parquet": buffer.getvalue() for name, buffer in buffers.items()}
        settings = self.originals[0].options
        data["sources.json"] = sealed({name: {"files": files, "options": settings} for name, files in campaigns})
        pack = hashlib.sha256(campaigns[0][0].encode()).hexdigest()[:16]
        for file, each in data.items():
            store.write(f"{PACKS}/{pack}/{file}", each)
        parts = {file: stated(each) for file, each in data.items()}
        store.write(f"{PACKS}/{pack}.json", text_of_pack(groups, parts))


def make(origin: str, target: str, place: str, count: str) -> None:
    """Fill a store with campaigns, and make a folder for each."""
    store, copies, fields = open_store(target, create=True), Copies(open_store(origin)), Path(place)
    for start in range(0, int(count), CAMPAIGNS_OF_A_PACK):
        campaigns = []
        for i in range(start, start + CAMPAIGNS_OF_A_PACK):
            folder = fields / f"vehicle-{i % 100:02d}" / f"day-{i:06d}"
            folder.mkdir(parents=True)
            for name in _FILES:
                (folder / name).touch()
            facts = {str(path): path.stat() for path in (folder / name for name in _FILES)}
            files = {path: [stat.st_size, stat.st_mtime_ns] for path, stat in facts.items()}
            campaigns.append((folder.relative_to(fields).as_posix(), files))
        copies.pack(store, campaigns)


def plan(fields: str, url: str) -> None:
    """Plan the fleet, as `fleet run` does; nothing is to be done."""
    found = plan_fleet([Path(fields)], url)
    print(json.dumps([len(found.found), len(found.todo)]))
    assert found.found and not found.todo


def measured(*command: str) -> tuple[float, float]:
    """Return CPU seconds and peak memory, MB, of a Python process."""
    with tempfile.TemporaryFile() as out, subprocess.Popen(command, stdout=out, stderr=out) as process:
        _, code, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(code)
        out.seek(0)
        if process.returncode:
            raise SystemExit(f"{command}: {out.read().decode()}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def steps(fields: Path, url: Path, folder: Path) -> Iterator[tuple[str, float, float]]:
    """Yield name, CPU seconds and MB of each command on a store."""
    wheelsoil = (sys.executable, "-c", _COMMAND, "fleet")
    calls: dict[str, tuple[str, ...]] = {
        "start of the program": (*wheelsoil, "--help"),
        "plan": (sys.executable, "-c", _PLAN, str(fields), str(url)),
        "`status`": (*wheelsoil, "status", str(url)),
        "`sql` of diagnoses": (*wheelsoil, "sql", str(url), SQL),
        "`sql` of samples": (*wheelsoil, "sql", str(url), OF_SAMPLES),
        "`check`": (*wheelsoil, "check", str(url)),
        "`diagnose`": (*wheelsoil, "diagnose", str(url), "--json"),
        "`report`": (*wheelsoil, "report", str(url), "-o", str(folder / "fleet.html"), "--force"),
    }
    for name, call in calls.items():
        yield name, *measured(*call)


def main(origin: str, *counts: str) -> None:
    """Measure every count; print a table with the exponents between the first and the last."""
    folder = Path(tempfile.mkdtemp(prefix="fleet-growth-"))
    found: dict[str, list[tuple[float, float]]] = {}
    sizes = [int(count) for count in counts]  # made by children: a child's peak is not below its parent's
    for count in sizes:
        fields, url = folder / f"fields-{count}", folder / f"store-{count}"
        measured(sys.executable, "-c", _MAKE, origin, str(url), str(fields), str(count))
        files = [path.stat().st_size for path in url.rglob("*") if path.is_file()]
        print(f"{count}: {len(files)} files, {sum(files) / count / 1e3:.1f} kB a campaign", flush=True)
        for name, seconds, megabytes in steps(fields, url, folder):
            print(f"  {name}: {seconds:.2f} s, {megabytes:.0f} MB", flush=True)
            found.setdefault(name, []).append((seconds, megabytes))
    shutil.rmtree(folder)
    print("| | " + " | ".join(f"{count:,}" for count in sizes) + " | exponent |\n|" + "---|" * (len(sizes) + 2))
    start, *_ = (values for values in found.values())
    for name, values in found.items():
        cells = " | ".join(f"{seconds:.1f} s, {megabytes:.0f} MB" for seconds, megabytes in values)
        own = [max(seconds - idle, 1e-3) for (seconds, _), (idle, _) in zip(values, start, strict=True)]
        exponent = math.log(own[-1] / own[0]) / math.log(sizes[-1] / sizes[0]) if len(sizes) > 1 else math.nan
        print(f"| {name} | {cells} | {'' if values is start else f'{exponent:.2f}'} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
