"""Fits of the wheel-soil model to runs: Gauss-Newton, intervals, criteria M0, R0 and R2."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
