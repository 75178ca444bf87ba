"""Estimate the load on an arm from measured positions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.modes import stability
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.forward import (
    FINEST,
    FINEST_ACCURACY,
    ORDER,
    REMEDY,
    checked_accuracy,
    estimate,
    next_refinement,
    pair_for,
)
from octoplan.model.loads import check_responses, convergence_order
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import checked_scene, settle
from octoplan.model.support.checks import kind, not_negative, within
from octoplan.model.support.errors import ConvergenceError, InputError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import check_time, limited
from octoplan.planner.extensions.load_estimate.estimate import LoadEstimate
from octoplan.planner.extensions.load_estimate.least_squares import LoadFit, fit_load, load_units
from octoplan.planner.extensions.load_estimate.loaded_arm import LoadedArm, LoadedShape
from octoplan.planner.extensions.load_estimate.readings import Readings, checked_readings

ACCURACY = 1e-4
# Norm of the errors of all predictions due to the mesh, over the smallest standard deviation.
_SHARE_OF_STD = 0.1
# Number of measured coordinates from which force and moment are estimated by default.
_WRENCH = 6
# Stability of the shapes of a second fit, if the first one ends at an unstable shape: compliances
# are at most about 20 times as large as at rest.
_MARGIN = 0.05
# Number of fits if the noise of the tensions changes with the load.
_ROUNDS = 3


def estimate_load(
    arm: Arm,
    scene: Scene | None,
    tensions: Any,
    *,
    tip: Any = None,
    pose: Any = None,
    points: Any = None,
    std: Any,
    angle_std: Any = None,
    tension_std: float = 0.0,
    at: float | Literal["tip"] = "tip",
    moment: bool | None = None,
    near: LoadEstimate | None = None,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    time_limit: float | None = None,
) -> LoadEstimate:
    """Estimate a force and a moment on an arm from its measured shape.

    The load is dead, acts on one cross-section, and adds to the loads of the scene. Maximum
    likelihood for normal noise leads to nonlinear least squares; the implicit function theorem
    gives the derivatives. Source: Rucker, Webster, "Deflection-based force sensing for continuum
    robots: a probabilistic approach" (IROS 2011).

    Parameters
    ----------
    arm : Arm
    scene : Scene or None
        All known loads and effects; None for `Scene()`.
    tensions : (n_sections, n) or (n_tendons,)
        [N], tip section first.
    tip : (3,)
        Measured position of the tip [m]. Pass one of `tip`, `pose` and `points`.
    pose : (position, frame)
        Measured position (3,) [m] and frame (3, 3) of the tip, columns t, n, b.
    points : sequence of (s, offset, position)
        Markers: arc length [m], offset from the midline in the local frame (t, n, b) [m], and
        measured position (3,) [m], with NaN for coordinates that were not seen.
    std : float, (3,) or (n_points, 3)
        Standard deviation of measured coordinates [m].
    angle_std : float or (3,)
        Standard deviation of the rotation of the measured frame about x, y, z [rad].
    tension_std : float
        Standard deviation of each tension that is not 0 [N].
    at : float or "tip"
        Arc length of the loaded cross-section [m].
    moment : bool
        Whether to estimate a moment; otherwise the moment is 0. The default is True if six or more
        coordinates are measured.
    near : LoadEstimate
        A previous estimate for the same arm, scene and place, from which the fit starts. A fit that
        finds no shape nearby starts from the arm without the load.
    accuracy : float
        Allowed error of predicted positions due to the mesh, over the arm's length. The norm of all
        errors is also at most a tenth of the smallest standard deviation.
    compile : bool or "auto"
        Whether to use compiled code, see settle.
    time_limit : float
        Time limit [s].

    Returns
    -------
    LoadEstimate

    Raises
    ------
    InputError
        If an argument is not allowed, or if the scene has contact or is as printed. For contact
        forces, see `Shape.contacts`.
    SnapError, CollapsedError
        If the arm without the load snaps or collapses, see settle.
    ConvergenceError
        If the finest mesh is not accurate enough.
    TimeLimitError
        If the estimate takes longer than `time_limit`.
    CompilerError
        If `compile` is True and no compiler works.
    """
    with limited(time_limit):
        scene = checked_scene(arm, scene)
        check_responses(scene)
        place = _checked_place(arm, at)
        readings = checked_readings(arm, tip, pose, points, std, angle_std)
        if moment is None:
            moment = readings.size >= _WRENCH
        kind("moment", moment, bool | np.bool_, "True, False or None")
        T = arm.flat(tensions)
        problem = _Problem(
            arm=arm,
            scene=scene,
            tensions=T,
            tension_stds=np.where(T > 0, not_negative("tension_std", tension_std), 0.0),
            at=place,
            readings=readings,
            units=load_units(arm, place)[: 6 if moment else 3],
            accuracy=checked_accuracy(accuracy),
            machine_code=checked_compile(compile),
        )
        return problem.solve(_checked_near(near, problem))


def _checked_place(arm: Arm, at: Any) -> float:
    """Return the arc length of the load [m], or raise InputError."""
    place = arm.length if isinstance(at, str) and at == "tip" else at
    if isinstance(place, str):
        raise InputError("at", at, f'"tip", or an arc length up to {arm.length:g} m')
    return within("at", place, 1e-6 * arm.length, arm.length)


def _checked_near(near: LoadEstimate | None, problem: _Problem) -> LoadEstimate | None:
    """Return the previous estimate, or raise InputError."""
    if near is None:
        return None
    kind("near", near, LoadEstimate, "a LoadEstimate, as estimate_load returns it")
    if (near.arm, near.scene, near.at) != (problem.arm, problem.scene, problem.at):
        allowed = "an estimate of the same arm, scene and place"
        raise InputError("near", "an estimate of another arm, scene or place", allowed)
    return near


@dataclass(frozen=True, eq=False)
class _Problem:
    """Arguments of estimate_load after their checks.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    tensions, tension_stds : (n_tendons,)
        [N].
    at : float
        [m].
    readings : Readings
    units : (K,)
        Units of the estimated components.
    accuracy : float
    machine_code : bool
    """

    arm: Arm
    scene: Scene
    tensions: Array
    tension_stds: Array
    at: float
    readings: Readings
    units: Array
    accuracy: float
    machine_code: bool

    @property
    def tolerance(self) -> float:
        """Allowed error of predictions due to the mesh: positions over the length, and angles."""
        least = float((self.readings.std / self.readings.sizes(self.arm.length)).min())
        wanted = _SHARE_OF_STD * least / math.sqrt(self.readings.size)
        return max(min(self.accuracy, wanted), FINEST_ACCURACY)

    def solve(self, near: LoadEstimate | None) -> LoadEstimate:
        """Return the estimate on the first mesh that is accurate enough."""
        refinement = 0
        start: LoadedShape | None = None
        if near is not None:
            refinement = near.refinement
            wrench = near.fit.shape.wrench.copy()
            # A moment that is not estimated is 0, also if the previous estimate has one.
            wrench[self.units.size :] = 0.0
            start = self._equations(refinement).near(near.fit.shape, wrench)
        if start is None:
            shape = settle(self.arm, self.tensions, self.scene, self.tolerance, self.machine_code)
            refinement = max(shape.refinement, 2)
            start = self._equations(refinement).without_wrench(shape.equilibrium)
        order = convergence_order(self.scene, ORDER)
        while True:
            check_time()
            equations = self._equations(refinement)
            fit = self._fit(equations, start)
            stable = is_stable(fit.shape.point)
            if not stable and is_stable(start.point):
                margin = min(_MARGIN, stability(start.point) / 2)
                fit = self._fit(equations, start, margin)
                stable = True
            error = self._mesh_error(fit.shape, refinement, order)
            if error <= self.tolerance or not fit.converged:
                return LoadEstimate.of(
                    arm=self.arm,
                    scene=self.scene,
                    tensions=self.tensions,
                    at=self.at,
                    fit=fit,
                    stable=stable,
                    refinement=refinement,
                    error=error,
                )
            refinement = next_refinement(refinement, error, self.tolerance, order)
            if not refinement:
                raise ConvergenceError(self.tolerance, error, REMEDY)
            finer = self._equations(refinement).near(fit.shape, fit.shape.wrench)
            if finer is None:
                raise ConvergenceError(self.tolerance, error, REMEDY)
            start = finer

    def _equations(self, refinement: int) -> LoadedArm:
        return LoadedArm(
            arm=self.arm,
            scene=self.scene,
            tensions=self.tensions,
            at=self.at,
            readings=self.readings,
            refinement=refinement,
            machine_code=self.machine_code,
        )

    def _fit(
        self, equations: LoadedArm, start: LoadedShape, margin: float | None = None
    ) -> LoadFit:
        """Return the fit on one mesh.

        The noise of the tensions is propagated at the start of each round.
        """
        for _ in range(_ROUNDS if self.tension_stds.any() else 1):
            whitening = self._whitening(equations, start)
            fit = fit_load(equations, self.readings, whitening, start, self.units, margin)
            start = fit.shape
        return fit

    def _whitening(self, equations: LoadedArm, shape: LoadedShape) -> Array:
        """Return the matrix (n, n) that scales the residuals to unit covariance at a shape.

        The noise of the tensions is propagated to the residuals to first order (effective
        variance). Source: Orear, American Journal of Physics 50 (1982).
        """
        if not self.tension_stds.any():
            return np.diag(1 / self.readings.std)
        _, J = self.readings.predictions(equations.poses(shape))
        moved = (J @ equations.poses_by_tensions(shape))[self.readings.seen]
        by_noise = moved * self.tension_stds
        variance = np.diag(np.square(self.readings.std)) + by_noise @ by_noise.T
        return np.asarray(np.linalg.inv(np.linalg.cholesky(variance)))

    def _mesh_error(self, shape: LoadedShape, refinement: int, order: int) -> float:
        """Return the error of the predictions, estimated by a mesh of half the refinement."""
        coarse, _ = pair_for(refinement, FINEST)
        meshes = self._equations(refinement), self._equations(coarse)
        other = meshes[1].near(shape, shape.wrench)
        if other is None:
            return float("inf")
        fine_misses, coarse_misses = (
            self.readings.misses(self.readings.predictions(mesh.poses(each))[0])
            for mesh, each in zip(meshes, (shape, other), strict=True)
        )
        gap = np.abs(fine_misses - coarse_misses) / self.readings.sizes(self.arm.length)
        return float(estimate(gap.max(), coarse, refinement, order))
