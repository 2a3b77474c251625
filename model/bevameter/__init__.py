"""Terrain parameters from bevameter tests (the paper's Tab. 1): plates give k_c, k_phi, n; shear tests c, phi, K.

Source: Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (1980), J. Terramechanics 17(1).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
