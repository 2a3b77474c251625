"""Pytest plugin of the runner: the first example that fails ends a test, and so does a mutant that never ends."""

from __future__ import annotations

import os
import resource

from hypothesis import Phase, settings
from mutants.mutant import CPU_SECONDS

settings.register_profile("mutants", phases=(Phase.explicit, Phase.generate), database=None)
settings.load_profile("mutants")
if CPU_SECONDS in os.environ:
    limit = int(os.environ[CPU_SECONDS])
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
