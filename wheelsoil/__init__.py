"""wheelsoil: from CAN frames to a wheel-soil model that says what it gets wrong."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from wheelsoil.jupyter import register

__version__ = "0.1.0"

_ROOMS = ("daq", "processing", "model")


def _check_rooms() -> None:
    """Refuse to start when a user's own module hides one of our packages.

    Raises
    ------
    ImportError
        Names the file that hides the package and how to get past it.
    """
    home = Path(__file__).resolve().parent.parent
    for room in _ROOMS:
        spec = importlib.util.find_spec(room)
        origin = Path(spec.origin).resolve() if spec and spec.origin else None
        if origin != home / room / "__init__.py":
            raise ImportError(
                f"wheelsoil's package {room!r} is hidden by {origin or 'nothing: it is not installed'}\n"
                f"  expected: {home / room / '__init__.py'}\n"
                f"  next: rename your file, start Python in another folder, or use the `wheelsoil` command"
            )


_check_rooms()
register()
