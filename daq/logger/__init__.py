"""The field logger: from open buses to closed files.

Every bus has a thread that only fetches frames and puts them into one queue, which has a limit in bytes. The main
thread writes. Another thread inspects: it decodes the written frames, evaluates their health and updates the page.
When the machine is too slow, load is shed in this order:

1. the panel: a snapshot that it does not take at once is dropped;
2. the inspection (decoded topics, health, traces): while the queue is more than a quarter full, or the inspection is
   still busy with the frames before, frames are recorded and not inspected. They are counted and reported;
3. raw frames, last: when the queue is full the readers wait, then the kernel's receive buffers fill, and then the
   kernel counts what it loses. Nothing is ever thrown away by the logger itself while it can write.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
