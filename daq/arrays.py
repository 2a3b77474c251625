"""Types of the arrays that every room hands on, and columns with units as a pandas DataFrame.

pandas is imported when a frame is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
Column = NDArray[Any] | Sequence[Any]


def data_frame(columns: Mapping[str, Column], units: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Return columns of shape (n,) as a frame whose ``attrs["units"]`` maps a column to its unit, if it has one."""
    import pandas as pd

    frame = pd.DataFrame(dict(columns))
    frame.attrs["units"] = {name: unit for name, unit in (units or {}).items() if unit}
    return frame


def frame_of_rows(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> pd.DataFrame:
    """Return rows as a frame of shape (len(rows), len(names)) that has its columns even without a row."""
    import pandas as pd

    return pd.DataFrame(list(rows), columns=list(names))
