"""Channels of one run -> a `ProcessedRun`: time base, filters, latency, slip, segments, quality."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
