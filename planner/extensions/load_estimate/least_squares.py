"""Least squares for the load: a trust region whose steps are measured in loads.

Residuals are whitened. Weak rows w / WIDE, with the load w in units of `load_units`, make the
problem regular: components of the load that change no residual converge to 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.paths import Array
from octoplan.planner.extensions.load_estimate.loaded_arm import LoadedArm, LoadedShape
from octoplan.planner.extensions.load_estimate.readings import Readings

# Standard deviation of a load, in units of `load_units`, from which a direction is undetermined.
# To first order such a load moves its cross-section by 100 arm lengths. The weak rows shift an
# estimate w by at most w std / WIDE^2 of its standard deviation std, all in units.
WIDE = 100.0
# Gradient of half the sum of squares by the load over its standard deviation, at convergence.
_GRADIENT_TOL = 1e-3
# Status of `least_squares` if the gradient is within the tolerance.
_BY_GRADIENT = 1
# Largest number of loads that are evaluated.
_MAX_EVALUATIONS = 100
# Number of arc lengths at which the bending stiffness is sampled.
_SAMPLES = 257


@dataclass(frozen=True, eq=False)
class LoadFit:
    """The optimum of a fit.

    Attributes
    ----------
    arm : LoadedArm
    readings : Readings
    whitening : (n, n)
        Matrix that scales the residuals to unit covariance.
    units : (K,)
        Units of the estimated components, force before moment.
    shape : LoadedShape
    residuals : (n,)
        Whitened residuals.
    jacobian : (n, K)
        Derivatives of the whitened residuals by the K estimated components, in their units.
    converged : bool
        Whether the gradient is within the tolerance.
    """

    arm: LoadedArm
    readings: Readings
    whitening: Array
    units: Array
    shape: LoadedShape
    residuals: Array
    jacobian: Array
    converged: bool

    @property
    def chi2(self) -> float:
        """Sum of the squared whitened residuals."""
        return float(self.residuals @ self.residuals)

    def chi2_at(self, wrench: Array) -> float:
        """Return the sum under another wrench (6,); inf if the arm has no shape on the way."""
        shape = self.arm.followed(self.shape, wrench)
        if shape is None:
            return float("inf")
        predicted, _ = self.readings.predictions(self.arm.poses(shape))
        return float(np.square(self.whitening @ self.readings.misses(predicted)).sum())


def load_units(arm: Arm, at: float) -> Array:
    """Return units of force (3,) [N] and of moment (3,) [N m] on a cross-section (6,).

    On the straight arm without tension, to first order, the unit of force moves the cross-section
    across the arm by `at`, and the unit of moment turns it by 1 rad: at / F = int (at - s)^2 / EJ
    ds, and 1 / M = int 1 / EJ ds.
    """
    s = np.linspace(0.0, at, _SAMPLES)
    EJ = arm.section_stiffness(s)[0, 1:3].min(axis=0)
    force = at / scipy.integrate.simpson((at - s) ** 2 / EJ, x=s)
    moment = 1 / scipy.integrate.simpson(1 / EJ, x=s)
    return np.repeat([force, moment], 3)


def fit_load(
    arm: LoadedArm,
    readings: Readings,
    whitening: Array,
    start: LoadedShape,
    units: Array,
    margin: float | None = None,
) -> LoadFit:
    """Return the load of the least whitened residuals, from the load of `start`.

    Parameters
    ----------
    whitening : (n, n)
        Matrix that scales the residuals to unit covariance.
    units : (K,)
        Units of the estimated components, force before moment.
    margin : float
        Smallest stability of the shapes that are accepted; None accepts unstable shapes. The fit
        may stop early where the arm buckles.
    """
    objective = _Objective(arm, readings, whitening, start, units, margin)
    found = scipy.optimize.least_squares(
        objective.residuals,
        np.zeros(units.size),
        objective.jacobian,
        method="trf",
        x_scale=objective.scale,
        ftol=None,
        xtol=1e-12,
        gtol=_GRADIENT_TOL,
        max_nfev=_MAX_EVALUATIONS,
    )
    shape = objective.evaluated(found.x)
    assert shape is not None
    n = readings.size
    return LoadFit(
        arm=arm,
        readings=readings,
        whitening=whitening,
        units=units,
        shape=shape,
        residuals=found.fun[:n],
        jacobian=objective.whitened_jacobian(shape),
        converged=found.status == _BY_GRADIENT,
    )


class _Objective:
    """Residuals and Jacobian by whitened unknowns x: load = origin + basis x, in units.

    At the start, a unit of x is one standard deviation, and singular vectors of the Jacobian are
    the directions of x. The first trust region contains loads of one unit.

    Attributes
    ----------
    scale : (K,)
        Standard deviations of x per unit of load.
    """

    def __init__(
        self,
        arm: LoadedArm,
        readings: Readings,
        whitening: Array,
        start: LoadedShape,
        units: Array,
        margin: float | None,
    ) -> None:
        self._arm = arm
        self._readings = readings
        self._whitening = whitening
        self._units = units
        self._margin = margin
        self._origin = start.wrench[: units.size] / units
        self._weak = np.eye(units.size) / WIDE
        # The shape from which others are predicted, and shapes by unknowns.
        self._base = start
        self._shapes: dict[bytes, LoadedShape | None] = {np.zeros(units.size).tobytes(): start}
        J = np.vstack([self.whitened_jacobian(start), self._weak])
        _, self.scale, V = np.linalg.svd(J, full_matrices=False)
        self._basis = V.T / self.scale

    def evaluated(self, x: Array) -> LoadedShape | None:
        """Return the shape at x (K,), or None if no shape is near the last accepted shape."""
        key = x.tobytes()
        if key not in self._shapes:
            wrench = np.zeros(6)
            wrench[: x.size] = self._load(x) * self._units
            shape = self._arm.near(self._base, wrench)
            if self._margin is not None and shape is not None:
                shape = shape if is_stable(shape.point, self._margin) else None
            self._shapes = {key: shape}
        return self._shapes[key]

    def residuals(self, x: Array) -> Array:
        """Return residuals and weak rows (n + K,); infinite without a shape."""
        shape = self.evaluated(x)
        if shape is None:
            return np.full(self._readings.size + x.size, np.inf)
        predicted, _ = self._readings.predictions(self._arm.poses(shape))
        misses = self._whitening @ self._readings.misses(predicted)
        return np.concatenate([misses, self._weak @ self._load(x)])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of the residuals by x (n + K, K); accept the shape."""
        shape = self.evaluated(x)
        assert shape is not None
        self._base = shape
        J = np.vstack([self.whitened_jacobian(shape), self._weak])
        return np.asarray(J @ self._basis)

    def whitened_jacobian(self, shape: LoadedShape) -> Array:
        """Return the derivatives of the whitened residuals by the load in units (n, K)."""
        _, J = self._readings.predictions(self._arm.poses(shape))
        moved = J @ self._arm.poses_by_wrench(shape)[..., : self._units.size]
        return np.asarray(self._whitening @ moved[self._readings.seen] * self._units)

    def _load(self, x: Array) -> Array:
        return np.asarray(self._origin + self._basis @ x)
