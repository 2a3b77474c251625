"""What stands behind a verdict: its causes with their sizes, and the soil that goes with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.evidence import Posterior, estimate
from model.diagnosis.final import SetFit, fit_set, parameters_of, soils_of
from model.diagnosis.look import Look
from model.diagnosis.result import Cause, ParameterEstimate, SoilEstimate
from model.diagnosis.spread import spread_of
from model.diagnosis.verdict import Judgement
from model.effects import EFFECTS

FloatArray = NDArray[np.float64]
Keys = tuple[str, ...]

_MOST_FITTED = 6
"""Members of a set that are fitted each on its own; those beyond are told by their names."""
_MOST_SHOWN = 6


@dataclass(frozen=True)
class Explained:
    """Causes of a verdict.

    Attributes
    ----------
    causes : tuple of Cause
        The named ones, fitted together; or the members of a set, each fitted as if it were the one.
    extended : tuple of str
        Keys of the causes that the extended model has: the named ones, the likeliest member of a set, the likeliest
        set where nothing explains the data; empty where nothing is seen.
    sizes : mapping key -> array
        Coefficients of the causes, and of the likeliest others, in units of the prior scale.
    soils : tuple of SoilEstimate
        With the extended model's causes.
    """

    causes: tuple[Cause, ...]
    extended: Keys
    sizes: dict[str, FloatArray]
    soils: tuple[SoilEstimate, ...]


class Fits:
    """Sets of causes fitted with the whole model, each once.

    Attributes
    ----------
    look : Look
    starts : "one" or "several"
        "one" where nothing explains the data, so that no size is more than a place to look from.
    known : mapping keys -> SetFit
    """

    def __init__(self, look: Look, starts: Literal["one", "several"] = "several") -> None:
        self.look = look
        self.starts = starts
        self.known: dict[Keys, SetFit] = {}

    def __getitem__(self, keys: Keys) -> SetFit:
        if keys not in self.known:
            self.known[keys] = fit_set(self.look, keys, starts=self.starts)
        return self.known[keys]

    def of(self, *sets: Keys) -> dict[Keys, SetFit]:
        """Return the fits of several sets."""
        return {keys: self[keys] for keys in sets}


def explain(fits: Fits, verdict: Judgement, found: Posterior) -> Explained:
    """Fit what a verdict is about.

    Parameters
    ----------
    fits : Fits
    verdict : Judgement
    found : Posterior
    """
    look = fits.look
    keys = tuple(likeliest_form(found, family) for family in verdict.families)
    extended = _extended(look, verdict, keys)
    whole = fits[extended]
    spread = spread_of(whole.problem, whole.estimate, look, extended)
    values: dict[str, tuple[ParameterEstimate, ...]] = {}
    sizes: dict[str, FloatArray] = {}
    if verdict.verdict == "named":
        values, sizes = parameters_of(whole, look, spread), dict(whole.sizes)
    else:
        for key in keys[:_MOST_FITTED]:
            fit = fits[(key,)]
            values |= parameters_of(fit, look, spread if extended == (key,) else None)
            sizes |= fit.sizes
    causes = tuple(_cause(found, family, key, values) for family, key in zip(verdict.families, keys, strict=True))
    return Explained(causes, extended, sizes | _others(look, found, sizes), soils_of(whole, look, spread))


def doubtful(causes: Sequence[Cause]) -> str:
    """Return why a cause's value does not bear its name; empty where all do.

    Parameters
    ----------
    causes : sequence of Cause
        With their values.
    """
    for cause in causes:
        whose = f"the {cause.name.replace('_', ' ')}'s"
        limits = {p.name: p for p in EFFECTS[cause.key].parameters}
        for found in cause.parameters:
            own = limits.get(found.name)
            if own is None:  # a combination, as Lyasko's p
                continue
            edges = [edge for edge in (own.lower, own.upper) if edge != own.neutral]
            if np.isclose(found.value, edges, rtol=1e-3, atol=0.0).any():
                return f"{whose} {found.name} ends at the limit of what is plausible, {found.value:.3g} {found.unit}"
            low, high = found.interval95
            if len(cause.parameters) == 1 and low < own.neutral < high:
                return f"{whose} {found.name} may as well be {own.neutral:g} ({low:.3g} to {high:.3g} {found.unit})"
    return ""


def likeliest_form(found: Posterior, family: str) -> str:
    """Return the key of a family's likeliest form."""
    return next(iter(found.forms(family)))


def _extended(look: Look, verdict: Judgement, keys: Keys) -> Keys:
    if verdict.verdict == "named":
        order = [c.key for c in look.grams.causes]
        return tuple(sorted(keys, key=order.index))
    if verdict.verdict == "one_of":
        return keys[:1]
    return look.best.keys if verdict.verdict == "unexplained" else ()


def _cause(found: Posterior, family: str, key: str, values: dict[str, tuple[ParameterEstimate, ...]]) -> Cause:
    effect = EFFECTS[key]
    return Cause(
        name=family,
        form=effect.form,
        kind=effect.kind,
        key=key,
        probability=found.families()[family],
        form_probability=found.forms(family)[key],
        parameters=values.get(key, ()),
    )


def _others(look: Look, found: Posterior, known: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the linear sizes of the likeliest families that were not fitted."""
    sizes: dict[str, FloatArray] = {}
    for family in found.families():
        if len(known) + len(sizes) >= _MOST_SHOWN:
            break
        key = likeliest_form(found, family)
        if key not in known:
            alone = estimate(look.grams, (key,))
            sizes[key] = alone.coefficients[list(alone.columns)]
    return sizes
