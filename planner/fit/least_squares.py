"""Least squares over all measured shapes, by SciPy's trust region method with bounds.

Unknowns are counted from lower to upper bound, 0 to 1. Priors are further residuals, which no
robust loss touches. A step that leads to an arm that cannot be, or on which a shape cannot be
followed, is refused, so that the trust region shrinks: it is the continuation's step as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import scipy

from model import InputError
from model.paths import Array
from model.time_limit import check_time
from planner.fit.residuals import Evaluation
from planner.fit.unknowns import Unknown

Loss = Literal["linear", "huber", "soft_l1", "cauchy"]
LOSSES = ("linear", "huber", "soft_l1", "cauchy")
Rho = tuple[Array, Array, Array]
# rho(z), rho', rho'' of squared residuals z over the noise; scipy.optimize.least_squares.
_RHO: dict[str, Callable[[Array], Rho]] = {
    "linear": lambda z: (z, np.ones_like(z), np.zeros_like(z)),
    "huber": lambda z: (
        np.where(z <= 1, z, 2 * np.sqrt(np.maximum(z, 1)) - 1),
        np.where(z <= 1, 1.0, np.maximum(z, 1) ** -0.5),
        np.where(z <= 1, 0.0, -0.5 * np.maximum(z, 1) ** -1.5),
    ),
    "soft_l1": lambda z: (2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    "cauchy": lambda z: (np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2),
}
# The least noise, over the standard deviations given, and how often shapes are settled at most.
_LEAST_NOISE, _MOST = 1e-9, 100
# The last step, over the unknowns from 0 to 1, and the gradient of the log-likelihood there.
_STEP, _GRADIENT = 1e-7, 1e-9


@dataclass(frozen=True)
class Weights:
    """How residuals are counted.

    Attributes
    ----------
    loss : str
        Of residuals over the noise.
    absolute : bool
        Whether standard deviations hold as given.
    """

    loss: Loss = "linear"
    absolute: bool = False

    def of(self, r: Array) -> Array:
        """Return how much residuals over the noise count against those of a square: rho'."""
        return np.asarray(_RHO[self.loss](np.square(r))[1])


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The negative logarithm of the likelihood of residuals r and of their noise.

        n k log(noise) + 1/2 sum rho((r / noise)^2),   noise where that is least,

    whose gradient by r is that of fixed noise. `k` makes the noise that of a normal distribution:
    it is the mean of rho'(x^2) x^2 there. Source: Huber, "Robust Statistics" (1981), 7.7.

    Attributes
    ----------
    loss : str
    free : float
        n, the degrees of freedom.
    size : int
        How many of the residuals are of data; the rest are of priors, which are in full.
    noise : float
        If it is known.
    """

    loss: Loss
    free: float
    size: int
    noise: float | None = None

    def noise_of(self, r: Array) -> float:
        """Return the noise of residuals of data."""
        if self.noise is not None:
            return self.noise
        z, wanted = np.square(r), self.free * _expected(self.loss)
        if self.loss == "linear":
            return max(float(np.sqrt(z.sum() / self.free)), _LEAST_NOISE)

        def excess(log: float) -> float:
            t = z * np.exp(-2 * log)
            return float((_RHO[self.loss](t)[1] * t).sum()) - wanted

        low, high = (
            np.log(_LEAST_NOISE),
            np.log(_LEAST_NOISE + 1e3 * float(np.abs(r).max(initial=0))),
        )
        if excess(low) <= 0 or high <= low:
            return _LEAST_NOISE
        return float(np.exp(scipy.optimize.brentq(excess, low, high, xtol=1e-6)))

    def rho(self, z: Array) -> Array:
        """Return twice the likelihood's terms of squared residuals z, and their derivatives."""
        rows = np.array(_RHO["linear"](z))
        data = z[: self.size]
        noise = self.noise_of(np.sqrt(data))
        own = _RHO[self.loss](data / noise**2)
        scale = np.log(noise / _LEAST_NOISE)  # above 0, so that changes are small beside it
        constant = 2 * self.free * _expected(self.loss) * scale / max(self.size, 1)
        rows[:, : self.size] = own[0] + constant, own[1] / noise**2, own[2] / noise**4
        return rows


@lru_cache(maxsize=8)
def _expected(loss: str) -> float:
    """Return the mean of rho'(x^2) x^2 of a standard normal distribution, by 4000 quantiles."""
    z = np.square(scipy.special.ndtri((np.arange(4000) + 0.5) / 4000))
    return float((_RHO[loss](z)[1] * z).mean())


