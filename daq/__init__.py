"""Frames in, recordings out, recordings back in. Knows no slip and no soil."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
