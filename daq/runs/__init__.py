"""Recordings, logs and campaign folders -> runs: opened in one place for commands, notebooks and tests."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
