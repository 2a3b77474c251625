"""The rows that were looked at, for figures and for saying where the simulation is off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.bench_evidence import Posterior
from model.diagnosis.bench_problem import FIELDS, BenchProblem
from model.diagnosis.bench_weigh import Weighed, Weighing
from model.diagnosis.channel_words import FIELDS as CHANNEL_FIELDS
from model.diagnosis.result import Finding, Seen

FloatArray = NDArray[np.float64]

_SIGNIFICANT = 2.5


def seen_of(weighing: Weighing, chosen: Weighed, keys: Sequence[str]) -> tuple[Seen, ...]:
    """Return every bench's rows with what the simulation and its extensions say.

    Parameters
    ----------
    weighing : Weighing
    chosen : Weighed
        The extension; it and no cause at all have a posterior.
    keys : sequence of str
        Candidates whose signatures are wanted.
    """
    problem = weighing.problem
    null, best = weighing.of_set(()), chosen
    base, extended = mean_of(null.posterior), mean_of(best.posterior)
    members = {key: _alone(weighing, key) for key in keys}
    sigma = _sigmas(problem, extended)
    found = []
    for i, bench in enumerate(problem.benches):
        rows = problem.bench == i
        channels = [c for c in FIELDS if np.isfinite(problem.measured(c)[rows]).any()]
        nothing = np.full(int(rows.sum()), np.nan)
        found.append(
            Seen(
                campaign=bench.name,
                runs=bench.rows.names,
                run=bench.rows.run,
                time_s=bench.rows.time_s,
                slip=bench.rows.slip,
                ground_speed_mps=nothing,
                vertical_load_n=bench.rows.vertical_load_n,
                line_position=nothing,
                measured={c: problem.measured(c)[rows] for c in channels},
                base={c: base[c][rows] for c in channels},
                extended={c: extended[c][rows] for c in channels},
                base_sigma={c: np.full(int(rows.sum()), sigma.get(c, np.nan)) for c in channels},
                signatures={
                    key: {c: (said[c] - null.optima[0].said[c])[rows] for c in channels if c in problem.channels}
                    for key, said in members.items()
                },
                implied={key: {c: said[c][rows] for c in FIELDS} for key, said in members.items()},
                unseen=tuple(c for c in channels if c not in problem.channels),
            )
        )
    return tuple(found)


def findings_of(weighing: Weighing) -> tuple[Finding, ...]:
    """Return where the simulation with its re-calibrated soil is off, worst first."""
    problem, null = weighing.problem, weighing.of_set(())
    said = mean_of(null.posterior)
    found = []
    for noise, rows in zip(problem.noises, problem.rows, strict=True):
        error = noise.measured - said[noise.channel][rows]
        scatter = float(np.median(noise.scatter))
        for group in np.unique(noise.groups):
            own = noise.groups == group
            size = float(error[own].mean())
            statistic = size / float(np.hypot(scatter / np.sqrt(own.sum()), noise.form_scale))
            if abs(statistic) > _SIGNIFICANT:
                where = _where(problem, rows[own])
                found.append(Finding(CHANNEL_FIELDS[noise.channel], where, size, statistic, of_rows=True))
    return tuple(sorted(found, key=lambda f: -abs(f.statistic)))


def _where(problem: BenchProblem, rows: NDArray[np.intp]) -> str:
    slip, load = problem.slip[rows], problem.load_n[rows]
    bench = f"{problem.benches[problem.bench[rows[0]]].name}, " if len(problem.benches) > 1 else ""
    manner = "driving" if slip.mean() >= 0 else "braking"
    return f"{bench}slip {slip.mean():.2f}, load {load.mean():.3g} N, {manner} ({len(rows)} rows)"


def mean_of(posterior: Posterior | None) -> dict[str, FloatArray]:
    """Return what a set says on average over its posterior: channel -> array, shape (n,)."""
    assert posterior is not None
    return {channel: posterior.weights @ values for channel, values in posterior.said.items()}


def _alone(weighing: Weighing, key: str) -> dict[str, FloatArray]:
    """Return what a cause says as if it were the one: its own set, alone."""
    own = next(w for w in weighing.sets if [use.key for use in w.hypothesis] == [key])
    return own.optima[0].said if own.posterior is None else mean_of(own.posterior)


def _sigmas(problem: BenchProblem, said: dict[str, FloatArray]) -> dict[str, float]:
    """Return the one-sigma of a row, of each channel, where `said` is right."""
    return {channel: float(np.hypot(*noise)) for channel, noise in noise_of(problem, said).items()}


def noise_of(problem: BenchProblem, said: dict[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Return scatter of repeats and error of form of each channel, given what a model says."""
    found = {}
    for noise, rows in zip(problem.noises, problem.rows, strict=True):
        scatter, form = noise.means(noise.node_shares(noise.measured - said[noise.channel][rows]))
        found[noise.channel] = (float(scatter), float(form))
    return found
