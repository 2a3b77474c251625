"""The analyst's page: a campaign's recordings in a browser on this machine; see docs/view.md."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
