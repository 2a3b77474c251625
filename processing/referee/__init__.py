"""Whether a run is physically possible as declared, and which mistake of a unit, a sign or a name would make it so."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
