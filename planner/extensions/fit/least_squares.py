"""Least squares over all measured shapes, by SciPy's trust region method with bounds.

The unknowns are scaled to [0, 1] between their bounds. Priors are additional residuals, to which
robust losses do not apply. If a step leads to values of an invalid arm, or at which a shape does
not settle, the residuals are infinite, so that the trust region shrinks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from octoplan.model import InputError, OctoplanError
from octoplan.model.paths import Array
from octoplan.model.support.progress import check_time
from octoplan.planner.extensions.fit.identifiability import n_determined
from octoplan.planner.extensions.fit.residuals import Evaluation
from octoplan.planner.extensions.fit.unknowns import AT_BOUND

LOG = logging.getLogger(__name__)
Loss = Literal["linear", "huber", "soft_l1", "cauchy"]
Rho = tuple[Array, Array, Array]
# rho(z), rho', rho'' of squared residuals z over the noise, as in scipy.optimize.least_squares.
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
# Standard deviation of a normal distribution over the median of the absolute values.
_MEDIAN = 1 / float(scipy.special.ndtri(0.75))
# Smallest noise, over the given standard deviations.
_LEAST_NOISE = 1e-9
# Step tolerance, for unknowns in [0, 1].
_STEP = 1e-7
# Largest number of updates of the degrees of freedom, which depend on the noise if there are
# priors, and the relative change at which the updates stop.
_NOISE_ROUNDS = 5
_NOISE_STEP = 0.01
# Tolerance of the log-likelihood for first fits, of which only the best is continued.
_ROUGHLY = 1e-1
# Tolerance of the log-likelihood for final fits.
_LAST = 1e-6
# Relative error, over the root of the tolerance, up to which a Jacobian must predict the change of
# the residuals to be reused. The log-likelihood then changes by less than the tolerance. With 1
# instead of 0.5, fits take 50 % more steps.
_TRUSTED = 0.5


def loss_weights(loss: Loss, r: Array) -> Array:
    """Return the weights rho' of residuals over the noise; 1 for the linear loss."""
    return np.asarray(_RHO[loss](np.square(r))[1])


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Negative log-likelihood of residuals r and of their noise,

        n log(noise) + 1/2 sum rho((r / noise)^2).

    For the linear loss, rho(z) = z, the noise minimises the expression unless it is given; the
    gradient with respect to r is the one for constant noise.

    Attributes
    ----------
    loss : str
        Name of rho.
    free : float
        Degrees of freedom n.
    size : int
        Number of residuals of data. The remaining residuals belong to priors and have weight 1.
    noise : float
        Given noise; required for robust losses.
    """

    loss: Loss
    free: float
    size: int
    noise: float | None = None

    def noise_of(self, z: Array) -> float:
        """Return the noise for squared residuals of data."""
        if self.noise is not None:
            return self.noise
        return max(float(np.sqrt(z.sum() / self.free)), _LEAST_NOISE)

    def rho(self, z: Array) -> Array:
        """Return twice the terms of the log-likelihood and derivatives, for squared residuals z."""
        rows = np.array(_RHO["linear"](z))
        data = z[: self.size]
        noise = self.noise_of(data)
        rho, first, second = _RHO[self.loss](data / noise**2)
        if self.noise is None:
            rho += 2 * self.free * np.log(noise) / max(self.size, 1)
        rows[:, : self.size] = rho, first / noise**2, second / noise**4
        return rows


@dataclass(frozen=True, eq=False)
class Fit:
    """A local optimum of the likelihood.

    Attributes
    ----------
    evaluation : Evaluation
        Settled shapes at the optimal values.
    noise : float
        Factor of the standard deviations, estimated from the residuals; 1 if the standard
        deviations apply as given, and without surplus data.
    cost : float
        Negative log-likelihood up to a constant.
    refused : dict of OctoplanError
        Errors of the shapes that did not settle on the last steps, by index; these shapes ended the
        fit.
    """

    evaluation: Evaluation
    noise: float
    cost: float
    refused: Mapping[int, OctoplanError]


def fit(start: Evaluation, loss: Loss, absolute: bool, first: bool = False) -> Fit:
    """Minimise the negative log-likelihood from an evaluation, for the shapes that it contains.

    A `first` fit has a coarse tolerance and accepts any initial values. Unless the standard
    deviations apply as given (`absolute`), the noise of a robust loss follows from the median of
    the initial residuals. A first fit of a robust loss starts with Cauchy's loss, which bounds the
    influence of outliers, and takes the median at its optimum. Source: Huber, "Robust Statistics"
    (1981), 7.7.

    Without surplus data the optimal residuals are zero for any noise; the noise is then 1.
    """
    tolerance = _ROUGHLY if first else _LAST
    freedom = _most_freedom(start)
    unknowns = start.experiment.parameters.unknowns
    has_priors = any(unknown.prior is not None for unknown in unknowns)
    noise = 1.0 if absolute or (has_priors and _size(start) <= len(unknowns)) else None
    if loss != "linear" and noise is None:
        if first:
            bounded = _descent(start, "cauchy", _median_noise(start), tolerance, freedom)
            if bounded.refused:
                return bounded
            start = bounded.evaluation
        noise = _median_noise(start)
    result = _descent(start, loss, noise, tolerance, freedom)
    if absolute or first:
        return result
    for _ in range(_NOISE_ROUNDS):
        before = freedom
        freedom = degrees_of_freedom(result.evaluation, result.noise)
        if not freedom:
            if has_priors and noise != 1.0:
                result = _descent(result.evaluation, loss, 1.0, tolerance, 1.0)
            return replace(result, noise=1.0)
        if loss != "linear" or abs(freedom - before) <= _NOISE_STEP * before:
            break
        if not has_priors:
            scaled = result.noise * np.sqrt(before / freedom)
            return replace(result, noise=max(float(scaled), _LEAST_NOISE))
        result = _descent(result.evaluation, loss, None, tolerance, freedom)
    return result


def degrees_of_freedom(at: Evaluation, noise: float) -> float:
    """Return the number of data minus the number of combinations of unknowns that they determine.

    0 without surplus data, that is, if some values of the unknowns fit any data.
    """
    priors = at.experiment.parameters.priors(at.values)[1]
    J = np.vstack([*(J for _, J in at.scaled(noise).values()), priors])
    rank, determined = n_determined(J, _size(at))
    return _size(at) - determined if _size(at) > rank else 0.0


def _median_noise(start: Evaluation) -> float:
    """Return the noise of a normal distribution, from the median of absolute residuals."""
    sizes = np.abs(np.concatenate([r for r, _ in start.scaled().values()]))
    used = sizes.size / _most_freedom(start)
    return max(float(_MEDIAN * np.median(sizes) * np.sqrt(used)), _LEAST_NOISE)


def _size(at: Evaluation) -> int:
    return sum(map(len, at.residuals.values()))


def _most_freedom(start: Evaluation) -> float:
    """Return the degrees of freedom if priors determine their unknowns; at least 1."""
    free = sum(unknown.prior is None for unknown in start.experiment.parameters.unknowns)
    return max(_size(start) - free, 1)


def _descent(
    start: Evaluation, loss: Loss, noise: float | None, tolerance: float, freedom: float
) -> Fit:
    """Minimise from an evaluation; `freedom` applies if `noise` is None."""
    steps = _Steps(start, tolerance)
    parameters = start.experiment.parameters
    likelihood = Likelihood(loss, freedom, steps.size, noise)

    def stop_at_the_optimum(z: Array) -> None:
        if steps.gain(z, likelihood) <= tolerance:
            raise StopIteration

    with suppress(_BlockedError):
        result = scipy.optimize.least_squares(
            steps.residuals,
            np.clip(parameters.fractions(start.values), 0.0, 1.0),
            steps.jacobian,
            bounds=(0.0, 1.0),
            loss=likelihood.rho,
            x_scale="jac",
            xtol=_STEP,
            ftol=None,
            gtol=None,
            callback=stop_at_the_optimum,
        )
        LOG.debug("%s: %s after %d evaluations", loss, result.message, result.nfev)
    z = np.square(steps.accepted)
    noise = likelihood.noise_of(z[: steps.size])
    known = 0.0 if likelihood.noise is None else likelihood.free * float(np.log(noise))
    return Fit(steps.best, noise, known + float(likelihood.rho(z)[0].sum()) / 2, steps.refused)


class _BlockedError(Exception):
    """Some shape does not settle even after the shortest step."""


class _Steps:
    """Residuals and Jacobian for SciPy, as functions of z (K,), the unknowns in [0, 1].

    Shapes are continued from the last differentiated evaluation.

    Attributes
    ----------
    best : Evaluation
        Shapes at the last accepted step.
    size, priors : int
        Number of residuals of data, and of priors, which are last.
    refused : dict of OctoplanError
        Errors of shapes that did not settle on the rejected steps since then, by index.
    """

    def __init__(self, start: Evaluation, tolerance: float) -> None:
        self.best = self._last = self._differentiated = start
        self._parameters = start.experiment.parameters
        self._whitening = start.whitening
        self._at = np.clip(self._parameters.fractions(start.values), 0.0, 1.0)
        self.size = _size(start)
        self.priors = self._parameters.priors(start.values)[0].size
        self.refused: Mapping[int, OctoplanError] = {}
        self._trusted = _TRUSTED * np.sqrt(tolerance)
        self._linear: tuple[Array, Array, Array] | None = None

    def residuals(self, z: Array) -> Array:
        """Return the residuals of data and priors; infinite if a shape does not settle."""
        if not np.array_equal(z, self._at):
            check_time()
            try:
                evaluation = self._differentiated.near(self._parameters.from_fractions(z))
                self.refused = evaluation.failed or self.refused
            except InputError:
                evaluation = None
            if evaluation is None or evaluation.failed:
                step = z - self._parameters.fractions(self.best.values)
                if np.linalg.norm(step) <= _STEP:
                    raise _BlockedError
                return np.full(self.size + self.priors, np.inf)
            self._last = evaluation
            self._at = z.copy()
        return self._residuals(self._last)

    @property
    def accepted(self) -> Array:
        """The residuals of data and priors at the last accepted step."""
        return self._residuals(self.best)

    def _residuals(self, at: Evaluation) -> Array:
        rows = [self._whitening[i] @ r for i, r in at.residuals.items()]
        return np.concatenate([*rows, self._parameters.priors(at.values)[0]])

    def jacobian(self, z: Array) -> Array:
        """Return the derivatives (n, K) of the residuals, and accept the step to z.

        Reuse the last derivatives if they predicted the change of the residuals.
        """
        r = self.residuals(z)
        self.best = self._last
        self.refused = {}
        if self._linear is not None:
            at, before, J = self._linear
            predicted = J @ (z - at)
            if np.linalg.norm(r - before - predicted) <= self._trusted * np.linalg.norm(predicted):
                return J
        scale = self._parameters.range
        self._differentiated = self.best
        rows = [self._whitening[i] @ J * scale for i, J in self.best.jacobians.items()]
        J = np.vstack([*rows, self._parameters.priors(self.best.values)[1]])
        self._linear = self._at, r, J
        return J

    def gain(self, z: Array, likelihood: Likelihood) -> float:
        """Return the log-likelihood that a Gauss-Newton step can gain.

        The gain is half the squared norm of the projection of the residuals onto the columns of the
        unknowns that do not press against a bound. Source: Bates and Watts, "Nonlinear Regression
        Analysis and Its Applications" (1988), 2.2.3.
        """
        r = self.residuals(z)
        weights = np.sqrt(likelihood.rho(np.square(r))[1])
        J = weights[:, None] * self.jacobian(z)
        r = weights * r
        slope = J.T @ r
        free = J[:, np.where(slope > 0, z, 1 - z) > AT_BOUND]
        explained = free @ np.linalg.lstsq(free, r, rcond=None)[0]
        return float(explained @ explained) / 2
