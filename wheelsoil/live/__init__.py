"""The logger's status page for the browser of a phone, in a separate process; see docs/status-page.md."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
