"""Several campaigns together: what goes with a transducer, what with a soil, and which campaign disagrees."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
