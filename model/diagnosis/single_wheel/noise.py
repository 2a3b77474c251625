"""What separates a table's rows from a model: scatter of repeats, and an error of form that repeats share.

A row of a group (one preparation, one speed) is ``y = f + d_group + e`` with e the scatter of repeats, d an error of
the model's form that all rows of the group share: no such model is right to the last digit, and a cause must not be
named because another explains the last tenth of a newton better. Both one-sigmas are unknown and integrated over: the
scatter with a prior even in its logarithm (or given), the error of form with a half-Cauchy one (Gelman 2006, Bayesian
Analysis 1:515) of `FORM_PER_SCATTER` times the scatter of single rows: what a laboratory cannot repeat, a right model
may miss. Slip's and load's own errors are carried through the model's slopes where the table states them.

Given the model's values the integral is a finite sum over a grid, channel by channel; its gradient is that of one
Gaussian with the mean precision, so that a search needs no grid of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from daq import FloatArray, IndexArray

FORM_PER_SCATTER = 2.0
"""Error of form that a right model may well have, in one-sigmas of a single row."""
FORM_SHARE = 0.025
"""The same where nothing says how much repeats scatter, as a share of W, of W r, of r: an assumption."""
_LEAST_SHARE = 0.005
"""And at least: repeats that agree better are of a simulation."""
_SCATTER_NODES = 9
_FORM_NODES = 13


@dataclass(frozen=True)
class FormError:
    """What is taken for the error of form that a right model may have.

    Attributes
    ----------
    share : float or None
        Of W, W r and r, as a person gives it for every channel; None: twice the scatter of repeats, and `FORM_SHARE`
        in a channel without.
    factor : float
        What a given or an assumed share is multiplied by.
    """

    share: float | None = None
    factor: float = 1.0


@dataclass(frozen=True)
class ChannelNoise:
    """The noise of one channel.

    Attributes
    ----------
    channel : "dp", "t" or "z"
    measured : array, shape (m,)
        Of the m rows that have it.
    groups : int array, shape (m,)
        From 0 to g - 1; rows of one group share the error of form.
    carried : array, shape (m,)
        Variance from the errors of slip and load.
    form_scale : float
        Of the half-Cauchy prior.
    scatter, form : arrays, shape (nodes,)
        One-sigmas.
    log_weight : array, shape (nodes,)
        Of each node; sums to 1.
    form_share : float or None
        Share of W, W r or r that `form_scale` was given or assumed as; None where the scatter of repeats says it.
    """

    channel: str
    measured: FloatArray
    groups: IndexArray
    carried: FloatArray
    form_scale: float
    scatter: FloatArray
    form: FloatArray
    log_weight: FloatArray
    form_share: float | None = None

    @staticmethod
    def of(
        channel: str,
        measured: FloatArray,
        groups: IndexArray,
        carried: FloatArray,
        form_scale: float,
        sigma: float | None,
        form_share: float | None = None,
    ) -> ChannelNoise:
        """Return the noise of a channel; `sigma` is the scatter of repeats where it is known."""
        if sigma is not None:
            scatter, scatter_weight = np.array([sigma]), np.ones(1)
        else:
            pooled = scatter_of_repeats(measured, groups)
            middle = pooled if pooled > 0 else form_scale / 3
            scatter = middle * np.geomspace(0.4, 4.0, _SCATTER_NODES)
            scatter_weight = np.full(_SCATTER_NODES, 1.0 / _SCATTER_NODES)
        form = form_scale * np.geomspace(0.03, 100.0, _FORM_NODES)
        edges = np.concatenate([[0.0], np.sqrt(form[1:] * form[:-1]), [np.inf]])
        form_weight = np.diff(2.0 / np.pi * np.arctan(edges / form_scale))
        return ChannelNoise(
            channel,
            measured,
            groups,
            carried,
            form_scale,
            np.repeat(scatter, _FORM_NODES),
            np.tile(form, len(scatter)),
            np.log(np.outer(scatter_weight, form_weight)).ravel(),
            form_share,
        )

    @staticmethod
    def usual_form(
        measured: FloatArray, groups: IndexArray, sigma: float | None, size: float, form_error: FormError
    ) -> tuple[float, float | None]:
        """Return the error of form that a right model may well have, and what share of `size` was taken for it.

        The size is W, W r or r. The share is None where none was taken: the scatter of repeats says it.
        """
        scatter = scatter_of_repeats(measured, groups) if sigma is None else sigma
        if form_error.share is None and scatter > 0:
            return max(FORM_PER_SCATTER * scatter, _LEAST_SHARE * size), None
        share = form_error.factor * (FORM_SHARE if form_error.share is None else form_error.share)
        return share * size, share

    @property
    def scatter_is_known(self) -> bool:
        """Whether the table states the scatter of repeats."""
        return len(np.unique(self.scatter)) == 1

    @cached_property
    def members(self) -> FloatArray:
        """Which row is of which group, shape (m, g)."""
        return np.eye(int(self.groups.max()) + 1)[self.groups]

    @cached_property
    def _row_precision(self) -> FloatArray:
        """Shape (nodes, m)."""
        return 1.0 / (self.scatter[:, None] ** 2 + self.carried)

    def log_likelihoods(self, error: FloatArray, rows: FloatArray | None = None) -> FloatArray:
        """Return ln p of measured minus model, shape (..., m), for every node: shape (..., nodes).

        `rows`, shape (m,), is 1 for those that count and 0 for those that are excluded; of a group all or none.
        """
        counted = np.ones(error.shape[-1]) if rows is None else rows
        weight = self._row_precision * counted  # (nodes, m)
        precision = weight @ self.members
        squares = (error**2) @ weight.T
        sums = np.tensordot(error, (weight[:, :, None] * self.members).swapaxes(0, 1), 1)
        shared = 1.0 + self.form[:, None] ** 2 * precision
        determinant = (np.log(2 * np.pi / self._row_precision) @ counted) + np.log(shared).sum(axis=1)
        explained = (sums**2 * (self.form[:, None] ** 2 / shared)).sum(axis=-1)
        return np.asarray(-0.5 * (determinant + squares - explained))

    def log_likelihood(self, error: FloatArray, rows: FloatArray | None = None) -> FloatArray:
        """Return ln p of measured minus model, shape (...); see `log_likelihoods`."""
        return np.asarray(_log_sum(self.log_likelihoods(error, rows) + self.log_weight))

    def weighed_nodes(self, error: FloatArray, rows: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return `node_shares` and `log_likelihood` at once."""
        each = self.log_likelihoods(error, rows) + self.log_weight
        total = _log_sum(each)
        return np.asarray(np.exp(each - total[..., None])), np.asarray(total)

    def node_shares(self, error: FloatArray, rows: FloatArray | None = None) -> FloatArray:
        """Return the probability of every node given the errors, shape (..., nodes)."""
        return self.weighed_nodes(error, rows)[0]

    def precision(self, shares: FloatArray, rows: FloatArray | None = None) -> FloatArray:
        """Return the mean precision matrix under the nodes' probabilities, shape (..., m, m)."""
        counted = np.ones(len(self.measured)) if rows is None else rows
        weight = self._row_precision * counted
        shared = 1.0 + self.form[:, None] ** 2 * (weight @ self.members)
        factor = (self.form[:, None] ** 2 / shared) @ self.members.T  # (nodes, m)
        together = self.members @ self.members.T
        diagonal = (shares @ weight)[..., None] * np.eye(len(counted))
        block = np.tensordot(shares, (weight * factor)[:, :, None] * weight[:, None, :], 1) * together
        return np.asarray(diagonal - block)

    def means(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean one-sigmas of scatter and error of form under the nodes' probabilities."""
        return shares @ self.scatter, shares @ self.form


def scatter_of_repeats(measured: FloatArray, groups: IndexArray) -> float:
    """Return the pooled one-sigma within groups; 0 where no group has two rows."""
    counts = np.bincount(groups)
    freedom = int((counts - 1)[counts > 0].sum())
    if freedom <= 0:
        return 0.0
    means = np.bincount(groups, measured) / np.maximum(counts, 1)
    return float(np.sqrt(((measured - means[groups]) ** 2).sum() / freedom))


def groups_of_rows(group: IndexArray, slip: FloatArray, load_n: FloatArray) -> IndexArray:
    """Return which rows are repeats of each other, from 0 on.

    The table's own groups where it parts rows; else rows of like slip (closer than 0.03 to the next) and load (closer
    than 30 % to the next).
    """
    if len(np.unique(group)) > 1:
        return np.asarray(np.unique(group, return_inverse=True)[1])
    by_slip, by_load = (_steps(x, gap) for x, gap in ((slip, 0.03), (np.log(load_n), 0.3)))
    return np.asarray(np.unique(by_slip * (len(slip) + 1) + by_load, return_inverse=True)[1])


def _steps(values: FloatArray, gap: float) -> IndexArray:
    order = np.argsort(values)
    step = np.concatenate([[0], np.cumsum(np.diff(values[order]) > gap)])
    out = np.empty(len(values), np.intp)
    out[order] = step
    return out


def _log_sum(x: FloatArray) -> FloatArray:
    top = x.max(axis=-1)
    return np.asarray(top + np.log(np.exp(x - top[..., None]).sum(axis=-1)))
