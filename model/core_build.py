"""Compile model/compiled.c into a library beside it: ``python model/core_build.py``; the build of the package does so.

``CC`` names the compiler and its first arguments (default: cc). Nothing but the standard library is imported here: the
package is not installed yet.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

FLAGS = (
    "-std=c99",
    "-O2",
    "-ftree-vectorize",
    "-fno-math-errno",
    "-ffp-contract=off",
    "-fvisibility=hidden",
    "-shared",
)
"""Without -ffast-math, and without fused operations: the numbers are those of numpy."""
LIMIT_S = 900.0
"""For a cross compiler that first builds the libraries of its target; a C compiler takes two seconds."""
SOURCE = Path(__file__).with_name("compiled.c")
SUFFIXES = {"win": ".dll", "macosx": ".dylib", "darwin": ".dylib"}


def library_path(platform: str = sys.platform) -> Path:
    """Return where the library is, for a platform as Python or a wheel calls it."""
    suffix = next((s for name, s in SUFFIXES.items() if platform.startswith(name)), ".so")
    return SOURCE.with_name(f"_compiled{suffix}")


def source_hash(source: Path = SOURCE) -> str:
    """Return what identifies a source; line ends do not count."""
    return hashlib.sha256(source.read_bytes().replace(b"\r\n", b"\n")).hexdigest()[:16]


def compile_core(library: Path, more: Sequence[str] = ()) -> str | None:
    """Compile the core, with more arguments for the compiler; return why that failed."""
    import shlex
    import shutil
    import subprocess

    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]) is None:
        return f"no C compiler {command[0]!r}"
    new = library.with_name(f"{library.name}.{os.getpid()}")
    command += [*FLAGS, *more, f'-DSOURCE_HASH="{source_hash()}"', "-o", str(new), str(SOURCE)]
    command += [] if library.suffix == ".dll" else ["-fPIC", "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=LIMIT_S, check=False)
        if done.returncode or not new.exists():
            return f"{command[0]} ended with {done.returncode}: {done.stderr.strip()[-300:]}"
        new.replace(library)  # a process that has loaded the old one keeps it
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    finally:
        new.unlink(missing_ok=True)
    return None


if __name__ == "__main__":
    sys.exit(compile_core(library_path()))
