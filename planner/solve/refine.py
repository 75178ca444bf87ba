"""From an optimum of a coarse mesh to one whose settled shape meets the accuracy, warm.

A program on a coarse mesh has its optimum at a shape whose poses are off by the mesh's error d.
With d, known from the shape settled to the accuracy, added to what the program measures
(poses at the stations, least stretches, compliances, eigenvalues, lengths), it is solved once
more, warm; then the settled shape meets the targets. d changes little from one solution to the
next, so that one or two corrections do. What is left of the mesh's error is in derivatives: the
effort is off by its square. Only where d is large the mesh is made finer.

Source: Stetter, "The defect correction principle and discretization methods", Numer. Math. 29
(1978).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.forward import FINEST_ACCURACY, next_refinement
from octoplan.model.loads import convergence_order
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import CollapsedError, OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.planner.program.problem import KKT_TOLERANCE, Bounds, Candidate, Problem
from octoplan.planner.solve.ipopt import MAGNIFIED, solve

# How often a program is corrected and solved again: by defects and on finer meshes, for other modes
# and other places that come nearest. The part of the accuracy that a defect may be off by, and of
# what optimality is held to.
CORRECTIONS, PART = 16, 3
# What a coarse mesh may be off by of a margin and of effort. Defects over L above which the mesh is
# made finer: tensions are off by a few times as much. What is farther off comes to another shape;
# stretches that are farther from 0 need no correction.
COARSE, _ROUGH, _ELSEWHERE = 1e-3, 1e-4, 0.1
# Part of the effort that what is left of a defect may change. Tensions that the shape hardly shows
# change by far more than the shape.
EFFORT_TOL = 1e-5


def refine(candidate: Candidate) -> Candidate | None:
    """Return the optimum whose settled shape is what its program measures, to the last digits.

    To a part of the accuracy. None where the optimum is lost on the way, and where the arm comes to
    another shape from rest, or buckles.
    """
    task, last, before = candidate.problem.task, None, np.inf
    enough = max(min(task.accuracy, KKT_TOLERANCE) / PART, FINEST_ACCURACY)
    with suppress(OctoplanError, np.linalg.LinAlgError):
        for _ in range(CORRECTIONS):
            check_time()
            corrected, change = _corrected(candidate, enough)
            if corrected is None:
                return None
            if change <= enough:
                last, problem = candidate, candidate.problem
                # The defect enters the gradient of least squares, and of stiffnesses.
                of_stiffness = problem.target_set.own.terms.names[3]
                of_effort = problem.options.mode == "exact" and not of_stiffness
                left = _effort_change(corrected) if of_effort else corrected.residual
                # Rounding keeps it from falling.
                stays = of_effort and left > before / 2
                if stays or left <= (EFFORT_TOL if of_effort else KKT_TOLERANCE / PART):
                    return last
                before = left
            candidate = polish(corrected)
            if not candidate.met:
                return last
        return last
    return None


def _effort_change(candidate: Candidate) -> float:
    """Return the part of the effort that meeting the constraints changes, by their multipliers."""
    m = candidate.problem.n_outer
    g, lam = candidate.derivatives[1][:m], candidate.lam_g[:m]
    _, _, low, high = candidate.problem.bounds
    missed = np.where(lam > 0, g - high[:m], g - low[:m])
    change = float(np.abs(lam[lam != 0] @ missed[lam != 0]))
    return change / max(candidate.f, np.finfo(float).tiny)


def _corrected(candidate: Candidate, enough: float) -> tuple[Candidate | None, float]:
    """Return a candidate with the defect of its shape, and how much that differs from the last.

    Where it is large, and differs by more than is enough, on a finer mesh, which differs by any
    amount. None where the shape is another one, and where there is no such mesh.
    """
    problem, before = candidate.problem, candidate.defect
    try:
        shape = problem.task.settled(candidate.tensions)
    except CollapsedError as crushed:
        return replace(candidate, defect=stretched(problem, candidate.x, crushed)), np.inf
    error = defect(problem, candidate.x, shape)
    size = _defect_size(problem, error, stabilities=np.inf)
    change = np.inf if before is None else _defect_size(problem, error - before)
    if size <= _ROUGH or change <= enough:
        return replace(candidate, defect=error), change
    order, mesh = convergence_order(problem.scene, 2 * STAGES), problem.options.refinement
    finer = next_refinement(mesh, size, _ROUGH, order) if size <= _ELSEWHERE else None
    if not finer:
        return None, np.inf
    return on_mesh(candidate, problem.but(refinement=finer), shape).extended(), np.inf


def on_mesh(candidate: Candidate, problem: Problem, shape: Shape) -> Candidate:
    """Return a candidate as its settled shape is in a problem: in equilibrium, with the defect.

    Raises what settling does.
    """
    T = shape.tensions
    x = problem.closed(T, problem.forward.solve(T, shape.known).states)
    return replace(candidate, problem=problem, x=x, defect=defect(problem, x, shape))


def polish(
    candidate: Candidate,
    p: Array | None = None,
    bounds: Bounds | None = None,
    warm: bool = False,
) -> Candidate:
    """Return the optimum to the last digits: tensions at their bounds are there exactly.

    Of the program with the candidate's defect, unless its parameters are given.

    An interior-point method stops a little inside of them. Those whose multipliers exceed their
    distance are fixed there, and the program is solved once more, warm. Multipliers of the wrong
    sign tell which are let go again. All are where too few are left to meet the targets, and it is
    solved afresh, unless the start is to stay `warm`; if that fails the last optimum is kept.
    """
    problem, begun = candidate.problem, candidate
    p = problem.parameters(defect=candidate.defect) if p is None else p
    n, (lbx, ubx, lbg, ubg) = problem.arm.n_tendons, bounds or problem.bounds
    x, pull = candidate.x[:n], candidate.lam_x[:n] * MAGNIFIED
    at_low, at_high = x - lbx[:n] < -pull, ubx[:n] - x < pull
    even = lbx[:n] == ubx[:n]
    for _ in range(4):
        low, high = lbx.copy(), ubx.copy()
        high[:n] = np.where(at_low, lbx[:n], ubx[:n])
        low[:n] = np.where(at_high & ~at_low, ubx[:n], lbx[:n])
        lam, guess = (candidate.lam_x, candidate.lam_g), np.clip(candidate.x, low, high)
        trial = solve(problem, guess, p, (low, high, lbg, ubg), lam, "polish")
        if not trial.met:
            at_low[:] = at_high[:] = False
            again = (lam, "near") if warm else (None, "search")
            trial = solve(problem, candidate.x, p, (lbx, ubx, lbg, ubg), *again)
        if not trial.met:
            return trial if candidate is begun else candidate
        # It takes unknowns that are fixed for numbers.
        _, gradient, _, J = problem.program.evaluate(trial.x, problem.with_mode(trial.x, p))
        slope, lam_x = gradient + J.T @ trial.lam_g, trial.lam_x.copy()
        lam_x[:n] = np.where(at_low | at_high | even, -slope[:n], lam_x[:n])
        candidate = replace(
            trial,
            lam_x=lam_x,
            iterations=candidate.iterations + trial.iterations,
            defect=candidate.defect,
        )
        wrong = ~even & ((at_low & (lam_x[:n] > 0)) | (at_high & (lam_x[:n] < 0)))
        if not wrong.any():
            break
        at_low, at_high = at_low & ~wrong, at_high & ~wrong
    return candidate


def defect(problem: Problem, x: Array, shape: Shape) -> Array:
    """Return what is measured of the shape less what is of unknowns x: see Program.measured."""
    of, on_mesh = problem.program, problem.measured(x)
    poses = shape.poses(np.array(problem.target_set.stations))
    turned = (poses * on_mesh[: poses.size].reshape(poses.shape))[:, :4].sum(axis=1) < 0
    poses[turned, :4] *= -1
    # Cross-sections that are far from being crushed are as they are on the mesh.
    stretches = on_mesh[poses.size : poses.size + problem.slim_at.size].copy()
    near = stretches <= _ELSEWHERE
    if near.any():
        stretches[near] = 1 + shape.strain(problem.slim_at[near])[:, 3]
    parts = [poses.ravel(), stretches]
    parts += [C.ravel() for C in problem.target_set.own.compliances(shape)]
    parts += [np.array([shape.stability]) for _ in of.modes]
    parts += [shape.tendon_lengths / problem.arm.length for _ in of.lengths]
    return np.asarray(np.concatenate(parts) - on_mesh)


def stretched(
    problem: Problem, x: Array, crushed: CollapsedError, before: Array | float = 0.0
) -> Array:
    """Return a defect whose least stretch is that of a settled arm which is crushed.

    All others are as before.
    """
    of, on_mesh = problem.program.measured, problem.measured(x)
    corrected = before + np.zeros(on_mesh.size)
    worst = of[0] + int(np.abs(problem.slim_at - crushed.s).argmin())
    corrected[worst] = crushed.stretch - on_mesh[worst]
    return corrected


def _defect_size(problem: Problem, defect: Array, stabilities: float = 1.0) -> float:
    """Return the largest part of a defect, lengths over the arm's, angles in rad.

    Stabilities over what is given: those of a settled shape are of its mesh, so that no finer one
    of the program comes nearer to them.
    """
    poses, stretches, compliances, modes, lengths = problem.program.measured
    L = problem.arm.length
    pose = np.repeat([0.5, L], [4, 3])  # quaternions change by half the angle
    of_poses = np.tile(pose, poses // pose.size), np.ones(stretches)
    worth = [*of_poses, np.full(compliances, L / problem.arm.bending_force)]
    worth += [np.full(modes, stabilities), np.ones(lengths)]
    return float(np.abs(defect / np.concatenate(worth)).max(initial=0.0))
