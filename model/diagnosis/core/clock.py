"""How long the stages of a diagnosis take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

from model.progress import note_share

OF_RUNS = {
    "linearise": 0.01,
    "noise": 0.15,
    "adequacy": 0.45,
    "held_out": 0.5,
    "final": 0.65,
    "next_run": 0.85,
    "figures": 0.95,
}
"""What of the time of a campaign's diagnosis has passed when a stage begins: typical of 2 to 12 runs, 3 to 13 s."""
OF_TABLES = {"evidence": 0.01, "held_out": 0.3, "verdict": 0.45, "error_of_form": 0.7}
"""The same of tables, typical of 5 to 14 s."""


@dataclass
class Clock:
    """Seconds by stage; `shares` says which stages tell whoever watches how far the diagnosis is."""

    stages_s: dict[str, float] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=lambda: OF_RUNS)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside for a stage."""
        if name in self.shares:
            note_share(self.shares[name])
        start = perf_counter()
        yield
        self.stages_s[name] = self.stages_s.get(name, 0.0) + perf_counter() - start
