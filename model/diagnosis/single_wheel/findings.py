"""Findings in single-wheel tables: parameters and soils by the posterior of all sets that hold them, residuals, notes.

Detectable sizes are those that the rows show, linearised at the laboratory's soil.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from daq import OUTPUTS, FloatArray, IndexArray, Note, Severity
from model.diagnosis.core.bayes_factors import Direction, minimum_detectable
from model.diagnosis.core.plot_data import PlotData
from model.diagnosis.core.result import Detectable, Finding, ParameterEstimate, SoilEstimate
from model.diagnosis.core.shapes import Rows
from model.diagnosis.single_wheel.evidence import SetPosterior, posterior_of
from model.diagnosis.single_wheel.noise import scatter_of_repeats
from model.diagnosis.single_wheel.problem import BenchProblem, CauseUse
from model.diagnosis.single_wheel.search import Optimum
from model.diagnosis.single_wheel.sets import Library, SkidLaw, listed_uses
from model.diagnosis.single_wheel.weighing import Weighed, Weighing, with_usual_form
from model.effects.catalogue import EFFECTS
from model.notes import DiagnosisCode

_SIGNIFICANT = 2.5

_COUNTED = 3.0
"""Nats below the most probable set that holds a cause within which another one counts for its parameters."""
_MOST = 12

MUCH_SCATTER = 0.05
"""Of the load, from which on repeats are hardly repeats."""
_USUAL_LOAD_N = 10_000.0


def plot_data_of(weighing: Weighing, chosen: Weighed, keys: Sequence[str]) -> tuple[PlotData, ...]:
    """Return every table's rows with what the simulation and its extensions say.

    `chosen` is the extension; it and no cause at all have a posterior. The keys are of candidates whose signatures are
    wanted.
    """
    problem = weighing.problem
    null, best = weighing.of_set(()), chosen
    base, extended = mean_of(null.posterior), mean_of(best.posterior)
    members = {key: _alone(weighing, key) for key in keys}
    sigma = _sigmas(problem, extended)
    found = []
    for i, table in enumerate(problem.tables):
        rows = problem.table == i
        channels = [c for c in OUTPUTS if np.isfinite(problem.measured(c)[rows]).any()]
        nothing = np.full(int(rows.sum()), np.nan)
        found.append(
            PlotData(
                campaign=table.name,
                runs=table.rows.names,
                run=table.rows.run,
                time_s=table.rows.time_s,
                since_first_run_s=nothing,
                campaign_time=nothing,
                slip=table.rows.slip,
                ground_speed_mps=nothing,
                vertical_load_n=table.rows.vertical_load_n,
                line_position=nothing,
                measured={c: problem.measured(c)[rows] for c in channels},
                base={c: base[c][rows] for c in channels},
                extended={c: extended[c][rows] for c in channels},
                base_sigma={c: np.full(int(rows.sum()), sigma.get(c, np.nan)) for c in channels},
                signatures={
                    key: {
                        c: (predicted[c] - null.optima[0].predicted[c])[rows] for c in channels if c in problem.channels
                    }
                    for key, predicted in members.items()
                },
                implied={key: {c: predicted[c][rows] for c in OUTPUTS} for key, predicted in members.items()},
                unused_channels=tuple(c for c in channels if c not in problem.channels),
            )
        )
    return tuple(found)


def findings_of(weighing: Weighing, chosen: Weighed | None = None) -> tuple[Finding, ...]:
    """Return where the simulation with its re-calibrated soil, or with a set of causes, is off, worst first."""
    problem, least = weighing.problem, _SIGNIFICANT if chosen is None else 0.0
    predicted = mean_of(weighing.of_set(()).posterior) if chosen is None else chosen.optima[0].predicted
    found = []
    for noise, rows in zip(problem.noises, problem.rows, strict=True):
        error = noise.measured - predicted[noise.channel][rows]
        scatter = float(np.median(noise.scatter))
        for group in np.unique(noise.groups):
            own = noise.groups == group
            size = float(error[own].mean())
            statistic = size / float(np.hypot(scatter / np.sqrt(own.sum()), noise.form_scale))
            if abs(statistic) > least:
                found.append(Finding(OUTPUTS[noise.channel].role, _place(problem, rows[own]), size, statistic))
    return tuple(sorted(found, key=lambda f: -abs(f.statistic)))


def _place(problem: BenchProblem, rows: IndexArray) -> Rows:
    slip, load = problem.slip[rows], problem.load_n[rows]
    table = problem.tables[problem.table[rows[0]]].name if len(problem.tables) > 1 else ""
    return Rows(float(slip.mean()), float(load.mean()), len(rows), table)


def mean_of(posterior: SetPosterior | None) -> dict[str, FloatArray]:
    """Return what a set says on average over its posterior: channel -> array, shape (n,)."""
    assert posterior is not None
    return {channel: posterior.weights @ values for channel, values in posterior.predicted.items()}


def _alone(weighing: Weighing, key: str) -> dict[str, FloatArray]:
    """Return what a cause says as if it were the one: its own set, alone."""
    own = next(w for w in weighing.sets if [use.key for use in w.hypothesis] == [key])
    return own.optima[0].predicted if own.posterior is None else mean_of(own.posterior)


def _sigmas(problem: BenchProblem, predicted: dict[str, FloatArray]) -> dict[str, float]:
    """Return the one-sigma of a row, of each channel, where `predicted` is right."""
    return {channel: float(np.hypot(*noise)) for channel, noise in noise_of(problem, predicted).items()}


def noise_of(problem: BenchProblem, predicted: dict[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Return scatter of repeats and error of form of each channel, given what a model says."""
    found = {}
    for noise, rows in zip(problem.noises, problem.rows, strict=True):
        scatter, form = noise.means(noise.node_shares(noise.measured - predicted[noise.channel][rows]))
        found[noise.channel] = (float(scatter), float(form))
    return found


