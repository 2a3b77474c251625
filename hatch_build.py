"""Build hook: compile model/compiled.c where there is a C compiler; without one numpy computes, more slowly.

``WHEELSOIL_WHEEL_PLATFORM`` names the platform of a wheel that ``CC`` compiles for (make wheels); then a failure ends
the build.
"""

from __future__ import annotations

import os
import runpy
import shutil
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLATFORM = "WHEELSOIL_WHEEL_PLATFORM"


class CompiledCore(BuildHookInterface):  # type: ignore[misc,type-arg]
    """Put the compiled core into the wheel, or into the source tree that an editable installation uses."""

    PLUGIN_NAME = "custom"
    _folder: str | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and make the wheel one of its platform; a failure is a warning."""
        build = runpy.run_path(str(Path(self.root) / "model" / "core_build.py"))
        demanded = os.environ.get(PLATFORM)
        platform = demanded or sysconfig.get_platform().replace("-", "_").replace(".", "_")
        library: Path = build["library_path"](platform)
        if version != "editable":
            self._folder = tempfile.mkdtemp()
            library = Path(self._folder) / library.name
        failure = build["compile_core"](library)
        if failure is not None:
            if demanded:
                raise RuntimeError(failure)
            self.app.display_warning(f"numpy computes, more slowly than the compiled core: {failure}")
        elif version != "editable":
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{platform}"
            build_data["force_include"][str(library)] = f"model/{library.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was compiled for the wheel."""
        if self._folder is not None:
            shutil.rmtree(self._folder)
