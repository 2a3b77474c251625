"""Fit Lyasko's law to one run by wheelsoil, scipy and lmfit, taking turns; print the times and how far they differ.

All minimise the same sum of squares of the same model, with the static sinkage solved for at every step; scipy and
lmfit take derivatives by differences. What `wheelsoil fit` does besides is measured beside them: weights from the noise
of the slip, intervals by profile, the criteria.
"""

from __future__ import annotations

import json

import lmfit
import numpy as np
from scipy.optimize import least_squares

from benchmarks.bench_model import WHEEL, processed_run
from benchmarks.timing import side_by_side
from daq import FloatArray
from model.effects import EFFECTS
from model.fit import FitOptions, fit_observations, free_parameters
from model.fit.gauss_newton import gauss_newton
from model.fit.observations import observations_of
from model.fit.problem import FitProblem
from model.wheel_soil import SOILS, WheelSoilModel

START = (0.1, 0.1)


def main() -> None:
    """Print the times of each, and the largest difference of each peer's parameters from ours."""
    soil, law = SOILS["clay"], EFFECTS["lyasko"]
    options = FitOptions(models=("lyasko",))
    driven = observations_of([processed_run()])
    driven = driven[driven.conditions.slip > 0]
    model = WheelSoilModel(WHEEL, soil, (law,))

    def residual(x: FloatArray) -> FloatArray:
        predicted = model.predict(driven.conditions, {"m1": float(x[0]), "m2": float(x[1])}).drawbar_pull_n
        return np.asarray(predicted - driven.drawbar_pull_n)

    bounds = [(p.lower, p.upper) for p in law.parameters]
    found: dict[str, FloatArray] = {}

    free = free_parameters(model, None)
    problem = FitProblem(
        model, driven, options.channels, free, None, {c: np.ones(len(driven)) for c in options.channels}
    )

    def ours() -> None:
        found["wheelsoil"] = gauss_newton(
            problem.residual_and_jacobian,
            START,
            lower=[f.lower for f in free],
            upper=[f.upper for f in free],
            scale=[f.scale for f in free],
        ).estimate

    def by_scipy() -> None:
        found["scipy"] = least_squares(residual, START, bounds=tuple(zip(*bounds, strict=True))).x

    def by_lmfit() -> None:
        parameters = lmfit.Parameters()
        for name, start, (low, high) in zip(("m1", "m2"), START, bounds, strict=True):
            parameters.add(name, value=start, min=low, max=high)
        result = lmfit.minimize(lambda p: residual(np.array([p["m1"].value, p["m2"].value])), parameters)
        found["lmfit"] = np.array([result.params["m1"].value, result.params["m2"].value])

    def whole() -> None:
        fit_observations(driven, WHEEL, soil, options)

    ways = {"wheelsoil": ours, "scipy": by_scipy, "lmfit": by_lmfit, "wheelsoil, whole": whole}
    seconds = side_by_side(ways, repeats=3)
    apart = {peer: float(np.abs(found[peer] - found["wheelsoil"]).max()) for peer in ("scipy", "lmfit")}
    print(json.dumps({"seconds": seconds, "apart": apart}))


if __name__ == "__main__":
    main()
