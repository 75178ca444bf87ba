"""From an optimum of the coarse mesh to that of a mesh as fine as the accuracy asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.equilibrium.forward import STAGES, Collocation
from model.errors import OctoplanError
from model.loads import is_loaded
from model.mesh_refinement import REFINEMENTS, next_refinement
from model.paths import Array
from model.settle import settle
from model.shape import Shape
from model.stiffness import stiffness
from planner.measure import measure
from planner.program.limits import Limits
from planner.program.problem import Bounds, Problem, is_explicit
from planner.program.statement import Mode, Statement
from planner.program.terms import compliance_requests, stations_of
from planner.solve.ipopt import Solution, solve
from planner.solve.newton import newton, optimality
from planner.solve.sqp import solve_quadratic
from planner.solve.task import Task

# What counts as optimal, of that a certificate allows.
_OPTIMAL = 1e-7
# Coarse optima so near to the best may be better than it is; where gaps are made least, the coarse
# mesh's own error blurs them.
_RIVAL, _BLUR, _MOST = 0.05, 1e-6, 4
_SAME = 1e-3
_MESHES = 3
# From a coarse mesh to one so many times finer there are others in between.
_FARTHER = 4
_FINE_IF_UNSETTLED = 16
# The part of the accuracy that a plan's mesh may take; what is estimated of it is cautious.
_SHARE = 4
# Weights on effort between that of a search for the stiffest shape and the least.
_LESS = (1e-5, 1e-7, 1e-9)


@dataclass(frozen=True, eq=False)
class Fine:
    """An optimum on a fine mesh.

    Attributes
    ----------
    worst : float
        Its residual of the first-order conditions.
    shape : Shape or None
        The shape that it settles in, where that was looked at.
    """

    statement: Statement
    solution: Solution
    worst: float
    shape: Shape | None = None

    @property
    def optimal(self) -> bool:
        """Whether it is an optimum of the fine mesh."""
        return self.worst <= _OPTIMAL


def refine_best(coarse: Sequence[tuple[Task, Solution]], mode: Mode) -> Fine:
    """Return the best of coarse optima on the fine mesh; `optimal` is False if none is one there.

    Each comes with its task. Which is best is decided there among all that are nearly so, and an
    optimum that only the coarse mesh has is left for the next.
    """
    finished: list[Fine] = []
    limit, last = np.inf, -np.inf
    for task, solution in sorted(coarse, key=lambda own: own[1].f):
        if solution.f > limit or len(finished) == _MOST:
            break
        if solution.f <= last + _SAME * abs(last):
            continue
        last = solution.f
        finished.append(refine(task, solution, mode))
        if finished[-1].optimal and limit == np.inf:
            limit = last * (1 + _RIVAL) + (0.0 if mode == "exact" else _BLUR)
    return best_of(finished)


def best_of(finished: list[Fine]) -> Fine:
    """Return the optimum of least objective, or what is nearest to one."""
    optimal = [fine for fine in finished if fine.optimal]
    if optimal:
        return min(optimal, key=lambda fine: fine.solution.f)
    return min(finished, key=lambda fine: fine.worst)


def refine(task: Task, coarse: Solution, mode: Mode) -> Fine:
    """Return the optimum of the fine mesh near a coarse one, to the last digits.

    The mesh is chosen for the coarse tensions, and again where those found want a finer one. Least
    squares are brought to their last digits on the coarse mesh, where effort has to be found in
    them by many steps; the fine mesh takes a few more.
    """
    guess, used = coarse.free(task.problem(task.coarse(mode))), 0
    if mode != "exact":
        if compliance_requests(task.targets):
            guess = _less_traced(task, mode, guess)
        guess = _finish(task, task.coarse(mode), guess, None).solution
    mesh, shape = _mesh(task, task.tensions(guess), None)
    for _ in range(_MESHES):
        finer = [r for r in REFINEMENTS if task.coarse(mode).refinement < r < mesh]
        few = [r for r in finer if r * _FARTHER <= mesh][_FARTHER - 1 :: _FARTHER]
        fine, used = _by_meshes(task, mode, guess, [*few, mesh], shape), mesh
        if not fine.optimal and few != finer:
            fine = best_of([fine, _by_meshes(task, mode, guess, [*finer, mesh], shape)])
        guess = fine.solution
        if not fine.optimal:
            break
        mesh, shape = _mesh(task, task.tensions(guess), shape)
        if mesh <= used:
            return replace(fine, shape=shape)
    return fine


def _less_traced(task: Task, mode: Mode, guess: Solution) -> Solution:
    """Return an optimum of the coarse mesh with a weight on effort that is less and less."""
    problem, limits = task.problem(task.coarse(mode)), task.allowed
    problem.condensed.forget()
    for trace in _LESS:
        p = problem.parameters(task.targets, limits, trace)
        guess = newton(problem, guess, p, problem.free_bounds(limits))
    return guess


def _on_mesh(task: Task, mode: Mode, guess: Solution, mesh: int, near: Shape | None) -> Fine:
    """Return the optimum of a mesh near a guess and a shape."""
    statement = task.statement.but(mode=mode, scheme=task.fine_scheme, refinement=mesh)
    return _finish(task, statement, guess, near)


def _by_meshes(
    task: Task, mode: Mode, guess: Solution, meshes: list[int], near: Shape | None
) -> Fine:
    """Return the optimum of the last mesh by way of those before it, unless it is lost there."""
    for mesh in meshes[:-1]:
        fine = _on_mesh(task, mode, guess, mesh, near)
        if not fine.optimal:
            break
        guess = fine.solution
    return _on_mesh(task, mode, guess, meshes[-1], near)


def _finish(task: Task, statement: Statement, coarse: Solution, near: Shape | None) -> Fine:
    problem, limits = task.problem(statement), task.allowed
    problem.condensed.forget(None if near is None else near.known)
    p, bounds = problem.parameters(task.targets, limits), problem.free_bounds(limits)

    def worst(s: Solution) -> float:
        return optimality(problem, s.x, p, s.lam_x, s.lam_g, bounds).worst

    guess = _warm(task, problem, coarse, p)
    best = newton(problem, guess, p, bounds)
    if best is guess and worst(guess) > _OPTIMAL:
        solved = _closer(problem, guess, p, bounds, limits)
        polished = newton(problem, solved, p, bounds) if solved.finite else guess
        best = min((polished, guess), key=worst)
    return Fine(statement, replace(best, f=problem.condensed.first(best.x, p).f), worst(best))


def _closer(
    problem: Problem, guess: Solution, p: Array, bounds: Bounds, limits: Limits
) -> Solution:
    """Return what quadratic programs make of a guess without states, or else ipopt does.

    The guess itself where the arm does not settle on this mesh.
    """
    try:
        x = problem.unknowns(problem.tensions(guess.x, limits), limits, p)
    except OctoplanError:
        return guess
    solved = solve_quadratic(problem, x, p, bounds, guess.lam_g)
    if solved is None or not solved.met:
        return solve_again(problem, guess, p, limits)
    return solved.free(problem)


def solve_again(problem: Problem, guess: Solution, p: Array, limits: Limits) -> Solution:
    """Return what the solver makes of a guess without states, from its multipliers, warm."""
    x = problem.unknowns(problem.tensions(guess.x, limits), limits, p)
    multipliers = problem.condensed.multipliers(guess.x, p, guess.lam_x, guess.lam_g)
    return solve(problem, x, p, problem.bounds(limits), multipliers).free(problem)


def _warm(task: Task, problem: Problem, coarse: Solution, p: Array) -> Solution:
    """Return the coarse solution as a guess on the fine mesh; multipliers carry over."""
    x = problem.free(task.tensions(coarse), task.allowed)
    if problem.n_lack:
        x = problem.unknowns(task.tensions(coarse), task.allowed, p)[: problem.n_free]
    return replace(coarse, x=x, g=problem.condensed.first(x, p).g)


def _mesh(task: Task, T: Array, near: Shape | None) -> tuple[int, Shape | None]:
    """Return the mesh on which tensions settle to a part of the accuracy, and the shape.

    In all that the targets look at: between base and tip, in turns and in stiffness, it may take a
    finer one than the tip's place does. The next finer one where tensions are the only unknowns:
    there it costs little.
    """
    fine, requests = task.accuracy / _SHARE, compliance_requests(task.targets)
    try:
        asked, by = (task.arm, T, task.scene), task.machine_code
        shape = settle(*asked, fine, compile=by, near=near)
        mesh = shape.refinement
        if not task.is_point:
            sharp = settle(*asked, max(fine / 30, 1e-12), compile=by, near=shape)
            mesh = mesh if _apart(task, shape, sharp) <= fine else sharp.refinement
        for request in requests:
            found = stiffness(*asked, request.hold, accuracy=fine, compile=by)
            mesh = max(mesh, found.refinement)
        if is_explicit(task.scene, task.statement, requests):
            mesh = next((finer for finer in REFINEMENTS if finer > mesh), mesh)
        elif not is_loaded(task.scene):
            mesh = _collocated(task, shape, mesh, fine)
    except OctoplanError:
        return _FINE_IF_UNSETTLED, None
    return mesh, shape


def _collocated(task: Task, shape: Shape, mesh: int, fine: float) -> int:
    """Return a mesh on which collocation has the poses that a shape in closed form has."""
    stations, point = stations_of(task.arm, task.targets), task.is_point
    wanted = shape.poses(np.array(stations))
    for _ in range(_MESHES):
        form = (STAGES, mesh, stations, False, task.machine_code)
        forward = Collocation(task.arm, task.scene, *form)
        rows = forward.run(shape.tensions)[0]
        found = rows[[forward.mesh.node(s) for s in stations], :7]
        turned = 2 * (1 - np.abs((found[:, :4] * wanted[:, :4]).sum(axis=1)))
        shift = np.linalg.norm(found[:, 4:] - wanted[:, 4:], axis=1) / task.arm.length
        gap = float(max(shift.max(), 0.0 if point else 2 * np.sqrt(np.maximum(turned, 0)).max()))
        if gap <= fine:
            break
        mesh = next_refinement(mesh, gap, fine, forward.order) or mesh
    return mesh


def _apart(task: Task, shape: Shape, other: Shape) -> float:
    """Return how much two shapes differ in what the targets measure of them, stiffness aside."""
    targets = tuple(target for target in task.targets if target.compliance_request() is None)
    if not targets:
        return 0.0
    stations, none = np.array(stations_of(task.arm, targets)), np.zeros(0)
    measured = (measure(task.arm, targets, one.poses(stations), none) for one in (shape, other))
    here, there = ([v for kind in found for v in kind.values()] for found in measured)
    return max(float(np.abs(a - b).max()) for a, b in zip(here, there, strict=True))
