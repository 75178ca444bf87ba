"""Least squares over all measured shapes, by SciPy's trust region method with bounds.

Unknowns are counted from lower to upper bound, 0 to 1. Priors are further residuals, which no
robust loss touches. A step that leads to an arm that cannot be, or on which a shape cannot be
followed, is refused, so that the trust region shrinks: it is the continuation's step as well.

Which unknowns the data identify, and which trade with each other, is told by the Jacobian J of
residuals over noise, priors below. Its right singular vectors are the directions in which unknowns
change together; a direction that changes nothing that was measured is not identifiable, one that is
uncertain by half of the bounds' range badly so.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import scipy
from scipy.linalg import qr

from model import InputError
from model.paths import Array
from model.time_limit import check_time
from planner.fit.residuals import Evaluation
from planner.fit.unknowns import AT_BOUND

LOG = logging.getLogger(__name__)
Loss = Literal["linear", "huber", "soft_l1", "cauchy"]
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
# Derivatives serve elsewhere if they tell changes up to so much, over the root of the tolerance: by
# what they are off there the logarithm of the likelihood changes by less than the tolerance.
_TRUSTED = 0.5
# Singular values over the largest, columns at length 1, below which a direction is not
# identifiable; and the standard deviation along one, over the bounds' range, above which it is
# badly so.
_ZERO, _WIDE = 1e-7, 0.5
# Parts of a direction that are left out of it, over the largest: where the data tell it badly, and
# where they do not tell it, where only rounding is.
_SMALL, _INVOLVED = 0.1, 1e-3


def counted_by(loss: Loss, r: Array) -> Array:
    """Return how much residuals over the noise count against those of a square: rho'."""
    return np.asarray(_RHO[loss](np.square(r))[1])


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
        terms = _RHO[self.loss](data / noise**2)
        scale = np.log(noise / _LEAST_NOISE)  # above 0, so that changes are small beside it
        constant = 2 * self.free * _expected(self.loss) * scale / max(self.size, 1)
        rows[:, : self.size] = terms[0] + constant, terms[1] / noise**2, terms[2] / noise**4
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
    refused : tuple of int
        Shapes that could not be followed on the last steps, which end the fit.
    """

    evaluation: Evaluation
    noise: float
    cost: float
    refused: tuple[int, ...]


def fit(start: Evaluation, loss: Loss, absolute: bool, tolerance: float = 1e-6) -> Fit:
    """Return the optimum that an evaluation leads to, of the shapes that it has.

    To about a `tolerance` in the logarithm of the likelihood. Unless standard deviations hold as
    given (`absolute`), the noise of a robust loss is that of Cauchy's, which bounds what outliers
    add to it.
    """
    noise = 1.0 if absolute else None
    if loss in ("huber", "soft_l1") and not absolute:
        robust = _descent(start, "cauchy", None, tolerance)
        if robust.refused:
            return robust
        start, noise = robust.evaluation, robust.noise
    return _descent(start, loss, noise, tolerance)


def _descent(start: Evaluation, loss: Loss, noise: float | None, tolerance: float) -> Fit:
    steps, parameters = _Steps(start, tolerance), start.experiment.parameters
    free = max(steps.size + steps.priors - len(parameters.unknowns), 1)
    likelihood = Likelihood(loss, free, steps.size, noise)

    def stop_at_the_optimum(z: Array) -> None:
        if steps.gain(z, likelihood) <= tolerance:
            raise StopIteration

    result = scipy.optimize.least_squares(
        steps.residuals,
        np.clip(parameters.fractions(start.values), 0.0, 1.0),
        steps.jacobian,
        bounds=(0.0, 1.0),
        loss=likelihood.rho,
        x_scale="jac",
        xtol=_STEP,
        ftol=tolerance / max(np.log(1 / _LEAST_NOISE) * steps.size, 1.0),
        gtol=_GRADIENT,
        max_nfev=_MOST,
        callback=stop_at_the_optimum,
    )
    LOG.debug("%s: %s after %d evaluations", loss, result.message, result.nfev)
    noise = likelihood.noise_of(steps.residuals(result.x)[: steps.size])
    return Fit(steps.best, noise, float(result.cost), steps.refused)


class _Steps:
    """What SciPy calls: z (K,) from 0 to 1; shapes follow from those last differentiated.

    Attributes
    ----------
    best : Evaluation
        The shapes at the last step that was taken.
    size, priors : int
        Number of residuals of data, and of priors, which come last.
    refused : tuple of int
        Shapes that could not be followed since then.
    """

    def __init__(self, start: Evaluation, tolerance: float) -> None:
        self.best = self._last = self._differentiated = start
        self._parameters, self._whitening = start.experiment.parameters, start.whitening
        self._at = np.clip(self._parameters.fractions(start.values), 0.0, 1.0)
        self.size = sum(map(len, start.residuals.values()))
        self.priors = self._parameters.priors(start.values)[0].size
        self.refused: tuple[int, ...] = ()
        self._trusted = _TRUSTED * np.sqrt(tolerance)
        self._linear: tuple[Array, Array, Array] | None = None

    def residuals(self, z: Array) -> Array:
        """Return the residuals of data and priors; infinite where a shape cannot be followed."""
        if not np.array_equal(z, self._at):
            check_time()
            try:
                evaluation = self._differentiated.near(self._parameters.from_fractions(z))
                self.refused = tuple(evaluation.lost) or self.refused
            except InputError:
                evaluation = None
            if evaluation is None or evaluation.lost:
                return np.full(self.size + self.priors, np.inf)
            self._last, self._at = evaluation, z.copy()
        rows = [self._whitening[i] @ r for i, r in self._last.residuals.items()]
        return np.concatenate([*rows, self._parameters.priors(self._last.values)[0]])

    def jacobian(self, z: Array) -> Array:
        """Return their derivatives (n, K); the step that led here is taken.

        Those where shapes were differentiated last do where residuals have changed as these said.
        """
        r = self.residuals(z)
        self.best, self.refused = self._last, ()
        if self._linear is not None:
            at, before, J = self._linear
            predicted = J @ (z - at)
            if np.linalg.norm(r - before - predicted) <= self._trusted * np.linalg.norm(predicted):
                return J
        scale, self._differentiated = self._parameters.range, self.best
        rows = [self._whitening[i] @ J * scale for i, J in self.best.jacobians.items()]
        J = np.vstack([*rows, self._parameters.priors(self.best.values)[1]])
        self._linear = self._at, r, J
        return J

    def gain(self, z: Array, likelihood: Likelihood) -> float:
        """Return what the linearisation says can be gained of the logarithm of the likelihood.

        By the unknowns that do not press against a bound: half the square of the part of the
        residuals that they explain. Source: Bates and Watts, "Nonlinear Regression Analysis and Its
        Applications" (1988), 2.2.3.
        """
        r = self.residuals(z)
        counted = np.sqrt(likelihood.rho(np.square(r))[1])
        J, r = counted[:, None] * self.jacobian(z), counted * r
        slope = J.T @ r
        free = J[:, np.where(slope > 0, z, 1 - z) > AT_BOUND]
        explained = free @ np.linalg.lstsq(free, r, rcond=None)[0]
        return float(explained @ explained) / 2


@dataclass(frozen=True)
class Direction:
    """Unknowns that change together without the data telling.

    Attributes
    ----------
    names : tuple of str
        Of the unknowns.
    changes : tuple of float
        What each changes by, in the unit of its key, when the first does by a tenth of its range.
    units : tuple of str
    std : float
        Standard deviation along the direction, over the range of the bounds; inf if nothing tells.
    """

    names: tuple[str, ...]
    changes: tuple[float, ...]
    units: tuple[str, ...]
    std: float

    def __str__(self) -> str:
        nothing = not np.isfinite(self.std)
        if len(self.names) == 1:
            which = "nothing that was measured tells" if nothing else "the data hardly tell"
            return f"{which} {self.names[0]}"
        rows = zip(self.names, self.changes, self.units, strict=True)
        first, *others = (f"{name} {change:+.3g} {unit}".rstrip() for name, change, unit in rows)
        difference = "no difference to what was measured" if nothing else "less than noise"
        return f"{first} trades with {', '.join(others)}: together they make {difference}"


@dataclass(frozen=True, eq=False)
class Information:
    """What data and priors say of K unknowns.

    Attributes
    ----------
    covariance : (K, K)
        In units of the bounds' ranges; inf on the diagonal where nothing tells.
    directions : list of (vector (K,), standard deviation)
        Those that are not identifiable, or badly so; counted like the covariance.
    """

    covariance: Array
    directions: list[tuple[Array, float]]


def information(J: Array) -> Information:
    """Return what residuals over noise with derivatives J (n, K), priors included, say."""
    K = J.shape[1]
    size = np.linalg.norm(J, axis=0)
    blind = size <= _ZERO * max(float(size.max()), 1e-300)
    lengths = np.where(blind, 1.0, size)
    scaled = np.vstack([np.where(blind, 0.0, J / lengths), np.zeros((K, K))])
    _, s, V = np.linalg.svd(scaled, full_matrices=False)
    null = s <= _ZERO * max(float(s[0]), 1e-300)
    along = V / lengths
    covariance = (along[~null].T / np.square(s[~null])) @ along[~null]
    directions = [(v / np.linalg.norm(v), float("inf")) for v in _sparse(along[null])]
    involved = np.abs(np.array([v for v, _ in directions]).reshape(-1, K)) > _INVOLVED
    variances, vectors = np.linalg.eigh(covariance)
    directions += [
        (v, float(np.sqrt(variance)))
        for variance, v in zip(variances[::-1], vectors.T[::-1], strict=True)
        if variance > _WIDE**2
    ]
    covariance[np.diag_indices(K)] += np.where(involved.any(axis=0), np.inf, 0.0)
    return Information(covariance, directions)


def _sparse(vectors: Array) -> Array:
    """Return a basis of the space of vectors (r, K), each without what leads the others."""
    if len(vectors) < 2:
        return vectors
    _, R, pivots = qr(vectors, pivoting=True)
    basis = np.zeros_like(vectors)
    basis[:, pivots] = np.linalg.solve(R[:, : len(R)], R)
    return basis


def direction(
    v: Array, std: float, names: Sequence[str], ranges: Array, units: Sequence[str]
) -> Direction:
    """Return a direction v (K,), counted in the ranges of the bounds, in the keys' units."""
    order = np.argsort(-np.abs(v))
    least = _SMALL if np.isfinite(std) else _INVOLVED
    kept = [int(k) for k in order if abs(v[k]) >= least * abs(v[order[0]])]
    changes = [float(0.1 * v[k] / v[kept[0]] * ranges[k]) for k in kept]
    return Direction(
        tuple(names[k] for k in kept), tuple(changes), tuple(units[k] for k in kept), std
    )
