"""Least squares over all measured shapes, by SciPy's trust region method with bounds.

Unknowns are counted from lower to upper bound, 0 to 1. Priors are further residuals, which no
robust loss touches. A step to values at which no arm can be, or a shape does not settle, is
shortened: its residuals are infinite, and the trust region shrinks.
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
# The standard deviation of a normal distribution over the median of sizes.
_MEDIAN = 1 / float(scipy.special.ndtri(0.75))
# The least noise, over the standard deviations given; the last step, over the unknowns from 0 to 1.
_LEAST_NOISE, _STEP = 1e-9, 1e-7
# How often degrees of freedom, which depend on the noise if there are priors, are found again, and
# the relative change that is small enough.
_NOISE_ROUNDS, _NOISE_STEP = 5, 0.01
# How near to optima fits come, by the logarithm of the likelihood: where only the best is gone on
# with, and last.
_ROUGHLY, _LAST = 1e-1, 1e-6
# Derivatives serve elsewhere if they tell changes up to so much, over the root of the tolerance: by
# what they are off there the logarithm of the likelihood changes by less than the tolerance. Twice
# as much takes half as many steps more.
_TRUSTED = 0.5


def counted_by(loss: Loss, r: Array) -> Array:
    """Return how much residuals over the noise count against those of a square: rho'."""
    return np.asarray(_RHO[loss](np.square(r))[1])


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The negative logarithm of the likelihood of residuals r and of their noise.

        n log(noise) + 1/2 sum rho((r / noise)^2),

    of squares, rho(z) = z, with the noise where that is least unless it is known: the gradient by r
    is that of fixed noise.

    Attributes
    ----------
    loss : str
    free : float
        n, the degrees of freedom.
    size : int
        How many of the residuals are of data; the rest are of priors, which are in full.
    noise : float
        If it is known, as it is of all losses but squares.
    """

    loss: Loss
    free: float
    size: int
    noise: float | None = None

    def noise_of(self, z: Array) -> float:
        """Return the noise of squared residuals of data."""
        if self.noise is not None:
            return self.noise
        return max(float(np.sqrt(z.sum() / self.free)), _LEAST_NOISE)

    def rho(self, z: Array) -> Array:
        """Return twice the likelihood's terms of squared residuals z, and their derivatives."""
        rows, data = np.array(_RHO["linear"](z)), z[: self.size]
        noise = self.noise_of(data)
        rho, first, second = _RHO[self.loss](data / noise**2)
        if self.noise is None:
            rho += 2 * self.free * np.log(noise) / max(self.size, 1)
        rows[:, : self.size] = rho, first / noise**2, second / noise**4
        return rows


@dataclass(frozen=True, eq=False)
class Fit:
    """A local optimum.

    Attributes
    ----------
    evaluation : Evaluation
        The shapes at the values there.
    noise : float
        What standard deviations are multiplied by, as the residuals say; 1 if they hold as given,
        and without surplus data.
    cost : float
        The negative logarithm of the likelihood, but for a constant.
    refused : dict of OctoplanError
        Why shapes did not settle on the last steps, which end the fit; by number.
    """

    evaluation: Evaluation
    noise: float
    cost: float
    refused: Mapping[int, OctoplanError]


def fit(start: Evaluation, loss: Loss, absolute: bool, first: bool = False) -> Fit:
    """Return the optimum that an evaluation leads to, of the shapes that it has.

    Roughly, of a `first` fit that begins anywhere. Unless standard deviations hold as given
    (`absolute`), the noise of a robust loss is by the median of the residuals where the fit begins:
    near an optimum, or of a first fit at that of Cauchy's loss with the noise by the median before,
    which bounds what outliers add. Source: Huber, "Robust Statistics" (1981), 7.7.

    Without surplus data the residuals are zero whatever the noise is, so that it is 1.
    """
    tolerance, freedom = _ROUGHLY if first else _LAST, _most_freedom(start)
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
        before, freedom = freedom, degrees_of_freedom(result.evaluation, result.noise)
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

    0 without surplus data: if values of the unknowns exist for any data.
    """
    priors = at.experiment.parameters.priors(at.values)[1]
    J = np.vstack([*(J for _, J in at.scaled(noise).values()), priors])
    rank, determined = n_determined(J, _size(at))
    return _size(at) - determined if _size(at) > rank else 0.0


def _median_noise(start: Evaluation) -> float:
    """Return the noise of a normal distribution with the median of the residuals' sizes."""
    sizes = np.abs(np.concatenate([r for r, _ in start.scaled().values()]))
    used = sizes.size / _most_freedom(start)
    return max(float(_MEDIAN * np.median(sizes) * np.sqrt(used)), _LEAST_NOISE)


def _size(at: Evaluation) -> int:
    return sum(map(len, at.residuals.values()))


def _most_freedom(start: Evaluation) -> float:
    """Return the degrees of freedom if priors hold their unknowns; at least 1."""
    free = sum(unknown.prior is None for unknown in start.experiment.parameters.unknowns)
    return max(_size(start) - free, 1)


def _descent(
    start: Evaluation, loss: Loss, noise: float | None, tolerance: float, freedom: float
) -> Fit:
    """Return the optimum of a likelihood with degrees of freedom for its noise, if that is None."""
    steps, parameters = _Steps(start, tolerance), start.experiment.parameters
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
    z = np.square(steps.taken)
    noise = likelihood.noise_of(z[: steps.size])
    known = 0.0 if likelihood.noise is None else likelihood.free * float(np.log(noise))
    return Fit(steps.best, noise, known + float(likelihood.rho(z)[0].sum()) / 2, steps.refused)


class _BlockedError(Exception):
    """No step is short enough for all shapes to settle."""


class _Steps:
    """What SciPy calls: z (K,) from 0 to 1; shapes follow from those last differentiated.

    Attributes
    ----------
    best : Evaluation
        The shapes at the last step that was taken.
    size, priors : int
        Number of residuals of data, and of priors, which come last.
    refused : dict of OctoplanError
        Why shapes did not settle on the steps since then, by number.
    """

    def __init__(self, start: Evaluation, tolerance: float) -> None:
        self.best = self._last = self._differentiated = start
        self._parameters, self._whitening = start.experiment.parameters, start.whitening
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
                self.refused = evaluation.lost or self.refused
            except InputError:
                evaluation = None
            if evaluation is None or evaluation.lost:
                step = z - self._parameters.fractions(self.best.values)
                if np.linalg.norm(step) <= _STEP:
                    raise _BlockedError
                return np.full(self.size + self.priors, np.inf)
            self._last, self._at = evaluation, z.copy()
        return self._residuals(self._last)

    @property
    def taken(self) -> Array:
        """The residuals of data and priors at the last step that was taken."""
        return self._residuals(self.best)

    def _residuals(self, at: Evaluation) -> Array:
        rows = [self._whitening[i] @ r for i, r in at.residuals.items()]
        return np.concatenate([*rows, self._parameters.priors(at.values)[0]])

    def jacobian(self, z: Array) -> Array:
        """Return their derivatives (n, K); the step that led here is taken.

        Those where shapes were differentiated last do where residuals have changed as these said.
        """
        r = self.residuals(z)
        self.best, self.refused = self._last, {}
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
