"""The life of a logger, from the open buses to the closed files.

Every bus has a thread that does nothing but fetch frames; they meet in a queue with a limit in bytes, and one thread,
the main one, writes. Another one inspects: it decodes what was written, judges it and feeds the page. When the
machine is too slow for all of it, this gives way, in this order:

1. the panel: a snapshot that it does not take at once is dropped;
2. the inspection (decoded topics, health, traces): while the queue is more than a quarter full, or the inspection is
   still at work on what it was given, frames are recorded and not inspected. It is counted and told;
3. raw frames, last: when the queue is full the readers wait, then the kernel's receive buffers fill, and then the
   kernel counts what it loses. Nothing is ever thrown away by the logger itself while it can write.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
