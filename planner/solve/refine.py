"""Refine an optimum of a coarse mesh until the settled shape meets the accuracy.

The measurements of a program (poses at the stations, least stretches, compliances, eigenvalues,
tendon lengths) differ from those of the settled shape by the defect d of the mesh. The arm is
settled to a hundredth of the accuracy, d is added to the measurements, and the program is solved
again, warm, on the same coarse mesh; the settled shape then meets the targets. d changes little
from one solution to the next, so that one or two corrections suffice. The remaining error of the
mesh is in the derivatives, and changes the effort by the square of this error. The mesh is refined
if d exceeds 1e-4, unless d is constant.

Source: Stetter, "The defect correction principle and discretization methods", Numer. Math. 29
(1978).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.forward import FINEST_ACCURACY, next_refinement
from octoplan.model.loads import convergence_order, has_unique_equilibrium
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import CollapsedError, OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.planner.program_instance import Bounds, ProgramInstance
from octoplan.planner.solution import KKT_TOLERANCE, NlpSolution
from octoplan.planner.solve.ipopt import OBJECTIVE_SCALE, solve

# Largest number of corrections of a program: by defects, on finer meshes, for other least stable
# modes, and for further stations or nearest points.
CORRECTIONS = 16
# A defect is accepted if its change is at most 1 / SAFETY_FACTOR of the accuracy. Optimality is
# held to 1 / SAFETY_FACTOR of KKT_TOLERANCE.
SAFETY_FACTOR = 3
# Coarser accuracies count as this accuracy, because optimality has the fixed tolerance
# KKT_TOLERANCE [-].
COARSEST_ACCURACY = 1e-6
# Relative error of efforts and margins on a coarse mesh. The test of the stability of an optimum
# takes the number as an absolute tolerance of the eigenvalue, because margins may be small.
COARSE_RTOL = 1e-3
# Defect, over L and in rad, above which the mesh is refined: tensions are off by a few times as
# much.
_REFINE_ABOVE = 1e-4
# Defect above which the settled arm has another shape.
_OTHER_SHAPE = 0.1
# Largest relative change of the effort by the remaining defect [-]. Tensions that hardly change the
# shape change by far more than the shape.
EFFORT_TOL = 1e-5
# Largest number of solves in which tensions at a bound are fixed.
_POLISH_SOLVES = 4


def refine(optimum: NlpSolution) -> NlpSolution | None:
    """Return the optimum whose settled shape has the measurements of the program.

    The measurements agree to a third of the accuracy. Return None if the program does not converge
    on the way, if the arm settles to another shape from rest, or if the arm buckles.
    """
    problem, last, before = optimum.instance.problem, None, np.inf
    shape = _shape_on_mesh(optimum) if optimum.instance.forward.loads_first else None
    tolerance = max(min(problem.accuracy, COARSEST_ACCURACY) / SAFETY_FACTOR, FINEST_ACCURACY)
    with suppress(OctoplanError, np.linalg.LinAlgError):
        for _ in range(CORRECTIONS):
            check_time()
            corrected, change, shape = _corrected(optimum, tolerance, shape)
            if corrected is None:
                return None
            if change <= tolerance:
                last, instance = corrected, corrected.instance
                # The defect enters the gradient of least squares, and of stiffnesses.
                has_objective = instance.target_set.terms.names[3]
                is_effort = instance.options.mode == "exact" and not has_objective
                remaining = _effort_change(corrected) if is_effort else corrected.residual
                # Rounding errors keep the change from falling.
                stagnates = is_effort and remaining > before / 2
                if stagnates or remaining <= (
                    EFFORT_TOL if is_effort else KKT_TOLERANCE / SAFETY_FACTOR
                ):
                    break
                before = remaining
            optimum = polish(corrected)
            if not optimum.converged:
                break
        return last if last is not None and _is_held(last, tolerance) else None
    return None


def _shape_on_mesh(optimum: NlpSolution) -> Shape:
    """Return the shape of an optimum on the mesh of the program.

    Descents end at shapes that the arm takes, so that the arm settles near them: paths from rest
    are long. The end of the refinement settles the arm from rest.
    """
    instance = optimum.instance
    problem = optimum.problem
    point = instance.linearised(optimum.x)
    return Shape(problem.arm, problem.scene, np.inf, point, instance.options.refinement)


def _is_held(optimum: NlpSolution, tolerance: float) -> bool:
    """Return whether the arm takes the shape of a refined optimum from rest."""
    instance = optimum.instance
    if has_unique_equilibrium(instance.arm, instance.scene):
        return True
    error = defect(instance, optimum.x, optimum.settled())
    before = 0.0 if optimum.defect is None else optimum.defect
    return _defect_size(instance, error - before) <= tolerance


def _effort_change(optimum: NlpSolution) -> float:
    """Return the relative change of the effort that satisfies all rows, from the multipliers."""
    m = optimum.instance.program.n_design_rows
    g, lam = optimum.derivatives[1][:m], optimum.lam_g[:m]
    _, _, low, high = optimum.instance.bounds
    violation = np.where(lam > 0, g - high[:m], g - low[:m])
    change = float(np.abs(lam[lam != 0] @ violation[lam != 0]))
    return change / max(optimum.f, np.finfo(float).tiny)


def _corrected(
    optimum: NlpSolution, tolerance: float, near: Shape | None
) -> tuple[NlpSolution | None, float, Shape | None]:
    """Return the optimum with the defect of the settled shape, the change of the defect, the shape.

    The arm is settled near the last shape, or from rest if there is none.

    If the defect is large, and changes by more than the tolerance, return the optimum on a finer
    mesh, and an infinite change. Return None for the optimum if the arm has another shape, or if no
    finer mesh exists.
    """
    instance, before = optimum.instance, optimum.defect
    try:
        shape = optimum.settled(near)
    except CollapsedError as collapse:
        error = collapse_defect(instance, optimum.x, collapse)
        return replace(optimum, defect=error), np.inf, near
    error = defect(instance, optimum.x, shape)
    size = _defect_size(instance, error, reducible=True)
    change = np.inf if before is None else _defect_size(instance, error - before)
    if size <= _REFINE_ABOVE or change <= tolerance:
        return replace(optimum, defect=error), change, shape
    order, mesh = convergence_order(instance.scene, 2 * STAGES), instance.options.refinement
    finer = next_refinement(mesh, size, _REFINE_ABOVE, order) if size <= _OTHER_SHAPE else None
    if not finer:
        return None, np.inf, shape
    on_finer = on_mesh(optimum, instance.replace(refinement=finer), shape)
    return on_finer.with_adjoint(), np.inf, shape


def on_mesh(optimum: NlpSolution, instance: ProgramInstance, shape: Shape) -> NlpSolution:
    """Return an optimum at the equilibrium of a settled shape on the mesh of a problem.

    The optimum has the defect of the shape. Raise the errors of `settle`.
    """
    T = shape.tensions
    x = instance.complete(T, instance.forward_at(shape.arm).solve(T, shape.collocated).states)
    return replace(optimum, instance=instance, x=x, defect=defect(instance, x, shape))


def polish(
    optimum: NlpSolution,
    p: Array | None = None,
    bounds: Bounds | None = None,
    warm: bool = False,
) -> NlpSolution:
    """Return the optimum to the last digits, with tensions exactly at active bounds.

    An interior-point method stops a little inside of the bounds. Tensions whose multiplier exceeds
    the distance to the bound are fixed there, and the program is solved again, warm. Tensions whose
    multiplier then has the wrong sign are released. If too few tensions remain to meet the targets,
    all are released, and the program is solved from a cold start. If this fails, too, the last
    optimum is returned.

    Parameters
    ----------
    optimum : NlpSolution
    p : (n_p,)
        Parameters; by default the problem's, with the defect of the optimum.
    bounds : Bounds
        By default the bounds of the problem.
    warm : bool
        Whether to start warm even if all tensions are released.
    """
    instance, first = optimum.instance, optimum
    p = instance.parameters(defect=optimum.defect) if p is None else p
    n, (lbx, ubx, lbg, ubg) = instance.arm.n_tendons, bounds or instance.bounds
    x, force = optimum.x[:n], optimum.lam_x[:n] * OBJECTIVE_SCALE
    at_low, at_high = x - lbx[:n] < -force, ubx[:n] - x < force
    is_fixed = lbx[:n] == ubx[:n]
    for _ in range(_POLISH_SOLVES):
        low, high = lbx.copy(), ubx.copy()
        high[:n] = np.where(at_low, lbx[:n], ubx[:n])
        low[:n] = np.where(at_high & ~at_low, ubx[:n], lbx[:n])
        multipliers, guess = (optimum.lam_x, optimum.lam_g), np.clip(optimum.x, low, high)
        trial = solve(instance, guess, p, (low, high, lbg, ubg), multipliers, "polish")
        if not trial.converged:
            at_low[:] = at_high[:] = False
            again = (multipliers, "near") if warm else (None, "search")
            trial = solve(instance, optimum.x, p, (lbx, ubx, lbg, ubg), *again)
        if not trial.converged:
            return trial if optimum is first else optimum
        # ipopt returns no multipliers of fixed unknowns.
        at = instance.parameters_at(trial.x, p)
        _, gradient, _, J = instance.program.evaluate(trial.x, at)
        slope, lam_x = gradient + J.T @ trial.lam_g, trial.lam_x.copy()
        lam_x[:n] = np.where(at_low | at_high | is_fixed, -slope[:n], lam_x[:n])
        optimum = replace(
            trial,
            lam_x=lam_x,
            iterations=optimum.iterations + trial.iterations,
            defect=optimum.defect,
        )
        wrong_low, wrong_high = at_low & (lam_x[:n] > 0), at_high & (lam_x[:n] < 0)
        wrong = ~is_fixed & (wrong_low | wrong_high)
        if not wrong.any():
            break
        at_low, at_high = at_low & ~wrong, at_high & ~wrong
    return optimum


def defect(instance: ProgramInstance, x: Array, shape: Shape) -> Array:
    """Return the measurements of a shape minus the measurements at x, see Program.measure."""
    program, on_mesh = instance.program, instance.measured(x)
    coarse = on_mesh[program.poses].reshape(-1, 7)
    poses = shape.poses(np.array([s for s, _ in program.structure.stations]))
    # q and -q are the same rotation.
    opposite = (poses * coarse)[:, :4].sum(axis=1) < 0
    poses[opposite, :4] *= -1
    measured = [poses.ravel()]
    for block, place in zip(instance.blocks, program.measured, strict=True):
        measured.append(block.measure_shape(shape, on_mesh[place]))
    return np.asarray(np.concatenate(measured) - on_mesh)


def collapse_defect(
    instance: ProgramInstance, x: Array, collapse: CollapsedError, before: Array | float = 0.0
) -> Array:
    """Return the defect `before` with the stretch of a cross-section that collapsed."""
    program, on_mesh = instance.program, instance.measured(x)
    corrected = before + np.zeros(on_mesh.size)
    place = program.measured[instance.blocks.index(instance.stretch)]
    nearest = place.start + int(np.abs(np.array(instance.stretch.s) - collapse.s).argmin())
    corrected[nearest] = collapse.stretch - on_mesh[nearest]
    return corrected


def _defect_size(instance: ProgramInstance, defect: Array, reducible: bool = False) -> float:
    """Return the largest component of a defect, lengths over L, angles in rad.

    With `reducible`, only components that a finer mesh of the program reduces count.
    """
    arm, program = instance.arm, instance.program
    pose = np.repeat([0.5, arm.length], [4, 3])  # quaternions change by half the angle
    scales = [np.tile(pose, program.poses.stop // pose.size)]
    for block in instance.blocks:
        counts = block.mesh_reduces_defect or not reducible
        scales.append(block.measurement_scales(arm) * (1.0 if counts else np.inf))
    return float(np.abs(defect / np.concatenate(scales)).max(initial=0.0))
