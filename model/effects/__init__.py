"""The library of effects: one hypothesis a file; `EFFECTS` lists them by their short name.

Installed packages add theirs by an entry point (`model.effects.library`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
