"""Processed runs to parameters, causes and gains. No I/O, no plotting."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
