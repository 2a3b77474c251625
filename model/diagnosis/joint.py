"""Several campaigns looked at together: shared causes, a soil and a catch-all of its own for each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.columns import Columns
from model.diagnosis.grams import CauseColumn, Grams
from model.diagnosis.whitening import RunGrams

FloatArray = NDArray[np.float64]


def joined(parts: Sequence[tuple[str, tuple[str, ...], Columns, RunGrams]]) -> Grams:
    """Put the Gram matrices of several campaigns into one.

    Parameters
    ----------
    parts : sequence of (campaign's name, run names, Columns, RunGrams)
        A cause that one campaign cannot show has a column of zeros there. A scale that goes with the wheel is that of
        the first campaign that has the cause.
    """
    causes: dict[tuple[str, str], CauseColumn] = {}
    for _, _, columns, _ in parts:
        for cause in columns.causes:
            causes.setdefault((cause.key, cause.parameter), cause)
    several = len(parts) > 1
    soil = [_labelled(name, label, several) for name, _, c, _ in parts for label in c.soil]
    basis = [_labelled(name, label, several) for name, _, c, _ in parts for label in c.basis]
    names = [_labelled(name, run, several) for name, runs, _, _ in parts for run in runs]
    width = 1 + len(soil) + len(causes) + len(basis)
    index = {key: 1 + len(soil) + i for i, key in enumerate(causes)}
    matrices = []
    soil_at, basis_at = 1, 1 + len(soil) + len(causes)
    for _, _, columns, grams in parts:
        turn = np.zeros((columns.shared, width))
        turn[0, 0] = 1.0
        q, k, b = len(columns.soil), len(columns.causes), len(columns.basis)
        turn[1 : 1 + q, soil_at : soil_at + q] = np.eye(q)
        for i, cause in enumerate(columns.causes):
            key = (cause.key, cause.parameter)
            turn[1 + q + i, index[key]] = causes[key].scale / cause.scale
        turn[1 + q + k :, basis_at : basis_at + b] = np.eye(b)
        soil_at, basis_at = soil_at + q, basis_at + b
        matrices.append(turn.T @ grams.matrices @ turn)
    return Grams(
        matrices=np.concatenate(matrices),
        log_determinants=np.concatenate([g.log_determinants for *_, g in parts]),
        samples=np.concatenate([g.samples for *_, g in parts]),
        run_names=tuple(names),
        soil=tuple(soil),
        causes=tuple(causes.values()),
        basis=tuple(basis),
    )


def _labelled(campaign: str, label: str, several: bool) -> str:
    """Put the campaign's name into a label, behind the channel of a catch-all column."""
    if not several:
        return label
    channel, bar, where = label.partition("|")
    return f"{channel}|{campaign}: {where}" if bar else f"{campaign}: {label}"
