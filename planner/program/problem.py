"""A planning problem: a program with the numbers of an arm, a scene, targets and limits."""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import STAGES, Collocation, newton
from model.equilibrium.stability import stands
from model.errors import OctoplanError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.winches import rest_lengths
from planner.program.blocks import Stations, unit_force
from planner.program.limits import Limits, natural_tensions
from planner.program.program import STABILITY, STROKES, Program, factorised, program
from planner.program.statement import Statement
from planner.program.terms import (
    Same,
    compliance_requests,
    stations_of,
    structure_of,
    target_numbers,
)
from planner.targets.base import Target

Bounds = tuple[Array, Array, Array, Array]
# Weight of effort where the targets cannot be met and their residuals are made least: in a search,
# and in the end, where it keeps shapes away from points that they could meet by half the default
# accuracy; with less of it the effort is lost in the solver's tolerance.
SEARCHED, REGULARISATION = 1e-7, 3e-11
# Over what bends the arm by some rad: maxima below this fraction do nothing, those above are none.
_NOTHING, _NO_LIMIT = 1e-7, 1e12
# How far inside of its element an end is looked at, over L: at anchorages strains jump.
_INSIDE = 1e-9


class Problem:
    """A planning question in scaled unknowns: the program of its structure, with its numbers.

    Attributes
    ----------
    arm, scene, targets, statement
        What is planned, and how it is stated.
    limits : Limits
        What the tendons may do.
    machine_code : bool
        Whether its kernels are compiled.
    stations, requests
        Arc lengths that the targets look at, and the compliances.
    program : Program
        The structure.
    forward : Collocation
        The same equations of equilibrium without targets.
    scale, row_scale : (n,)
        What one unit of each unknown of the blocks, and of each equation, is worth.
    rows, n_free, n_outer
        What the rows of the constraints are, in order; how many unknowns come before the states,
        and how many constraints before the equations of equilibrium.
    directions : (3, k)
        Of the responses.
    bounds : tuple of arrays
        Lower and upper bounds of unknowns, then of constraints, not to be written to.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        limits: Limits,
        statement: Statement | None = None,
        machine_code: bool = False,
    ) -> None:
        self.arm, self.scene, self.targets, self.limits = arm, scene, targets, limits
        self.statement = (statement or Statement()).but(iterations=0, solver="ipopt")
        self.machine_code, self.unit = machine_code, units(arm, limits)
        self.stations, self.requests = stations_of(arm, targets), compliance_requests(targets)
        structure = structure_of(arm, targets)
        stated = self.statement.but(margin=0.0, floor=0.0)
        question = (arm, scene, structure, Same(targets), stated, machine_code)
        self.program, self.forward, self.scale, self.row_scale = of, *_ = _built(*question)
        self.rows, self.n_free, self.n_outer = of.rows, of.n_free, of.outer.numel()
        numbers = target_numbers(arm, targets)
        each = of.terms.directions.call([numbers[of.parts.targets]])
        self.directions = np.hstack([np.zeros((3, 0)), *(np.array(D) for D in each)])
        weights = np.array([self.unit.max(), limits.total or 0.0, REGULARISATION])
        equations = of.numbers(self.forward.system, self.directions)
        values = numbers, weights, self.unit, [unit_force(arm)], equations
        defect = np.zeros(sum(of.measured))
        self._p = np.concatenate([*values, self.scale, self.row_scale, defect])
        self.bounds = self._bounds()

    def but(
        self, statement: Statement | None = None, targets: tuple[Target, ...] | None = None
    ) -> Problem:
        """Return the same by another statement, or for other targets."""
        targets = self.targets if targets is None else targets
        question = (self.arm, self.scene, targets, self.limits, statement or self.statement)
        return Problem(*question, self.machine_code)

    def parameters(self, weight: float = REGULARISATION, defect: Array | None = None) -> Array:
        """Return the parameters of the program, by a weight of effort.

        And for a defect of the mesh, none by default; see planner.solve.refine.
        """
        p = self._p.copy()
        p[self.program.parts.weights.stop - 1] = weight
        if defect is not None:
            p[self.program.parts.defect] = defect
        return p

    def _bounds(self) -> Bounds:
        """Return lower and upper bounds of unknowns and constraints."""
        unit, limits = self.unit, self.limits
        lower, upper = np.array(limits.lower), np.array(limits.upper)
        upper = np.where(_does_nothing(self.arm, upper), lower, upper)
        upper = np.where(upper < _NO_LIMIT * unit, upper, np.inf)
        free = np.full(self.program.size - unit.size, np.inf)
        lbx, ubx = np.concatenate([lower / unit, -free]), np.concatenate([upper / unit, free])
        lbx[self.n_free] = ubx[self.n_free] = 1.0
        floors = {STABILITY: self.statement.least}
        lbg = np.concatenate([np.full(r.size, floors.get(r.name, r.lower)) for r in self.rows])
        ubg = np.concatenate([np.full(r.size, r.upper) for r in self.rows])
        if limits.strokes is not None:
            at = [r.name == STROKES for r in self.rows for _ in range(r.size)]
            least, most = (np.array(bound) for bound in limits.strokes)
            rest = np.array(limits.stroke_zero or rest_lengths(self.arm))
            lbg[at], ubg[at] = (rest - most) / self.arm.length, (rest - least) / self.arm.length
        for bound in (lbx, ubx, lbg, ubg):
            bound.setflags(write=False)
        return lbx, ubx, lbg, ubg

    def free(self, tensions: Array) -> Array:
        """Return the unknowns before the states for tensions; slacks are 0."""
        slacks = np.zeros(self.program.n_slack)
        peak = np.full(self.n_free - tensions.size - slacks.size, tensions.max() / self.unit.max())
        return np.concatenate([tensions / self.unit, peak, slacks])

    def tensions(self, x: Array) -> Array:
        """Return the tensions in unknowns x, within the limits to the last digit [N]."""
        T = x[: self.arm.n_tendons] * self.unit
        return np.clip(T, self.limits.lower, self.limits.upper)

    def guess(self, tensions: Array, soon: bool = False) -> Array:
        """Return the unknowns for tensions: the arm without its loads, no equilibrium under them.

        Under its loads where that `soon` settles, by Newton's method from there. The straight arm
        where tensions leave a cross-section no equilibrium, or the arm no stiffness.
        """
        free = self.free(tensions)
        try:
            states = self.forward.without_loads(tensions)
            if soon and is_loaded(self.scene):
                with suppress(OctoplanError, np.linalg.LinAlgError):
                    equilibrium = newton(self.forward.system, tensions, 1.0, states)
                    states = states if equilibrium is None else equilibrium.states
            return self.closed(free, states)
        except (OctoplanError, np.linalg.LinAlgError):
            return self.closed(free, self.forward.without_loads(np.zeros(self.arm.n_tendons)))

    def settled(self, tensions: Array, near: Linearised | None = None) -> Array:
        """Return the unknowns for tensions in equilibrium, near one of another mesh if any is.

        Raises what settling does.
        """
        states = self.forward.solve(tensions, near).states
        return self.closed(self.free(tensions), states)

    def carried(self, x: Array, of: Problem) -> Array:
        """Return the unknowns of this mesh for unknowns x of the same problem on another."""
        states = self.forward.carried(of.tensions(x), of.linearised(x))
        return self.closed(x[: of.n_free], states)

    def closed(self, a: Array, states: Array, numbers: Array | None = None) -> Array:
        """Return all unknowns for those before the states, and states of the arm (n_states,).

        Responses, modes and lengths are what their equations make of these; slacks are the
        violations of their inequalities. By other `numbers` of the equations, if any are given.
        """
        p = self._p
        if numbers is not None:
            p = p.copy()
            p[self.program.parts.numbers] = numbers
        program, x = self.program, np.zeros(self.program.size)
        x[: self.n_free], x[self.n_free] = a, 1.0
        x[program.places[program.states]] = states / self.scale[: states.size]
        linear = program.linear
        if linear.size:
            point, rows = program.evaluate(x, p), self.n_outer + linear - self.n_free - 1
            own = point.jacobian.tocsr()[rows].tocsc()[:, linear]
            x[linear] = -factorised(own).solve(point.g[rows])
        for mode in program.modes:
            at, begin = program.places[mode], self.n_free + 1
            x[at] = mode.at(self.linearised(x)) / self.scale[at.start - begin : at.stop - begin]
        if program.n_slack:
            slack = np.maximum(-program.evaluate(x, p).g[program.slack_rows], 0.0)
            x[self.n_free - program.n_slack : self.n_free] += slack
        return x

    def linearised(self, x: Array) -> Linearised:
        """Return the equations at the tensions and states in unknowns x."""
        system, at = self.forward.system, self.program.places[self.program.states]
        states = x[at] * self.scale[: at.stop - at.start]
        return Linearised(system, system.x(self.tensions(x), 1.0, states))

    def measured(self, x: Array) -> Array:
        """Return what is measured on the mesh at unknowns x, see Program.measured."""
        return self.program.measure(x, self._p)[0].ravel()

    @property
    def slim_at(self) -> Array:
        """Arc lengths at which stretches are measured, inside of their elements [m]."""
        slim = np.array(self.program.states.stations.slim, dtype=int).reshape(-1, 2)
        inside = self.arm.length * _INSIDE * (1 - 2 * slim[:, 1])
        return np.asarray(self.forward.mesh.s[slim.sum(axis=1)] + inside)

    def stands(self, x: Array, margin: float = 0.0) -> bool:
        """Return whether the stability of the equilibrium in unknowns x is above a margin.

        Without loads it is.
        """
        return not is_loaded(self.scene) or stands(self.linearised(x), margin)


@lru_cache(maxsize=32)
def units(arm: Arm, limits: Limits) -> Array:
    """Return the tension that each unknown is counted in [N]: what bends the arm by some rad."""
    most, upper = 5 * natural_tensions(arm), np.array(limits.upper)
    result = np.where(_does_nothing(arm, upper), most, np.minimum(upper, most))
    result.setflags(write=False)
    return result


def _does_nothing(arm: Arm, upper: Array) -> Array:
    """Return which maxima are so low that what they allow is lost in what is met."""
    return np.asarray(upper <= _NOTHING * 5 * natural_tensions(arm))


@lru_cache(maxsize=24)
def _built(
    arm: Arm,
    scene: Scene,
    structure: tuple[object, ...],
    targets: Same,
    statement: Statement,
    machine_code: bool,
) -> tuple[Program, Collocation, Array, Array]:
    """Return what is the same for all targets of one structure, and all limits."""
    stations, requests = stations_of(arm, targets.value), compliance_requests(targets.value)
    loaded = is_loaded(scene) or bool(requests)
    forward = Collocation(arm, scene, STAGES, statement.refinement, stations, loaded, machine_code)
    at = forward.system
    of = program(arm, targets.value, statement, at.of, Stations.of(at, stations))
    return of, forward, *of.scales(at)