def detectable_in_rows(problem: BenchProblem, library: Library, null: Optimum, name_at: float) -> dict[str, Detectable]:
    """Return the smallest size of every cause that these rows show; see `model.diagnosis.core.bayes_factors`.

    `null` is the optimum of no cause; from the probability `name_at` on a family is named.
    """
    directions = {
        use.key: [
            Direction(c.name, c.unit, c.neutral, c.side * c.scale, p.one_sided, _information(problem, null, use, i))
            for i, (c, p) in enumerate(zip(problem.coordinates(use), EFFECTS[use.key].parameters, strict=True))
        ]
        for use in library.uses
    }
    return minimum_detectable(listed_uses(library.uses, 1), directions, name_at)


def _information(problem: BenchProblem, null: Optimum, use: CauseUse, which: int) -> float:
    """Return the information on a parameter, in prior scales, with the soil projected out; 0 without an answer."""
    size = len(EFFECTS[use.key].parameters)
    soil = problem.soil_offsets[-1]
    standard = np.zeros((1, soil + size))
    standard[0, :soil] = null.standard[:soil]
    coordinates = problem.coordinates(use)
    for i, coordinate in enumerate(coordinates):
        value = coordinate.neutral + (0.5 * coordinate.side * coordinate.scale if i == which else 0.0)
        standard[0, soil + i] = coordinate.standard(value)
    predicted, _ = problem.evaluate([(use,)], standard)
    fixed = with_usual_form(problem)
    change, slopes, precision = [], [], []
    for noise, rows in zip(fixed.noises, fixed.rows, strict=True):
        change.append((predicted[noise.channel][0, rows] - null.predicted[noise.channel][rows]) / 0.5)
        slopes.append(null.slopes[noise.channel][rows, :soil])
        precision.append(noise.precision(np.ones(1)))
    information = sum(float(c @ p @ c) for c, p in zip(change, precision, strict=True))
    if not np.isfinite(information) or information <= 0:
        return 0.0
    cross = sum(s.T @ p @ c for s, p, c in zip(slopes, precision, change, strict=True))
    inner = np.eye(soil) + sum(s.T @ p @ s for s, p in zip(slopes, precision, strict=True))
    return max(information - float(cross @ np.linalg.solve(inner, cross)), 0.0)


@dataclass(frozen=True)
class Draws:
    """Weighted values of one quantity, shape (m,) each."""

    values: FloatArray
    weights: FloatArray

    def estimate(self, name: str, unit: str) -> ParameterEstimate:
        """Return the mean with the 95 % interval between quantiles."""
        mean = float(self.weights @ self.values)
        sigma = float(np.sqrt(self.weights @ (self.values - mean) ** 2))
        order = np.argsort(self.values)
        steps = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
        low, high = np.interp([0.025, 0.975], steps, self.values[order])
        return ParameterEstimate(name, unit, mean, (float(low), float(high)), sigma)


