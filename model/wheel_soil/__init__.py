"""Wong's wheel-soil model: soils, stresses, contact patch, balance, exact derivatives."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
