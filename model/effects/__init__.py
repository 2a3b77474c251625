"""The library of effects, by kind; `EFFECTS` lists them by their short name.

Installed packages add theirs by an entry point (`model.effects.catalogue`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