def estimates_of(weighing: Weighing, use: CauseUse, rng: np.random.Generator) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of a cause, over all sets that hold it."""
    effect = EFFECTS[use.key]
    draws = parameter_draws(weighing, use, rng)
    found = [draws[p.name].estimate(p.name, p.unit) for p in effect.parameters]
    if effect.total:
        each = [draws[p.name] for p in effect.parameters]
        total = Draws(np.sum([d.values for d in each], axis=0), each[0].weights)
        found.insert(0, total.estimate(effect.total, effect.parameters[0].unit))
    return tuple(found)


def parameter_draws(weighing: Weighing, use: CauseUse, rng: np.random.Generator) -> dict[str, Draws]:
    """Return weighted values of every parameter of a cause, over the most probable sets that hold it."""
    gated = [w for w in weighing.sets if use in w.hypothesis and weighing.adequate(w)]
    ranked = sorted(gated or [w for w in weighing.sets if use in w.hypothesis], key=lambda w: -w.score)
    counted = [w for w in ranked if w.posterior or w.score > ranked[0].score - _COUNTED][:_MOST]
    holding = [(float(np.exp(w.score - ranked[0].score)), with_posterior(weighing, w, rng)) for w in counted]
    problem = weighing.problem
    values: dict[str, list[FloatArray]] = {}
    weights = []
    for p, weighed in holding:
        assert weighed.posterior is not None
        standard = weighed.posterior.standard[:, problem.positions(weighed.hypothesis)[use]]
        for column, coordinate in zip(standard.T, problem.coordinates(use), strict=True):
            values.setdefault(coordinate.name, []).append(coordinate.values(column)[0])
        weights.append(p * weighed.posterior.weights)
    share = np.concatenate(weights)
    return {name: Draws(np.concatenate(parts), share / share.sum()) for name, parts in values.items()}


def with_posterior(weighing: Weighing, weighed: Weighed, rng: np.random.Generator) -> Weighed:
    """Return a set with its posterior, computed where the evidence did not need it."""
    if weighed.posterior is not None:
        return weighed
    return replace(weighed, posterior=posterior_of(weighing.problem, weighed.optima, rng))


def soils_of(weighing: Weighing, weighed: Weighed) -> tuple[SoilEstimate, ...]:
    """Return the soils that a set of causes leaves; the set has a posterior."""
    problem, posterior = weighing.problem, weighed.posterior
    assert posterior is not None
    found = []
    for i, soil in enumerate(problem.soils):
        table = problem.tables[problem.soil_of.index(i)]
        start, stop = problem.soil_offsets[i : i + 2]
        values, _ = soil.values(posterior.standard[:, start:stop])
        natural = soil.soil_parameters(values, table.wheel.width_m)
        draws = {name: Draws(column, posterior.weights).estimate(name, "") for name, column in natural.items()}
        names = [b.name for b, of in zip(problem.tables, problem.soil_of, strict=True) if of == i]
        found.append(
            SoilEstimate(
                " and ".join(names),
                {n: d.value for n, d in draws.items()},
                {n: d.sigma for n, d in draws.items()},
                table.soil_prior.sized(),
            )
        )
    return tuple(found)


def mixed_repeats(problem: BenchProblem) -> tuple[Note, ...]:
    """Return a note where repeats of one test differ as different tests do; else nothing."""
    for noise in problem.noises:
        share = scatter_of_repeats(noise.measured, noise.groups) / problem.size_of(noise.channel)
        if noise.channel != "z" and share > MUCH_SCATTER:
            facts = {"channel": noise.channel, "share": share}
            return (Note(DiagnosisCode.REPEATS_MIXED, Severity.FAULT, facts),)
    return ()


def notes_of(
    problem: BenchProblem, plot_data: Sequence[PlotData], skids: Mapping[str, SkidLaw], weighing: Weighing
) -> list[Note]:
    """Return what a reader must know."""
    load_n = problem.typical_load_n
    notes = [Note(DiagnosisCode.PRIOR_SCALED, values={"share": load_n / _USUAL_LOAD_N, "load_n": load_n})]
    for noise in problem.noises:
        stated = noise.scatter_is_known
        scatter = float(noise.scatter[0]) if stated else scatter_of_repeats(noise.measured, noise.groups)
        if scatter > 0:
            facts = {"channel": noise.channel, "scatter": scatter, "form_scale": noise.form_scale}
            code = DiagnosisCode.SCATTER_STATED if stated else DiagnosisCode.REPEATS_SCATTER
            notes.append(Note(code, values=facts))
    laws = [Note(DiagnosisCode.SKID_LAW, values={"table": name, **asdict(law)}) for name, law in skids.items()]
    return [*notes, *_likeliest(weighing), *_unused_channels(plot_data), *laws]


def _likeliest(weighing: Weighing) -> list[Note]:
    """Return the most probable set, and how probable its families are without the gate of adequacy."""
    best = weighing.sets[0]
    if not weighing.any_adequate or not best.families:
        return []
    keys = tuple(use.key for use in best.hypothesis)
    ungated = {family: weighing.of_family(family, weighing.ungated) for family in sorted(best.families)}
    return [
        Note(DiagnosisCode.LIKELIEST_SET, values={"keys": keys, "probability": float(weighing.probabilities[0])}),
        Note(DiagnosisCode.WITHOUT_GATE, values={"families": ungated}),
    ]


def _unused_channels(plot_data: Sequence[PlotData]) -> list[Note]:
    """Return how far each candidate is from channels that it has not seen."""
    notes = []
    for table in plot_data:
        for channel in table.unused_channels:
            errors = {
                key: float(np.sqrt(np.nanmean((predicted[channel] - table.measured[channel]) ** 2)))
                for key, predicted in table.implied.items()
            }
            known = {key: error for key, error in errors.items() if np.isfinite(error)}
            if known:
                facts = {"table": table.campaign, "channel": channel, "errors": known}
                notes.append(Note(DiagnosisCode.UNSEEN_CHANNEL, values=facts))
    return notes
