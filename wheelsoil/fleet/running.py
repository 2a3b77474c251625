"""A fleet from its roots to the store: what is there already is not done again."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from daq import ConfigError, machine_memory_bytes
from model import available_cores
from wheelsoil import __version__
from wheelsoil.cache import folder
from wheelsoil.fleet.campaign_task import Done, FleetOptions, Task, content_of, work_on
from wheelsoil.fleet.engines import Lost, in_processes, on_dask
from wheelsoil.fleet.holdings import holdings_of
from wheelsoil.fleet.manifests import DONE, Damage, Manifest
from wheelsoil.fleet.roots import Beside, Source, facts_of, find_sources
from wheelsoil.fleet.rows import Found, tables_of
from wheelsoil.fleet.store import Store, open_store, uncollected
from wheelsoil.wording.store_text import verdict_with_causes

Engine = Literal["local", "dask"]

_MEMORY_SHARE = 0.8
"""Of the machine's memory that its workers may use together."""


@dataclass(frozen=True)
class Workers:
    """What works on a fleet.

    Attributes
    ----------
    scheduler : str
        Address of a Dask scheduler; empty: a cluster of this machine.
    jobs : int
        Processes of this machine; 0: as many as it has cores.
    memory_bytes : int
        Most for each of them; 0: its share of 80 % of the machine's memory.
    """

    engine: Engine = "local"
    scheduler: str = ""
    jobs: int = 0
    memory_bytes: int = 0

    @property
    def count(self) -> int:
        """Number of processes of this machine."""
        return self.jobs or available_cores()

    @property
    def memory(self) -> int:
        """Most that each may use, in bytes; 0 where the system does not say how much there is."""
        return self.memory_bytes or int(_MEMORY_SHARE * machine_memory_bytes() / self.count)


@dataclass(frozen=True)
class Shard:
    """The part `index` (from 1) of `count` of a fleet; the same campaigns whatever else is there."""

    index: int = 1
    count: int = 1

    @staticmethod
    def of(text: str) -> Shard:
        """Read ``i/n``.

        Raises
        ------
        ConfigError
            It is none.
        """
        index, sign, count = text.partition("/")
        if not (sign and index.isdigit() and count.isdigit() and 1 <= int(index) <= int(count)):
            raise ConfigError.of("--shard is no part of a whole", found=text, expected="i/n with 1 <= i <= n, as 3/20")
        return Shard(int(index), int(count))

    def has(self, source: Source) -> bool:
        """Return whether a campaign is in this part."""
        if self.count == 1:
            return True
        number = int.from_bytes(hashlib.sha256(source.name.encode()).digest()[:8])
        return number % self.count == self.index - 1


@dataclass(frozen=True)
class Step:
    """One campaign more that is finished.

    Attributes
    ----------
    outcome : str
        Its verdict, and what is wrong with it.
    finished, failed, total : int
        So far, and of this call.
    cpu_s, peak_bytes : float, int
        What this one cost; 0 if it was not worked on.
    left_s : float
        Estimated, by how long those took that are finished.
    """

    name: str
    state: str
    outcome: str
    finished: int
    failed: int
    total: int
    cpu_s: float
    peak_bytes: int
    left_s: float


@dataclass(frozen=True)
class Plan:
    """What is to be done.

    Attributes
    ----------
    found : tuple of Source
        All campaigns.
    tasks : tuple of Task
        Those that the store does not have as they are now.
    failed : mapping name -> fault
        Of those that it has.
    damaged : tuple of Damage
        Of the store's files; the campaigns that were found are made anew.
    not_read : tuple of str
        What lies below the roots and looks like a part of a campaign; see `find_sources`.
    """

    store: Store
    found: tuple[Source, ...]
    tasks: tuple[Task, ...]
    failed: dict[str, str]
    options: FleetOptions
    damaged: tuple[Damage, ...] = ()
    not_read: tuple[str, ...] = ()

    @property
    def todo(self) -> tuple[Source, ...]:
        """What is to be done."""
        return tuple(task.source for task in self.tasks)


def plan_fleet(
    roots: Sequence[Path],
    url: str,
    options: FleetOptions | None = None,
    *,
    shard: Shard | None = None,
    retry_failed: bool = False,
    thorough: bool = False,
) -> Plan:
    """Find the campaigns, and what the store has of them.

    A campaign is there if it was finished by this version with these options, and its files have the size and the time
    of change that they had. `thorough` compares the checksums of the store's own files.

    Raises
    ------
    ConfigError
        See `find_sources` and `open_store`.
    """
    with uncollected():
        return _planned(roots, url, options or FleetOptions(), shard or Shard(), retry_failed, thorough)


