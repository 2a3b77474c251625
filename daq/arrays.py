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
    """Return columns as a frame whose ``attrs["units"]`` maps a column to its unit.

    Parameters
    ----------
    columns : mapping str -> array or sequence, shape (n,)
    units : mapping str -> str, optional
        A column without one has none.

    Returns
    -------
    pandas.DataFrame
        Shape (n, len(columns)), with columns in the order of `columns`.
    """
    import pandas as pd

    frame = pd.DataFrame(dict(columns))
    frame.attrs["units"] = {name: unit for name, unit in (units or {}).items() if unit}
    return frame


def frame_of_rows(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> pd.DataFrame:
    """Return rows as a frame that has its columns even without a row.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    rows : sequence of sequences, each of the length of `names`

    Returns
    -------
    pandas.DataFrame
        Shape (len(rows), len(names)).
    """
    import pandas as pd

    return pd.DataFrame(list(rows), columns=list(names))
