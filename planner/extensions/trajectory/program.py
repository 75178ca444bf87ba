"""Nonlinear program over all waypoints of a motion, coupled by rates of tensions and strokes.

The variables are the variables x_k of each waypoint's program (tensions a_k, states, tendon lengths
l_k), and the durations d_m from target to target. Waypoint k takes the fraction s_k of the
duration.

    minimise    sum effort(a_k) + w sum d_m
    subject to  g_k(x_k) within bounds                      the constraints of each waypoint
                |a_k - a_(k-1)| <= rate s_k d_m             |l_k - l_(k-1)| <= stroke rate s_k d_m
                d_m >= prescribed duration, if any

Jacobian and Hessian are block-diagonal except for the coupling rows, which are linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.rod.kernels import Places
from octoplan.model.support.progress import check_time
from octoplan.planner.blocks import TendonLengths
from octoplan.planner.extensions.base_joints.block import JointBlock
from octoplan.planner.extensions.base_joints.placement import JointPlacement
from octoplan.planner.extensions.trajectory.question import Question, Waypoint
from octoplan.planner.extensions.trajectory.side_by_side import Part, SideBySide, joined
from octoplan.planner.program import Program
from octoplan.planner.program_instance import ProgramInstance, tension_scales
from octoplan.planner.solution import SolverResult
from octoplan.planner.solve.ipopt import SIDE_BY_SIDE, WARM

Indices = tuple[int, ...]
# Weight of effort over time if the objective is time. If the objective is effort, the weight of
# time beyond the prescribed durations is an exact penalty.
_WEIGHT = 3e-3
# Lower bound of effort and time in the scaling of the objective.
_LEAST = 1e-3
# Options of ipopt to continue from an optimum after a change of defects.
_AGAIN = WARM | {"tol": 1e-8, "constr_viol_tol": 1e-9, "mu_init": 1e-8}


class MotionProgram:
    """Program over all waypoints of a motion."""

    def __init__(
        self,
        question: Question,
        waypoints: Sequence[Waypoint],
        instances: Sequence[ProgramInstance],
    ) -> None:
        self._instances = instances
        guess = [each.guess(w.tensions, True) for w, each in zip(waypoints, instances, strict=True)]
        # Index of the target to which each waypoint leads.
        group = np.cumsum([0, *(bool(waypoint.targets) for waypoint in waypoints[:-1])])
        fractions = np.array([waypoint.fraction for waypoint in waypoints])
        programs = tuple(instance.program for instance in instances)
        places, start, rate = _limited(question, programs)
        values = [start, *(x[list(at)] for x, at in zip(guess, places, strict=True))]
        slowest = (np.abs(np.diff(values, axis=0)) / rate).max(axis=1, initial=0.0) / fractions
        prescribed = np.zeros(group[-1] + 1) if question.steps is None else question.steps
        needed = prescribed.copy()
        np.maximum.at(needed, group, slowest)
        unit = max(float(needed.max()), _LEAST)
        effort = sum(
            float(instance.program.evaluate(x, instance.parameters())[0][0])
            for instance, x in zip(instances, guess, strict=True)
        )
        penalty = max(effort, _LEAST) * unit / max(float(needed.sum()), _LEAST)
        weights = np.array([_WEIGHT, penalty]) / (1.0 if question.steps is None else _WEIGHT)
        self._values = [weights, start, rate * unit, fractions]
        coupling = np.zeros(2 * rate.size * len(waypoints))
        self._bounds = joined(
            [instance.bounds for instance in instances],
            (prescribed / unit, np.full(prescribed.size, np.inf)),
            (coupling - np.inf, coupling),
        )
        self._guess = np.concatenate([*guess, needed / unit])
        self._stated = _stated(programs, tuple(group.tolist()), places)

    def solve(
        self, each: Sequence[Array], before: SolverResult | None = None
    ) -> tuple[SolverResult, list[Array]]:
        """Return the optimum for parameters of each waypoint, and the variables of each waypoint.

        Warm-start from the optimum for other parameters if given, and start cold if this fails.
        """
        x = self._guess if before is None else before.x
        solution = None
        p = self._parameters(each, x)
        if before is not None:
            multipliers = before.lam_x, before.lam_g
            solution = self._stated.solve(_AGAIN, x, p, self._bounds, multipliers)
        if solution is None or not solution.converged:
            solution = self._stated.solve(SIDE_BY_SIDE, x, p, self._bounds)
        check_time()
        return solution, self._stated.split(solution.x)[:-1]

    def violation(self, solution: SolverResult, each: Sequence[Array]) -> float:
        """Return the largest bound violation of the constraints for other parameters."""
        rows = self._stated.values(solution.x, self._parameters(each, solution.x))[1].full().ravel()
        low, high = self._bounds[2:]
        return float(np.maximum(low - rows, rows - high).max())

    def _parameters(self, each: Sequence[Array], x: Array) -> Array:
        """Return the parameters of the program, with the signs of modes as in variables x."""
        of_each = zip(self._instances, self._stated.split(x), each, strict=False)
        parts = [instance.parameters_at(part, p) for instance, part, p in of_each]
        return np.concatenate([*self._values, *parts])


def _limited(
    question: Question, programs: Sequence[Program]
) -> tuple[tuple[Indices, ...], Array, Array]:
    """Return the rate-limited variables: indices in each waypoint, initial values, and rates.

    Initial values and rates (m,) are in the units of the variables.
    """
    rates = question.rates
    unit = tension_scales(question.arm, question.limits)
    rate = np.array(rates.tension)
    L = question.arm.length
    j = np.flatnonzero(np.isfinite(rate))
    start = question.start[j] / unit[j]
    rate = rate[j] / unit[j]
    if question.placement is not None:
        return _with_joints(question.placement, programs, j, start, rate)
    if not np.isfinite(rates.pace):
        return (tuple(j.tolist()),) * len(programs), start, rate
    lengths = question.lines().lengths(question.start)
    indices = [np.r_[j, _lengths(program)] for program in programs]
    rate = np.append(rate, np.full(lengths.size, rates.pace / L))
    return tuple(tuple(at.tolist()) for at in indices), np.append(start, lengths / L), rate


def _with_joints(
    placement: JointPlacement, programs: Sequence[Program], j: Places, start: Array, rate: Array
) -> tuple[tuple[Indices, ...], Array, Array]:
    """Return the rate-limited tensions with indices `j`, and the rate-limited base joints."""
    (block,) = placement.blocks("2")
    assert isinstance(block, JointBlock)
    rates = block.scaled(placement.joints.rates)
    k = np.flatnonzero(np.isfinite(rates))
    indices = []
    for program in programs:
        blocks = program.structure.blocks
        (at,) = (i for i, each in enumerate(blocks) if isinstance(each, JointBlock))
        indices.append(tuple(np.r_[j, program.decisions[at].start + k].tolist()))
    start = np.append(start, block.scaled(placement.values)[k])
    return tuple(indices), start, np.append(rate, rates[k])


def _lengths(program: Program) -> slice:
    """Return the place of the tendon lengths among the unknowns."""
    blocks = program.structure.blocks
    (k,) = [k for k, block in enumerate(blocks) if isinstance(block, TendonLengths)]
    return program.dependents[k]


@lru_cache(maxsize=4)
def _stated(
    programs: tuple[Program, ...], group: Indices, places: tuple[Indices, ...]
) -> SideBySide:
    """Return the symbolic program of waypoints; `group` is the index of each waypoint's target.

    The parameters are the weights of effort and time; the initial values and the rates of the
    rate-limited variables, which have the indices `places` in each waypoint; the fractions of the
    waypoints; and the parameters of the waypoints' programs.
    """
    N = len(programs)
    M = group[-1] + 1
    m = len(places[0])
    sizes = [program.size for program in programs]
    rows = [program.row_kinds.size for program in programs]
    n_p = [2, m, m, N, *(program.p.numel() for program in programs)]
    at = SideBySide(sizes, rows, M, 2 * N * m, sum(n_p))
    weights, before, rate, fractions, *ps = ca.vertsplit(at.p, np.cumsum([0, *n_p]).tolist())
    effort, time = ca.vertsplit(weights)
    *unknowns, durations = at.unknowns
    parts = list[Part]()
    coupled = [ca.MX(0, 1)]
    none = ca.MX(M, M)
    for k, (program, x, p) in enumerate(zip(programs, unknowns, ps, strict=True)):
        symbols = x, p, effort * at.sigma, at.multipliers[k]
        f, gradient, g, J, H = program.function.call(symbols, True, False)
        padded_gradient = ca.vertcat(effort * gradient, ca.MX(M, 1))
        padded_J = ca.horzcat(J, ca.MX(g.numel(), M))
        parts.append(Part(effort * f, padded_gradient, g, padded_J, ca.diagcat(H, none)))
        largest = rate * fractions[k] * durations[group[k]]
        after = x[list(places[k])]
        coupled += [after - before - largest, before - after - largest]
        before = after
    c = ca.vertcat(*coupled)
    slope = time * ca.MX.ones(M)
    coupling = Part(time * ca.sum1(durations), slope, c, ca.jacobian(c, at.x), none)
    return at.stated(parts, coupling)