def _planned(
    roots: Sequence[Path], url: str, options: FleetOptions, shard: Shard, retry_failed: bool, thorough: bool
) -> Plan:
    not_read: list[str] = []
    found = {source: files for source, files in find_sources(roots, not_read).items() if shard.has(source)}
    store = open_store(url, create=True)
    holdings = holdings_of(store, thorough=thorough)
    known, made_of = holdings.manifests, holdings.sources()
    chosen = json.loads(json.dumps(asdict(options)))

    def is_there(source: Source, files: Beside | None) -> bool:
        manifest = known.get(source.name)
        if manifest is None or (retry_failed and manifest.state == "failed"):
            return False
        made = made_of[source.name]
        here = manifest.version == __version__ and isinstance(made, dict) and made.get("options") == chosen
        return here and _as_now(source, files, made.get("files"))

    todo = tuple(source for source, files in found.items() if not is_there(source, files))
    left = {source.name for source in found} - {source.name for source in todo}
    failed = {name: manifest.fault for name, manifest in known.items() if manifest.state == "failed" and name in left}
    older: dict[str, tuple[str, ...]] = {}
    for part in (*holdings.parts, *holdings.older):
        for manifest in () if part.is_pack else part.all:
            older[manifest.campaign] = (*older.get(manifest.campaign, ()), part.name)
    contents = {source.name: known[source.name].content for source in todo if source.name in known}
    items = tuple(Task(source, older.get(source.name, ()), contents.get(source.name, "")) for source in todo)
    return Plan(store, tuple(found), items, failed, options, holdings.damaged, tuple(not_read))


def _as_now(source: Source, files: Beside | None, made_of: object) -> bool:
    """Return whether a campaign's files are those that its rows were made of."""
    if not (made_of and isinstance(made_of, dict)):
        return False
    try:
        now = source.facts() if files is None else source.placed(files)
        if now == made_of:
            return True
        elsewhere = facts_of(Path(path) for path in made_of if path not in now)
    except OSError:
        return False
    return now | elsewhere == made_of


def run_fleet(plan: Plan, workers: Workers) -> Iterator[Step]:
    """Work on what is to be done; yield a step for each campaign that is finished.

    Raises
    ------
    ConfigError, HardwareError
        The store cannot be written; see `wheelsoil.fleet.engines.on_dask`. What is finished is in the store.
    """
    plan.store.remove_drafts()
    begin_s, failed = time.monotonic(), 0
    todo = {source.name for source in plan.todo}
    withdrawn = {damage.manifest for damage in plan.damaged if damage.campaign in todo}
    plan.store.withdraw(name for name in withdrawn if name.startswith(DONE))
    task = partial(work_on, url=plan.store.url, options=plan.options, cached=folder() is not None)
    for finished, (item, result) in enumerate(_results(task, plan, workers), 1):
        source = item.source
        done = _given_up(plan, item, result) if isinstance(result, Lost) else result
        manifest = done.manifest
        failed += manifest.state == "failed"
        left = len(plan.todo) - finished
        yield Step(
            name=source.name,
            state=manifest.state,
            outcome="; ".join(filter(None, (verdict_with_causes(manifest), manifest.fault))) or "was there already",
            finished=finished,
            failed=failed,
            total=len(plan.todo),
            cpu_s=manifest.cpu_s,
            peak_bytes=manifest.peak_bytes,
            left_s=(time.monotonic() - begin_s) / finished * left,
        )
    plan.store.remove_drafts()


def _results(task: partial[Done], plan: Plan, workers: Workers) -> Iterator[tuple[Task, Done | Lost]]:
    if not plan.todo:
        return iter(())
    items = plan.tasks
    if workers.engine == "local":
        return in_processes(task, items, min(workers.count, len(items)), workers.memory)
    keys = [f"campaign-{content_of(source, plan.store.url, plan.options)}" for source in plan.todo]
    return on_dask(task, items, keys, workers.scheduler, workers.count, workers.memory)


def _given_up(plan: Plan, item: Task, lost: Lost) -> Done:
    """Write down that a campaign was lost; without facts of its files, so that the next call tries it again."""
    source = item.source
    content = content_of(source, "lost", plan.options)
    tables = tables_of([Found(source, fault=lost.why, state="failed")], content)
    rows = {name: len(table) for name, table in tables.items()}
    manifest = Manifest(source.name, content, "failed", lost.why, rows=rows, options=asdict(plan.options))
    plan.store.put(manifest, tables, item.older)
    return Done(manifest)
