"""Many campaigns: worked on by many processes, kept in a store, and asked together."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
