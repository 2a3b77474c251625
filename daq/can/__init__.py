"""CAN frames and what they mean: bits, messages, DBC files, decoding and encoding in whole columns, roles."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
