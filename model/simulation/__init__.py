"""The virtual test: a simulated instrumented vehicle on a soil, any effect switched on; channels out, no I/O.

Kinematics (V, slip) are prescribed, forces on the wheel come from the wheel-soil model at the true slip and load.
Truth and fitter differ in rate and quadrature, so that recovering a parameter means something.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
