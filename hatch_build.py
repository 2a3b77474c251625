"""Build hook: compile model/compiled.c where there is a C compiler; without one numpy computes, more slowly.

``CC`` names the compiler (default: cc), as ``zig cc -target aarch64-linux-gnu.2.17`` may; ``WHEELSOIL_WHEEL_PLATFORM``
the platform of the wheel, where it is not this one (make wheels).
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLATFORM = "WHEELSOIL_WHEEL_PLATFORM"
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
LIMIT_S = 120.0


class CompiledCore(BuildHookInterface):  # type: ignore[misc,type-arg]
    """Put the compiled core into the package, in the source tree for an editable installation."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and make the wheel one of this platform; a failure is a warning."""
        platform = os.environ.get(PLATFORM) or _platform()
        source = Path(self.root) / "model" / "compiled.c"
        library = source.with_name(f"_compiled{_suffix(platform)}")
        for old in source.parent.glob("_compiled.*"):
            old.unlink()
        if (failure := compiled(source, library)) is not None:
            self.app.display_warning(f"without the compiled core (numpy computes, more slowly): {failure}")
            if os.environ.get(PLATFORM):
                raise RuntimeError(failure)
            return
        if version != "editable":
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{platform}"
            build_data["artifacts"].append(f"model/{library.name}")


def compiled(source: Path, library: Path) -> str | None:
    """Compile the core; return why that failed."""
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]) is None:
        return f"no C compiler {command[0]!r}"
    built_from = hashlib.sha256(source.read_bytes().replace(b"\r\n", b"\n")).hexdigest()[:16]
    new = library.with_name(f"{library.name}.{os.getpid()}")
    position = () if library.suffix == ".dll" else ("-fPIC",)
    command += [*FLAGS, *position, f'-DSOURCE_HASH="{built_from}"', "-o", str(new), str(source)]
    command += [] if library.suffix == ".dll" else ["-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=LIMIT_S)
        if done.returncode or not new.exists():
            return f"{command[0]} ended with {done.returncode}: {done.stderr.strip()[-300:]}"
        new.replace(library)  # a process that has loaded the old one keeps it
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    finally:
        new.unlink(missing_ok=True)
    return None


def _suffix(platform: str) -> str:
    return ".dll" if platform.startswith("win") else ".dylib" if platform.startswith("macosx") else ".so"


def _platform() -> str:
    """Return the platform of this interpreter in the words of a wheel."""
    if sys.platform == "linux":
        import sysconfig

        return sysconfig.get_platform().replace("-", "_").replace(".", "_")
    from packaging.tags import sys_tags

    return next(iter(sys_tags())).platform
