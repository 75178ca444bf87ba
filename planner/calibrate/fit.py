"""Least squares over all measured shapes, by SciPy's trust region method with bounds.

Unknowns are counted from lower to upper bound, 0 to 1. Priors are further residuals, which no
robust loss touches. Where a step leads to an arm that cannot be, or to shapes that do not settle,
the trust region shrinks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from model import InputError
from model.paths import Array
from model.time_limit import check_time
from planner.calibrate.experiment import Evaluation, Experiment, UnsettledShapeError

LOG = logging.getLogger(__name__)
Loss = Literal["linear", "huber", "soft_l1", "cauchy"]
LOSSES = ("linear", "huber", "soft_l1", "cauchy")
# rho(z), rho', rho'' of squared residuals z over the noise; scipy.optimize.least_squares.
_RHO: dict[str, Callable[[Array], tuple[Array, Array, Array]]] = {
    "linear": lambda z: (z, np.ones_like(z), np.zeros_like(z)),
    "huber": lambda z: (
        np.where(z <= 1, z, 2 * np.sqrt(np.maximum(z, 1)) - 1),
        np.where(z <= 1, 1.0, np.maximum(z, 1) ** -0.5),
        np.where(z <= 1, 0.0, -0.5 * np.maximum(z, 1) ** -1.5),
    ),
    "soft_l1": lambda z: (2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    "cauchy": lambda z: (np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2),
}
_ROUNDS, _STEADY, _LEAST, _MOST = 6, 0.01, 1e-9, 60
# Of the residuals, what unknowns could still explain over what they cannot: an optimum is found to
# about such a share of the standard errors. Source: Bates and Watts, Technometrics 23 (1981).
OFFSET = 1e-3
# Nearer to a bound, over the range, an unknown is at it: the trust region keeps inside.
_BOUND = 1e-6
# A normal distribution's standard deviation over the median of its sizes.
_MAD = 1.4826


@dataclass(frozen=True, eq=False)
class Fit:
    """A local optimum.

    Attributes
    ----------
    found : Evaluation
        All shapes at the values there.
    differentiated : Evaluation
        Where they were differentiated last, as near as the last step.
    noise : float
        What standard deviations are multiplied by, as the residuals say; 1 if they hold as given.
    cost : float
        Half the sum of rho over shapes and priors.
    evaluations : int
        How often all shapes were settled.
    """

    found: Evaluation
    differentiated: Evaluation
    noise: float
    cost: float
    evaluations: int

    @property
    def misfit(self) -> float:
        """The negative logarithm of the likelihood, but for a constant: what starts differ by."""
        return self.cost + self.found.residuals.size * float(np.log(self.noise))


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

    def jacobian(self, r: Array) -> Array:
        """Return how much residuals over the noise count against those of a square: rho'."""
        return np.asarray(_RHO[self.loss](np.square(r))[1])


def fit(start: Evaluation, weights: Weights, offset: float = OFFSET) -> Fit:
    """Return the optimum that an evaluation of all shapes leads to.

    It is found to about such an `offset` of the standard errors. The noise and the optimum depend
    on each other where there are priors or a robust loss: they are worked out in turn.
    """
    known = 1.0 if weights.absolute else None
    found = _descent(start, weights, known or _guess(start.experiment), offset)
    if known is not None:
        return found
    alone = weights.loss == "linear" and not any(
        own.prior for own in start.experiment.parameters.unknowns
    )
    for _ in range(_ROUNDS):
        now = noise_of(found, weights)
        if alone:
            return replace(found, noise=now, cost=found.cost * (found.noise / now) ** 2)
        if abs(now / found.noise - 1) < _STEADY:
            return found
        again = _descent(found.found, weights, now, offset)
        found = replace(again, evaluations=found.evaluations + again.evaluations)
    return found


def noise_of(found: Fit, weights: Weights) -> float:
    """Return the noise that residuals have, fitted numbers taken off the degrees of freedom."""
    r = found.found.residuals
    free = max(r.size - used(found), 1.0)
    if weights.loss == "linear":
        return max(float(np.sqrt((r @ r) / free)), _LEAST)
    return max(float(_MAD * np.median(np.abs(r)) * np.sqrt(r.size / free)), _LEAST)


def used(found: Fit) -> float:
    """Return how many degrees of freedom the data lose to the unknowns; less with priors."""
    unknowns = found.found.experiment.parameters.unknowns
    if not any(own.prior for own in unknowns):
        return float(len(unknowns))
    J = found.found.jacobian * found.found.experiment.parameters.range / found.noise
    rows = prior_rows(found.found.experiment, found.found.values)[1]
    whole = np.vstack([J, rows])
    return float(np.square(np.linalg.svd(whole, full_matrices=False)[0][: len(J)]).sum())


