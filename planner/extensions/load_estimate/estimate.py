"""An estimated load, with its covariance and the directions that the data leave undetermined."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from octoplan.model.arm import Arm
from octoplan.model.effects.loads import PointLoad
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.checks import finite_array
from octoplan.model.support.errors import InputError
from octoplan.model.support.text import HtmlRepr, columns
from octoplan.planner.extensions.fit.fitted import checked_level
from octoplan.planner.extensions.fit.identifiability import Direction, direction, sparse_basis
from octoplan.planner.extensions.load_estimate.least_squares import WIDE, LoadFit

# Names of the components of the load.
NAMES = (*(f"force {axis}" for axis in "xyz"), *(f"moment {axis}" for axis in "xyz"))
# Relative singular value below which a direction changes no residual.
_ZERO = 1e-9
# Components of an undetermined direction, over its largest one, below which they are rounding.
_INVOLVED = 1e-3
# Probability of larger residuals below which the model is doubtful.
_UNLIKELY = 1e-3
# Standard deviation, in units of the load, above which the arm is nonlinear within the region.
_NONLINEAR = 0.25


@dataclass(frozen=True, eq=False, repr=False)
class LoadEstimate(HtmlRepr):
    """A force and a moment on one cross-section, estimated from a measured shape.

    Attributes
    ----------
    arm : Arm
    scene : Scene
        The known loads and effects.
    tensions : (n_tendons,)
        [N].
    at : float
        Arc length of the loaded cross-section [m].
    force : (3,)
        In the base frame [N].
    moment : (3,)
        In the base frame [N m].
    covariance : (6, 6)
        Covariance matrix of force and moment, to first order. The diagonal is inf for components of
        undetermined directions; the other entries are the covariance in the determined directions.
        Rows and columns of a moment that is assumed to be 0 are 0.
    information : (6, 6)
        Fisher information, the inverse of the covariance. Undetermined directions have none.
    undetermined : tuple of Direction
        Directions of the load that the measurement does not determine: 100 units in such a
        direction change the measured coordinates by less than the noise, or not at all. The unit
        of force moves the loaded cross-section of the straight arm by `at`, and the unit of moment
        turns it by 1 rad, both to first order. Among the loads that differ in these directions
        alone, the estimate has about the least norm in these units.
    n_data, n_determined : int
        Number of measured coordinates, and of determined directions.
    converged : bool
        Whether the least squares converged. The iteration stops early if the arm buckles or snaps.
    stable : bool
        Whether the shape under the load is stable at constant tensions.
    refinement : int
        Refinement of the mesh.
    error : float
        Estimated error of predictions due to the mesh: positions over the length, and angles [rad].
    fit : LoadFit
        The optimum, with the shape under the load.
    largest_std : float
        Largest standard deviation of a determined direction, in the units of `undetermined`.
    """

    arm: Arm
    scene: Scene
    tensions: Array
    at: float
    force: Array
    moment: Array
    covariance: Array
    information: Array
    undetermined: tuple[Direction, ...]
    n_data: int
    n_determined: int
    converged: bool
    stable: bool
    refinement: int
    error: float
    fit: LoadFit
    largest_std: float

    @classmethod
    def of(
        cls,
        arm: Arm,
        scene: Scene,
        tensions: Array,
        at: float,
        fit: LoadFit,
        stable: bool,
        refinement: int,
        error: float,
    ) -> LoadEstimate:
        """Return the estimate of a fit."""
        units = fit.units
        K = units.size
        padded = np.vstack([fit.jacobian, np.zeros((K, K))])
        _, sizes, V = np.linalg.svd(padded, full_matrices=False)
        seen = sizes * WIDE > 1
        covariance = np.zeros((6, 6))
        information = np.zeros((6, 6))
        along = V[seen] * units
        covariance[:K, :K] = (along.T / np.square(sizes[seen])) @ along
        across = V[seen] / units
        information[:K, :K] = (across.T * np.square(sizes[seen])) @ across
        involved = (np.abs(V[~seen]) > _INVOLVED).any(axis=0)
        covariance[np.flatnonzero(involved), np.flatnonzero(involved)] = np.inf
        is_null = sizes <= _ZERO * sizes[0]
        weak = [*zip(V[~seen & ~is_null], 1 / sizes[~seen & ~is_null], strict=True)]
        weak += [(v / np.linalg.norm(v), np.inf) for v in sparse_basis(V[is_null])]
        names = NAMES[:K]
        unit_names = ("N",) * 3 + ("N m",) * (K - 3)
        return cls(
            arm=arm,
            scene=scene,
            tensions=tensions,
            at=at,
            force=fit.shape.wrench[:3].copy(),
            moment=fit.shape.wrench[3:].copy(),
            covariance=covariance,
            information=information,
            undetermined=tuple(
                direction(v, float(std), names, units, unit_names) for v, std in weak
            ),
            n_data=fit.residuals.size,
            n_determined=int(seen.sum()),
            converged=fit.converged,
            stable=stable,
            refinement=refinement,
            error=error,
            fit=fit,
            largest_std=float((1 / sizes[seen]).max(initial=0.0)),
        )

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals over their variances."""
        return self.fit.chi2

    @property
    def has_moment(self) -> bool:
        """Whether the moment was estimated; otherwise the moment is assumed to be 0."""
        return self.fit.units.size > 3

    @property
    def std(self) -> Array:
        """Standard deviations of force [N] and moment [N m] (6,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def load(self) -> PointLoad:
        """The load as an effect: settle the arm in `scene + load`."""
        x, y, z = self.force.tolist()
        u, v, w = self.moment.tolist()
        return PointLoad(self.at, (x, y, z), (u, v, w) if self.moment.any() else None)

    def holds(self, force: Any, moment: Any = None, level: float = 0.95) -> bool:
        """Return whether the region of a confidence level contains a force [N] and moment [N m].

        The region contains the loads whose sum of squares exceeds `chi2` by at most the quantile of
        the chi-square distribution with `n_determined` degrees of freedom (likelihood ratio). For
        small noise the region is the ellipsoid of `covariance`. Directions that are undetermined
        are unbounded. Raise InputError if the estimate has a moment and none is given, if a vector
        does not have 3 finite numbers, or if the level is not between 0 and 1.
        """
        wrench = np.zeros(6)
        wrench[:3] = finite_array("force", force, (3,))
        if moment is not None:
            wrench[3:] = finite_array("moment", moment, (3,))
        elif self.has_moment:
            raise InputError("moment", moment, "3 numbers [N m]: the estimate has a moment")
        largest = self._quantile(level)
        return not self.n_determined or self.fit.chi2_at(wrench) - self.chi2 <= largest

    def nonlinearity(self, level: float = 0.95) -> float:
        """Return the largest relative error of the ellipsoid of a confidence level.

        The root of the increase of `chi2` is compared with its first-order value at both ends of
        each axis of the ellipsoid; the largest relative difference is returned, or inf if the arm
        has no shape at an end. Use `holds` instead of the covariance if the value is above 0.5.
        Raise InputError if the level is not between 0 and 1.
        """
        largest = self._quantile(level)
        _, sizes, V = np.linalg.svd(self.fit.jacobian, full_matrices=False)
        errors = [0.0]
        for size, v in zip(sizes[: self.n_determined], V, strict=False):
            for sign in (-1, 1):
                wrench = self.fit.shape.wrench.copy()
                wrench[: v.size] += sign * math.sqrt(largest) / size * v * self.fit.units
                increase = max(self.fit.chi2_at(wrench) - self.chi2, 0.0)
                errors.append(abs(math.sqrt(increase / largest) - 1))
        return max(errors)

    @property
    def outcome(self) -> str:
        """The load in one sentence, and the reasons to doubt the estimate with one remedy each."""
        lines = [f"Force {_with_std(self.force, self.std[:3])} N"]
        if self.has_moment:
            lines[0] += f", moment {_with_std(self.moment, self.std[3:])} N m"
        place = "on the tip" if self.at == self.arm.length else f"at s = {1e3 * self.at:g} mm"
        lines[0] += f" {place}."
        if not self.converged:
            lines.append(
                "The least squares stopped early: the arm snaps or buckles near this load."
            )
        if self._is_unlikely:
            size = np.sqrt(self.chi2 / max(self.n_data - self.n_determined, 1))
            lines.append(
                f"No load {place} explains the shape: residuals are {size:.3g} times the noise; "
                "check `at`, the tensions and `std`, and calibrate the arm."
            )
        if not self.stable:
            lines.append("The shape under this load is unstable: doubt the estimate.")
        lines += [f"Undetermined: {each}." for each in self.undetermined]
        if self.largest_std > _NONLINEAR:
            lines.append(
                f"One direction has a standard deviation of {self.largest_std:.2g} times the load "
                "that bends the arm by its length, too large for the covariance: use `holds`."
            )
        return " ".join(lines)

    def _quantile(self, level: float) -> float:
        """Return the quantile of the chi-square distribution with `n_determined` degrees."""
        level = checked_level(level)
        if not self.n_determined:
            return 0.0
        return float(scipy.special.chdtri(self.n_determined, 1 - level))

    @property
    def _is_unlikely(self) -> bool:
        """Whether noise alone hardly explains the residuals."""
        freedom = max(self.n_data - self.n_determined, 1)
        return bool(scipy.special.chdtrc(freedom, self.chi2) < _UNLIKELY)

    def __repr__(self) -> str:
        rows = [["", "estimate", "standard deviation"]]
        units = ["N"] * 3 + ["N m"] * 3
        values = [*self.force.tolist(), *self.moment.tolist()]
        for name, unit, value, std in zip(NAMES, units, values, self.std.tolist(), strict=True):
            rows.append([f"  {name} [{unit}]", f"{value:.4g}", f"{std:.2g}"])
        return "\n".join([*columns(rows), "", self.outcome])


def _with_std(vector: Array, std: Array) -> str:
    """Return a vector with its standard deviations as text."""
    parts = [f"{x:.3g} ± {s:.2g}" for x, s in zip(vector.tolist(), std.tolist(), strict=True)]
    return f"({', '.join(parts)})"
