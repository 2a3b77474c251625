"""Readers of tables in turns, with the peers: ``python -m benchmarks.series_peers ROUNDS CSV PARQUET``.

Prints, by format, the processor times of each reader as JSON.
"""

from __future__ import annotations

import json
import sys
from functools import partial
from pathlib import Path

import duckdb
import numpy as np
import polars

from benchmarks.timing import side_by_side
from daq.series import read_series


def main(rounds: int, csv: Path, parquet: Path) -> dict[str, dict[str, list[float]]]:
    """Return the processor times of every reader on both files."""
    return {
        path.suffix[1:]: side_by_side(
            {
                "ours": partial(_ours, path),
                "polars": partial(_polars, path),
                "duckdb": partial(_duckdb, path),
            },
            rounds,
        )
        for path in (csv, parquet)
    }


def _ours(path: Path) -> int:
    return sum(len(block) for blocks in read_series(path).blocks() for block in blocks)


def _polars(path: Path) -> int:
    table = polars.read_csv(path) if path.suffix == ".csv" else polars.read_parquet(path)
    return min(len(np.asarray(column.to_numpy())) for column in table.iter_columns())


def _duckdb(path: Path) -> int:
    read = duckdb.read_csv if path.suffix == ".csv" else duckdb.read_parquet
    return min(len(column) for column in read(str(path)).fetchnumpy().values())


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]))))
