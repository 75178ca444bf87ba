"""A planning problem: a program with the numbers of an arm, a scene, targets and limits.

And points that solvers stop at, with the residual of their first-order conditions. With unknowns
(a, S), a before the states, equations of equilibrium c(a, S) = 0 with a square and regular Jacobian
c_S, a function r of both has, along the equilibrium, the derivative

    dr/da = r_a + mu^T c_a,    c_S^T mu = -r_S.

So the states are eliminated of the objective and of all other constraints; and with multipliers lam
of the latter those of the equations are mu of the Lagrangian.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.linalg import norm
from scipy.sparse import csc_array

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.equilibrium.uniqueness import has_unique_equilibrium
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.rod.system import system
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY
from octoplan.model.stations import base_pose
from octoplan.model.support.errors import OctoplanError
from octoplan.model.tendons import rest_lengths
from octoplan.planner.limits import NATURAL_RANGE, Limits, effort_unit, natural_tensions
from octoplan.planner.nlp_options import NlpOptions
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program.blocks import States
from octoplan.planner.program.program import STABILITY, STROKES, Program, Structure, factorised
from octoplan.planner.program.terms import TargetStructure
from octoplan.planner.solution import Solution, Trial

Bounds = tuple[Array, Array, Array, Array]
# Weight of effort where the targets cannot be met and their residuals are made least: in a search,
# and in the end, where it keeps shapes away from points that they could meet by half the default
# accuracy, which is what least squares tell apart. It is less where a finer accuracy is asked for,
# but less and less of the effort is left by the solver's tolerance.
SEARCHED, REGULARISATION = 1e-7, 3e-11
RESOLVED = ACCURACY / 2
# Meshes of programs, whose error is corrected (octoplan.planner.solve.refine), have fewer elements
# than those that shapes are settled on, which take 2; see octoplan.model.mesh.graded.
STEPS_PER_UNIT = 1.2
# What the conditions of an optimum are held to, scaled; and its stability, of which another mesh
# has other digits.
KKT_TOLERANCE, STABILITY_TOLERANCE = 1e-6, 1e-4


class Problem:
    """A planning question in scaled unknowns: the program of its structure, with its numbers.

    Attributes
    ----------
    task : PlanningProblem
        What is asked: of what `arm` in what `scene`, with targets `together`.
    limits : Limits
        What the tendons may do, but for those that targets do not let pull.
    options : NlpOptions
    program : Program
        The structure.
    forward : Collocation
        The same equations of equilibrium without targets.
    effort_unit : float
        Tension in units of which effort is counted [N].
    scale : (size,)
        What one unit of each unknown is worth.
    n_free, n_outer
        How many unknowns come before the states, and constraints before the equations.
    forces : (3, k)
        Of the responses: what bends the arm by some rad, along their directions [N].
    bounds : tuple of arrays
        Lower and upper bounds of unknowns, then of constraints.
    slim_at : (k,)
        Arc lengths at which stretches are measured, inside of their elements [m].
    """

    def __init__(self, task: PlanningProblem, options: NlpOptions | None = None) -> None:
        self.task, self.arm, self.scene = task, task.arm, task.scene
        self.target_set, self.limits = task.target_set, task.allowed
        self.options = options or task.options
        self.unit = units(task.arm, task.limits)
        self.effort_unit = self._effort_unit()
        stated = self.options.but(margin=0.0, floor=0.0)
        total, strokes = self.limits.total is not None, self.limits.strokes is not None
        self.program, self.forward, scale, row_scale = of, *_ = _built(
            task.arm,
            task.scene,
            self.target_set.structure,
            stated,
            total,
            strokes,
            task.machine_code,
        )
        self.n_free, self.n_outer = of.n_free, of.n_outer
        force = task.arm.bending_force
        self.forces = force * np.hstack([np.zeros((3, 0)), *self.target_set.own.directions])
        least = REGULARISATION * min(task.accuracy / ACCURACY, 1.0)
        weights = np.array([self.effort_unit, self.limits.total or 0.0, least])
        equations = of.numbers(self.forward.system, self.forces)
        values = self.target_set.numbers, weights, self.unit, [force], equations
        defect = np.zeros(sum(of.measured))
        self._p = np.concatenate([*values, scale, row_scale, defect])
        self.scale = np.array(of.scale(self._p)).ravel()
        self.bounds = self._bounds()
        slim = np.array(of.states.slim, dtype=int).reshape(-1, 2)
        # At anchorages strains jump.
        inside = 1e-9 * task.arm.length * (1 - 2 * slim[:, 1])
        self.slim_at = self.forward.mesh.s[slim.sum(axis=1)] + inside

    def _effort_unit(self) -> float:
        """Return the tension in units of which effort is counted [N].

        If effort alone is the objective, and the tensions can meet all equalities, the unit changes
        no optimum: programs converge soonest in that of the tensions. Otherwise effort is weighed
        against something else, and the unit does not depend on limits.
        """
        terms, limits = self.target_set.own.terms, self.limits
        can_pull = int(np.greater(limits.upper, limits.lower).sum())
        effort_alone = self.options.mode == "exact" and not terms.names[3]
        if effort_alone and terms.count <= can_pull:
            return float(self.unit.max())
        return effort_unit(self.arm)

    def but(self, **changes: Any) -> Problem:
        """Return the same with some choices of the statement changed."""
        return Problem(self.task, self.options.but(**changes))

    def parameters(self, weight: float | None = None, defect: Array | None = None) -> Array:
        """Return the parameters of the program, by a weight of effort, the least unless given.

        And for a defect of the mesh, none by default; see octoplan.planner.solve.refine.
        """
        p = self._p.copy()
        if weight is not None:
            p[self.program.parts["weights"].stop - 1] = weight
        if defect is not None:
            p[self.program.parts["defect"]] = defect
        return p

    def with_mode(self, x: Array, p: Array) -> Array:
        """Return parameters by which the least mode remains the one that it is in unknowns x."""
        of = self.program
        if not of.modes:
            return p
        (mode,), p = of.modes, p.copy()
        share = mode.share_of((x * self.scale)[of.places[mode]], self.forward.system)
        p[of.parts["numbers"]][of.equations.numbers_of("size")] = share.ravel("F")
        return p

    def _bounds(self) -> Bounds:
        """Return lower and upper bounds of unknowns and constraints."""
        unit, limits, of = self.unit, self.limits, self.program
        lower, upper = np.array(limits.lower), np.array(limits.upper)
        upper = np.where(_does_nothing(self.arm, upper), lower, upper)
        # Solvers take what is as far for no bound.
        upper = np.where(upper < 1e12 * unit, upper, np.inf)
        free = np.full(of.size - unit.size, np.inf)
        lbx, ubx = np.concatenate([lower / unit, -free]), np.concatenate([upper / unit, free])
        lbx[self.n_free] = ubx[self.n_free] = 1.0
        lbg, ubg = np.where(of.rows == STABILITY, self.options.least, of.lower), of.upper.copy()
        if limits.strokes is not None:
            rest, at = np.array(limits.stroke_zero or rest_lengths(self.arm)), of.rows == STROKES
            ubg[at], lbg[at] = (rest - np.array(limits.strokes)) / self.arm.length
        return lbx, ubx, lbg, ubg

    def tensions(self, x: Array) -> Array:
        """Return the tensions in unknowns x, within the limits to the last digit [N]."""
        T = x[: self.arm.n_tendons] * self.unit
        return np.clip(T, self.limits.lower, self.limits.upper)

    def guess(self, tensions: Array, settled: bool = False) -> Array:
        """Return the unknowns for tensions (n_tendons,) [N].

        The states are those of the arm without its loads, which are no equilibrium under them. If
        the states are to be `settled`, or the loads are strong, they are the equilibrium from rest
        that comes nearest to the tensions; strong loads move the arm too far for Newton's method.
        The guess is the straight arm if the tensions crush a cross-section.
        """
        strong = is_loaded(self.scene) and not has_unique_equilibrium(self.arm, self.scene)
        with suppress(OctoplanError, np.linalg.LinAlgError):
            if strong or (settled and is_loaded(self.scene)):
                with suppress(OctoplanError, np.linalg.LinAlgError):
                    point = self.forward.towards(tensions)
                    limits = self.limits.lower, self.limits.upper
                    return self.closed(np.clip(point.tensions, *limits), point.states)
            return self.closed(tensions, self.forward.without_loads(tensions))
        return self.closed(tensions, self.forward.without_loads(np.zeros(self.arm.n_tendons)))

    def closed(self, tensions: Array, states: Array, numbers: Array | None = None) -> Array:
        """Return the unknowns for tensions (n_tendons,) and states of the arm (n_states,).

        Responses, modes and lengths are what their equations make of these; slacks are the
        violations of their inequalities. By other `numbers` of the equations, if any are given.
        """
        p = self._p.copy()
        if numbers is not None:
            p[self.program.parts["numbers"]] = numbers
        program, x, n = self.program, np.zeros(self.program.size), tensions.size
        x[:n], x[self.n_free] = tensions / self.unit, 1.0
        x[n : self.n_free - program.n_slack] = tensions.max() / self.effort_unit
        at = program.places[program.states]
        x[at] = states / self.scale[at]
        linear = program.linear
        if linear.size:
            _, _, g, J = program.evaluate(x, p)
            rows = self.n_outer + linear - self.n_free - 1
            x[linear] = -factorised(J.tocsr()[rows].tocsc()[:, linear]).solve(g[rows])
        for mode in program.modes:
            at = program.places[mode]
            x[at] = mode.at(self.linearised(x)) / self.scale[at]
        if program.n_slack:
            missed = -program.evaluate(x, p)[2][program.slack_rows]
            x[self.n_free - program.n_slack : self.n_free] = np.maximum(missed, 0.0)
        return x

    def linearised(self, x: Array) -> Equilibrium:
        """Return the equations at the tensions and states in unknowns x."""
        system, at = self.forward.system, self.program.places[self.program.states]
        return Equilibrium(system, system.x(self.tensions(x), 1.0, x[at] * self.scale[at]))

    def measured(self, x: Array) -> Array:
        """Return what is measured on the mesh at unknowns x, see Program.measured."""
        return self.program.measure(x, self._p)[0].ravel()

    def is_stable(self, x: Array, margin: float = 0.0) -> bool:
        """Return whether the stability of the equilibrium in unknowns x is above a margin.

        Without loads it is.
        """
        return not is_loaded(self.scene) or is_stable(self.linearised(x), margin)


@lru_cache(maxsize=32)
def units(arm: Arm, limits: Limits) -> Array:
    """Return the tension that each unknown is counted in [N]: what bends the arm by some rad."""
    most, upper = NATURAL_RANGE * natural_tensions(arm), np.array(limits.upper)
    result = np.where(_does_nothing(arm, upper), most, np.minimum(upper, most))
    result.setflags(write=False)
    return result


def _does_nothing(arm: Arm, upper: Array) -> Array:
    """Return which maxima are so low that what they allow is lost in what is met."""
    return np.asarray(upper <= 5e-7 * natural_tensions(arm))


@lru_cache(maxsize=24)
def _built(
    arm: Arm,
    scene: Scene,
    targets: TargetStructure,
    options: NlpOptions,
    has_total: bool,
    has_strokes: bool,
    machine_code: bool,
) -> tuple[Program, Collocation, Array, Array]:
    """Return program, equations of equilibrium and scales, shared by all numbers of targets."""
    loaded, at = is_loaded(scene) or bool(targets.terms.requests), targets.stations
    mesh = STAGES, options.refinement, at, loaded, machine_code, STEPS_PER_UNIT
    forward = Collocation(system(arm, scene, *mesh))
    states = States.seen(forward.system, at)
    base = tuple(base_pose(arm).tolist())
    of = _program(Structure(targets, options, has_total, has_strokes, base, arm.length, states))
    return of, forward, *of.scales(forward.system)


@lru_cache(maxsize=16)
def _program(structure: Structure) -> Program:
    """Return the program of a structure, shared by all arms and numbers that have it."""
    return Program(structure)


@dataclass(frozen=True, eq=False)
class SolverResult:
    """A point that a solver stopped at, in numbers.

    Multipliers lam_x and lam_g are of CasADi's signs, below 0 at a lower bound. `met` says that the
    solver believes in the point, all numbers of which are finite; that is a hint, never a verdict.
    """

    x: Array
    lam_x: Array
    lam_g: Array
    f: float
    met: bool
    iterations: int

    @property
    def is_finite(self) -> bool:
        """Whether every number is finite."""
        return bool(np.isfinite(np.hstack([self.x, self.f, self.lam_x, self.lam_g])).all())


@dataclass(frozen=True, eq=False)
class Candidate(SolverResult):
    """A point of a planning problem that a solver stopped at.

    Attributes
    ----------
    problem : Problem
    defect : (n,) or None
        By how much what is measured on the mesh is off, as far as the point corrects it; see
        octoplan.planner.solve.refine.
    """

    problem: Problem = field(kw_only=True)
    defect: Array | None = field(default=None, kw_only=True)

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""
        return self.problem.tensions(self.x)

    @cached_property
    def derivatives(self) -> tuple[Array, Array, csc_array]:
        """The gradient of the objective, the constraints and their Jacobian."""
        p = self.problem.parameters(defect=self.defect)
        return self.problem.program.evaluate(self.x, self.problem.with_mode(self.x, p))[1:]

    def extended(self) -> Candidate:
        """Return it with multipliers of all, by those of what comes before states and equations."""
        n, m = self.problem.n_free, self.problem.n_outer
        (gradient, _, J), lam_g = self.derivatives, self.lam_g[:m]
        slope = gradient + J[:m].T @ lam_g
        of_states = factorised(J[m:].tocsc()[:, n + 1 :]).solve(-slope[n + 1 :], "T")
        lam_x = np.append(self.lam_x[:n], np.zeros(self.x.size - n))
        return replace(self, lam_x=lam_x, lam_g=np.append(lam_g, of_states))

    @property
    def residual(self) -> float:
        """How far it is from the first-order conditions, scaled, in equilibrium.

        The largest of: a component of the Lagrangian's gradient; a violation of a constraint or a
        bound; the product of a multiplier and the distance to its bound. NaN counts as infinite.
        """
        (gradient, g, J), n, m = self.derivatives, self.problem.n_free, self.problem.n_outer
        whole = self.extended()
        lam = np.append(whole.lam_x[:n], whole.lam_g[:m])
        rest = (gradient + J.T @ whole.lam_g + whole.lam_x)[:n]
        values, (lbx, ubx, lbg, ubg) = np.append(self.x[:n], g[:m]), self.problem.bounds
        # How far unknowns before the states and constraints are above and below their bounds.
        above, below = values - np.append(lbx[:n], lbg[:m]), np.append(ubx[:n], ubg[:m]) - values
        # Multipliers of 0 leave no scale.
        scale = 1e-2 + norm(gradient[:n], np.inf) + norm(np.append(lam[n:], 0.0), np.inf)
        # No multiplier counts with a bound that is farther than a thousand units.
        room = np.minimum(np.abs(np.where(lam < 0, above, below)), 1e3)
        violation = np.maximum(-np.minimum(above, below), 0.0)
        worst = float(norm(np.concatenate([rest / scale, violation, lam * room / scale]), np.inf))
        return worst if np.isfinite(worst) else np.inf

    def result(self, trials: Sequence[Trial], **more: Any) -> Solution:
        """Return the result of a search that ends here, after trials."""
        of = self.problem
        return Solution(
            of.options,
            of.arm.by_section(self.tensions),
            tuple(self.lam_x[: of.n_free].tolist()),
            tuple(self.lam_g[: of.n_outer].tolist()),
            tuple(trials),
            avoidance=of.target_set.avoidance,
            iterations=self.iterations,
            **more,
        )
