"""Which tests run one after the other on one worker, and which begin first.

A file is a group: its fixtures are made once. So are the files that share a server or a guest. The groups of
pytest-xdist itself go by a mark that pytest 9.2 no longer lets it pass on.
"""

from __future__ import annotations

from pathlib import PurePosixPath

from xdist.scheduler import LoadScopeScheduling

_FIRST = ("vcan", "wheelsoil")
"""Folders whose tests wait much: others fill their gaps."""
_TOGETHER = {
    "test_view_page_axes.py": "view",
    "test_view_page_plots.py": "view",
    "test_view_page_state.py": "view",
    "test_view_page_away.py": "view",
    "test_view_page_model.py": "view",
    "test_view_page_slow_server.py": "view",
}


class GroupScheduling(LoadScopeScheduling):
    """Hands a group to a worker at a time."""

    def _split_scope(self, nodeid: str) -> str:
        file = PurePosixPath(nodeid.split("::")[0])
        return "vcan" if file.parent.name == "vcan" else _TOGETHER.get(file.name, str(file))


def rank(folder: str) -> int:
    """Return when the tests of a folder begin."""
    return _FIRST.index(folder) if folder in _FIRST else len(_FIRST)