@dataclass(frozen=True, eq=False)
class Fit:
    """A local optimum.

    Attributes
    ----------
    evaluation : Evaluation
        The shapes at the values there.
    noise : float
        What standard deviations are multiplied by, as the residuals say; 1 if they hold as given.
    cost : float
        The negative logarithm of the likelihood, but for a constant.
    evaluations : int
        How often all shapes were settled.
    refused : tuple of int
        Shapes that could not be followed on the last steps, which end the fit.
    """

    evaluation: Evaluation
    noise: float
    cost: float
    evaluations: int
    refused: tuple[int, ...]


def prior_residuals(unknowns: Sequence[Unknown], values: Array) -> tuple[Array, Array]:
    """Return residuals (m,) of priors, and their derivatives (m, K) by the unknowns from 0 to 1."""
    known = [(k, own.prior, own.range) for k, own in enumerate(unknowns) if own.prior]
    r = np.array([(values[k] - prior[0]) / prior[1] for k, prior, _ in known])
    J = np.zeros((len(known), len(unknowns)))
    for row, (k, prior, span) in enumerate(known):
        J[row, k] = span / prior[1]
    return r, J


def fit(start: Evaluation, weights: Weights, tolerance: float = 1e-6) -> Fit:
    """Return the optimum that an evaluation leads to, of the shapes that it has.

    To about a `tolerance` in the logarithm of the likelihood.

    The noise of a robust loss is that of Cauchy's, which bounds what outliers add to it.
    """
    if weights.absolute:
        return _descent(start, weights.loss, 1.0, tolerance)
    if weights.loss == "linear":
        return _descent(start, "linear", None, tolerance)
    robust = _descent(start, "cauchy", None, tolerance)
    if weights.loss == "cauchy" or robust.refused:
        return robust
    return _descent(robust.evaluation, weights.loss, robust.noise, tolerance)


def _descent(start: Evaluation, loss: Loss, noise: float | None, tolerance: float) -> Fit:
    steps = _Steps(start)
    unknowns = start.experiment.parameters.unknowns
    free = max(steps.size - sum(own.prior is None for own in unknowns), 1)
    likelihood = Likelihood(loss, free, steps.size, noise)
    scipy.optimize.least_squares(
        steps.residuals,
        np.clip(start.experiment.parameters.shares(start.values), 0.0, 1.0),
        steps.jacobian,
        bounds=(0.0, 1.0),
        loss=likelihood.rho,
        x_scale="jac",
        xtol=_STEP,
        ftol=tolerance / max(np.log(1 / _LEAST_NOISE) * steps.size, 1.0),
        gtol=_GRADIENT,
        max_nfev=_MOST,
    )
    best = steps.best
    r = np.concatenate([steps.whitened(best), prior_residuals(unknowns, best.values)[0]])
    cost = float(likelihood.rho(np.square(r))[0].sum()) / 2
    found = likelihood.noise_of(r[: steps.size])
    return Fit(best, found, cost, steps.evaluations, steps.refused)


class _Steps:
    """What SciPy calls: z (K,) from 0 to 1; shapes follow from those last differentiated."""

    def __init__(self, start: Evaluation) -> None:
        self.best = self._last = start
        self._parameters, self._whitening = start.experiment.parameters, start.whitening
        self.evaluations, self.refused = 0, tuple[int, ...]()

    @cached_property
    def size(self) -> int:
        """Number of residuals of data."""
        return int(self.whitened(self.best).size)

    def whitened(self, here: Evaluation) -> Array:
        """Return the residuals of data, over their standard deviations (n,)."""
        rows = [self._whitening[i] @ miss for i, miss in here.by_shape.items()]
        return np.concatenate([*rows, np.zeros(0)])

    def residuals(self, z: Array) -> Array:
        """Return the residuals of data and priors; infinite where a shape cannot be followed."""
        values = self._parameters.from_shares(z)
        prior, _ = prior_residuals(self._parameters.unknowns, values)
        if not np.allclose(self._parameters.shares(self._last.values), z, rtol=0, atol=1e-14):
            check_time()
            self.evaluations += 1
            try:
                here = self.best.near(values)
            except InputError:
                return np.full(self.size + prior.size, np.inf)
            if here.lost:
                self.refused = tuple(here.lost)
                return np.full(self.size + prior.size, np.inf)
            self._last = here
        return np.concatenate([self.whitened(self._last), prior])

    def jacobian(self, z: Array) -> Array:
        """Return their derivatives (n, K); the step that led here is taken."""
        self.best, self.refused = self._last, ()
        rows = [self._whitening[i] @ J for i, J in self.best.jacobians.items()]
        prior = prior_residuals(self._parameters.unknowns, self.best.values)[1]
        return np.vstack([*(own * self._parameters.range for own in rows), prior])
