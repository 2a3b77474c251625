"""Times as people read them."""

from __future__ import annotations

import numpy as np


def utc(time_ns: int) -> str:
    """Return UTC nanoseconds as ISO 8601 with milliseconds."""
    return f"{np.datetime64(time_ns, 'ns').astype('datetime64[ms]')}Z"
