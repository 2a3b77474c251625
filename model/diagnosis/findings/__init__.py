"""What the evidence of driven runs says: fits of sets of causes, held-out runs, adequacy, isolability, proposals."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
