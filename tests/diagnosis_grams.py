"""Gram matrices of made-up runs, for tests of everything that is built on them."""

from __future__ import annotations

import numpy as np

from model.diagnosis.time_series.columns import CauseColumn, Grams

Columns = dict[str, tuple[str, bool]]
"""Key -> (family, one-sided); a key "family.parameter" shares the effect with others of that beginning."""

FOUR: Columns = {
    "vasilev": ("slip_sinkage", True),
    "lyasko": ("slip_sinkage", True),
    "slope": ("slope", False),
    "torque_zero": ("torque_zero", False),
}


def cause(key: str, family: str, one_sided: bool) -> CauseColumn:
    lower = 0.0 if one_sided else -np.inf
    return CauseColumn(key, family, "size", "1", 0.5, 0.0, 0.0, lower, np.inf, one_sided)  # a coefficient of 1 is 0.5


def columns_of_runs(
    rng: np.random.Generator, runs: int = 6, samples: int = 80, soil: int = 3, causes: int = 4, basis: int = 2
) -> np.ndarray:
    """Return whitened [soil | causes | basis] columns, shape (runs, samples, q + k + b)."""
    return rng.normal(size=(runs, samples, soil + causes + basis)) * 0.4


def grams_of(columns: np.ndarray, residual: np.ndarray, soil: int = 3, named: Columns = FOUR) -> Grams:
    """Return the Grams of whitened columns and a whitened residual, shape (runs, samples)."""
    rows = np.concatenate([residual[:, :, None], columns], axis=2)
    runs, samples, width = rows.shape
    basis = width - 1 - soil - len(named)
    return Grams(
        matrices=np.einsum("rni,rnj->rij", rows, rows),
        log_determinants=np.zeros(runs),
        samples=np.full(runs, samples),
        run_names=tuple(f"run-{i + 1}" for i in range(runs)),
        soil=tuple(f"soil {i}" for i in range(soil)),
        causes=tuple(cause(key, *what) for key, what in named.items()),
        basis=tuple(f"dp|hat {i}" for i in range(basis)),
    )
