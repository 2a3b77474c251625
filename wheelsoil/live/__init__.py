"""The logger's status page: a process of its own that a phone's browser looks at; see docs/status-page.md."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
