"""The covariance behind a model's band."""

from __future__ import annotations

from math import nan

import numpy as np

from model.fit import Estimate, ModelFit
from model.fit.intervals import Blocks
from model.fit.result import LoadRatio
from wheelsoil.report.inputs import _covariance

ESTIMATES = (
    Estimate("m1", "1", 0.1, 0.2, (0.0, 0.5)),
    Estimate("m2", "1", 0.05, 0.1, (0.0, 0.3)),
    Estimate("p", "1", 0.15, 0.05, (0.1, 0.2), derived=True),
    Estimate("tan_phi", "1", 0.3, nan, (0.3, 0.4), at_bound=True),
)


def test_coefficients_that_make_up_for_each_other_do_so_in_the_band() -> None:
    """m1 and m2 with a correlation of -0.9: the variance of their sum is 0.04 + 0.01 - 2 x 0.018."""
    correlation = {("m1", "m2"): -0.9, ("m1", "tan_phi"): nan, ("m2", "tan_phi"): nan}
    blocks, ratio = Blocks(np.zeros(0, np.intp), 0, nan, nan), LoadRatio(nan, nan, nan)
    fit = ModelFit("lyasko", ("lyasko",), ESTIMATES, correlation, (), "", 0, {}, ratio, 0, blocks, {})
    names, covariance = _covariance(fit)
    assert names == ("m1", "m2")
    np.testing.assert_allclose(covariance, [[0.04, -0.018], [-0.018, 0.01]], rtol=1e-12)