def prior_rows(experiment: Experiment, values: Array) -> tuple[Array, Array]:
    """Return residuals (m,) of the priors, and their derivatives (m, K) from 0 to 1."""
    unknowns, span = experiment.parameters.unknowns, experiment.parameters.range
    known = [(k, own.prior) for k, own in enumerate(unknowns) if own.prior]
    r = np.array([(values[k] - mean) / std for k, (mean, std) in known])
    J = np.zeros((len(known), len(unknowns)))
    for row, (k, (_, std)) in enumerate(known):
        J[row, k] = span[k] / std
    return r, J


def _guess(experiment: Experiment) -> float:
    """Return a noise to begin with: a hundredth of an arm's length for places."""
    arm = experiment.parameters.built(experiment.parameters.start, "")[0]
    return float(0.01 * arm.length / np.median([shape.std for shape in experiment.shapes]))


def _descent(start: Evaluation, weights: Weights, noise: float, offset: float) -> Fit:
    steps = _Steps(start, weights, noise, offset)
    n_data = start.residuals.size

    def rho(z: Array) -> NDArray[np.float64]:
        rows = np.array(_RHO["linear"](z))
        rows[:, :n_data] = _RHO[weights.loss](z[:n_data])
        return rows

    try:
        scipy.optimize.least_squares(
            steps.residuals,
            np.clip(steps.scaled(start.values), 0.0, 1.0),
            steps.jacobian,
            bounds=(0.0, 1.0),
            loss="linear" if weights.loss == "linear" else rho,
            x_scale="jac",
            xtol=_LEAST,
            ftol=_LEAST,
            gtol=1e-3 * _LEAST,
            max_nfev=_MOST,
        )
    except _OptimumError:
        LOG.debug("optimum after %d evaluations", steps.evaluations)
    found = steps.before
    r = np.concatenate([found.residuals / noise, prior_rows(found.experiment, found.values)[0]])
    cost = float(rho(np.square(r))[0].sum()) / 2
    return Fit(found, steps.differentiated, noise, cost, steps.evaluations)


class _OptimumError(Exception):
    """Ends SciPy's iteration at an optimum, of which it has no such criterion."""


class _Steps:
    """What SciPy calls: z (K,) from 0 to 1; shapes are found from those last differentiated."""

    def __init__(self, start: Evaluation, weights: Weights, noise: float, offset: float) -> None:
        self.experiment, self.weights, self.noise = start.experiment, weights, noise
        self.offset = offset
        self.last = self.before = self.differentiated = start
        self.evaluations = 0
        self._known: tuple[Array, Array, Array] | None = None

    def scaled(self, values: Array) -> Array:
        of = self.experiment.parameters
        return np.asarray((values - of.lower) / of.range)

    def at(self, z: Array) -> Evaluation:
        of = self.experiment.parameters
        values = of.lower + of.range * z
        if not np.allclose(self.scaled(self.last.values), z, rtol=0, atol=1e-14):
            self.evaluations += 1
            self.last = self.experiment.at(values, self.before)
        return self.last

    def residuals(self, z: Array) -> Array:
        check_time()
        try:
            here = self.at(z)
        except (UnsettledShapeError, InputError):
            return np.full(self._rows, np.inf)
        prior, _ = prior_rows(self.experiment, here.values)
        return np.concatenate([here.residuals / self.noise, prior])

    def jacobian(self, z: Array) -> Array:
        """Return the derivatives; raises _OptimumError where they say that there is no more.

        Those before the last step do where residuals have changed as they said: by as much as these
        are off, the derivatives have changed less than twice.
        """
        self.before = here = self.at(z)
        known, jacobian = prior_rows(self.experiment, here.values)
        r = np.concatenate([here.residuals / self.noise, known])
        counted = np.ones(r.size)
        counted[: here.residuals.size] = np.sqrt(self.weights.jacobian(r[: here.residuals.size]))
        if self._known is not None:
            at, before, J = self._known
            told = J @ (z - at)
            off = 2 * float(np.linalg.norm(r - before - told))
            size = max(float(np.linalg.norm(told)), 1e-300)
            if _offset(counted[:, None] * J, counted * r, z) + off / size <= self.offset:
                raise _OptimumError
        self.differentiated = here
        J = np.vstack([here.jacobian * self.experiment.parameters.range / self.noise, jacobian])
        if _offset(counted[:, None] * J, counted * r, z) <= self.offset:
            raise _OptimumError
        self._known = z.copy(), r, J
        return J

    @property
    def _rows(self) -> int:
        return self.before.residuals.size + prior_rows(self.experiment, self.before.values)[0].size


def _offset(J: Array, r: Array, z: Array) -> float:
    """Return what of residuals r (n,) unknowns could explain over what they cannot, each by number.

    `z` (K,) are the unknowns from 0 to 1: those that press against a bound stay there.
    """
    slope = J.T @ r
    held = np.where(slope > 0, z, 1 - z) <= _BOUND
    free = J[:, ~held]
    explained = free @ np.linalg.lstsq(free, r, rcond=None)[0]
    left = max(r.size - free.shape[1], 1)
    unexplained = float(np.linalg.norm(r - explained)) / np.sqrt(left)
    size = float(np.linalg.norm(explained)) / np.sqrt(max(free.shape[1], 1))
    return float(size / max(unexplained, 1e-300))
