"""A planning problem: a program with the numbers of an arm, a scene, targets and limits."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.equilibrium.forward import STAGES, Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.equilibrium.stability import least_modes, stability
from model.errors import OctoplanError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.winches import least_compliance, rest_lengths
from planner.program.limits import Limits, natural_tensions
from planner.program.objective import Rows
from planner.program.program import STABILITY, STROKES, factorised, program
from planner.program.statement import Statement
from planner.program.states import States, Stations
from planner.program.terms import Same, compliance_requests, stations_of
from planner.targets.base import Target

Bounds = tuple[Array, Array, Array, Array]
# Weight of effort where the targets cannot be met and their residuals are made least: in a search,
# and in the end, where it keeps shapes away from points that they could meet by half the default
# accuracy; with less of it the effort is lost in the solver's tolerance.
SEARCHED, REGULARISATION = 1e-7, 3e-11
# Over what bends the arm by some rad: maxima below this fraction do nothing, those above are none.
_NOTHING, _NO_LIMIT = 1e-7, 1e12
# Strains of an arm from which on the least eigenvalue is sooner found by iteration.
_DENSE = 120


class Problem:
    """A program in scaled unknowns, and the numbers that go with it.

    Attributes
    ----------
    arm, scene, statement
        What is planned, and how it is stated.
    machine_code : bool
        Whether its kernels are compiled.
    program : Program
        The structure.
    forward : Collocation
        The same equations of equilibrium without targets.
    states : States
        Numbers and scales of what comes behind the tensions.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        statement: Statement,
        machine_code: bool,
    ) -> None:
        self.arm, self.scene, self.statement = arm, scene, statement
        self.machine_code = machine_code
        self.stations, self.requests = stations_of(arm, targets), compliance_requests(targets)
        loaded = is_loaded(scene) or bool(self.requests)
        mesh = (STAGES, statement.refinement, self.stations)
        self.forward = Collocation(arm, scene, *mesh, loaded, machine_code)
        at, more = self.forward.system, (statement.modes, statement.wound)
        self.states = States(at, self.requests, least_compliance(arm), *more)
        self.program = program(arm, targets, statement, at.of, Stations.of(at, self.stations))
        self._bounds: tuple[Limits, Bounds] | None = None

    @property
    def rows(self) -> tuple[Rows, ...]:
        """What the rows of the constraints are, in order; those of equilibrium come last."""
        return self.program.rows

    @property
    def terms(self) -> ca.Function:
        """Station poses (7, K), target numbers, compliances -> terms, for each of KINDS."""
        return self.program.objective.terms

    @property
    def n_free(self) -> int:
        """How many unknowns come before the states: tensions, peak, slacks."""
        return self.program.n_free

    @property
    def n_outer(self) -> int:
        """How many constraints come before the equations of equilibrium."""
        return sum(row.size for row in self.program.outer_rows)

    @property
    def n_slack(self) -> int:
        """How many inequalities have a slack."""
        return self.program.objective.n_slack

    def parameters(
        self,
        targets: tuple[Target, ...],
        limits: Limits,
        weight: float = REGULARISATION,
        defect: Array | None = None,
    ) -> Array:
        """Return the parameters for targets of this structure, limits and weight of effort.

        And for a defect of the mesh, none unless given; see planner.solve.refine.
        """
        unit, states = units(self.arm, limits), self.states
        numbers = np.concatenate([target.parameters(self.arm) for target in targets])
        values = np.concatenate([numbers, [unit.max(), limits.total or 0.0, weight], unit])
        states_numbers = [np.array([states.force]), states.numbers(self.directions(targets))]
        error = np.zeros(sum(self.program.measured)) if defect is None else defect
        return np.concatenate([values, *states_numbers, states.scale, states.row_scale, error])

    def bounds(self, limits: Limits) -> Bounds:
        """Return lower and upper bounds of unknowns and constraints, not to be written to.

        Those of the last limits are kept: many problems of a motion, and of a search, share them.
        """
        kept = self._bounds
        if kept is None or kept[0] != limits:
            kept = self._bounds = limits, self._bounded(limits)
            for bound in kept[1]:
                bound.setflags(write=False)
        return kept[1]

    def _bounded(self, limits: Limits) -> Bounds:
        unit = units(self.arm, limits)
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
        return lbx, ubx, lbg, ubg

    def free(self, tensions: Array, limits: Limits) -> Array:
        """Return the unknowns before the states for tensions; slacks are 0."""
        unit = units(self.arm, limits)
        peak = np.full(self.program.objective.n_peak, tensions.max() / unit.max())
        return np.concatenate([tensions / unit, peak, np.zeros(self.n_slack)])

    def tensions(self, x: Array, limits: Limits) -> Array:
        """Return the tensions in unknowns x, within the limits to the last digit [N]."""
        T = x[: self.arm.n_tendons] * units(self.arm, limits)
        return np.clip(T, limits.lower, limits.upper)

    def guess(self, tensions: Array, limits: Limits, p: Array, soon: bool = False) -> Array:
        """Return the unknowns for tensions: the arm without its loads, no equilibrium under them.

        Under its loads where that `soon` settles, by Newton's method from there. The straight arm
        where tensions leave a cross-section no equilibrium, or the arm no stiffness.
        """
        system, free = self.forward.system, self.free(tensions, limits)
        try:
            states = self.forward.without_loads(tensions)
            if soon and is_loaded(self.scene):
                try:
                    equilibrium = newton(system, tensions, 1.0, states)
                    states = states if equilibrium is None else equilibrium.states
                except (OctoplanError, np.linalg.LinAlgError):
                    pass
            return self.closed(free, states, p)
        except (OctoplanError, np.linalg.LinAlgError):
            straight = self.forward.without_loads(np.zeros(self.arm.n_tendons))
            return self.closed(free, straight, p)

    def settled(
        self, tensions: Array, limits: Limits, p: Array, near: Linearised | None = None
    ) -> Array:
        """Return the unknowns for tensions in equilibrium, near one of another mesh if any is.

        Raises what settling does.
        """
        states = self.forward.found(tensions, near).states
        return self.closed(self.free(tensions, limits), states, p)

    def carried(self, x: Array, of: Problem, limits: Limits, p: Array) -> Array:
        """Return the unknowns of this mesh for unknowns x of the same problem on another."""
        states = self.forward.carried(of.tensions(x, limits), of.known(x, limits))
        return self.closed(x[: of.n_free], states, p)

    def closed(self, a: Array, states: Array, p: Array) -> Array:
        """Return all unknowns for those before the states, and states of the arm (n_states,).

        Responses, modes and lengths are what their equations make of these; slacks are the
        violations of their inequalities.
        """
        program, blocks, scale = self.program, self.program.blocks, self.states.scale
        x = np.zeros(program.size)
        x[: self.n_free], x[self.n_free] = a, 1.0
        x[blocks.states] = states / scale[1 : 1 + states.size]
        if blocks.responses:
            start, stop = blocks.response(0).start, blocks.response(len(blocks.responses)).start
            first, point = self.n_outer + states.size, program.evaluate(x, p)
            rows = slice(first, first + stop - start)
            responds = point.jacobian.tocsr()[rows].tocsc()[:, start:stop]
            x[start:stop] = -factorised(responds).solve(point.g[rows])
        if blocks.modes:
            self._add_modes(x, states, p)
        if blocks.wound:
            system = self.forward.system
            lengths = system.lengths(system.x(np.zeros(system.of.n_tendons), 1.0, states))
            x[blocks.lengths] = lengths / system.arm.length
        if self.n_slack:
            slack = np.maximum(-self.constraints(x, p)[program.objective.slack_rows], 0.0)
            x[self.n_free - self.n_slack : self.n_free] += slack
        return x

    def _add_modes(self, x: Array, states: Array, p: Array) -> None:
        """Put the least stable modes at states into unknowns x."""
        blocks, system = self.program.blocks, self.forward.system
        unit = p[self.program.parts.unit]
        equilibrium = Linearised(system, system.x(x[: unit.size] * unit, 1.0, states))
        values, y = least_modes(equilibrium, blocks.modes)
        y = self.states.mode_size(y)
        for k, value in enumerate(values):
            x[blocks.mode(k)] = y[:, k] / self.states.scale[1 : 1 + states.size]
            x[blocks.mode(k).stop] = value

    def states_of(self, x: Array) -> Array:
        """Return the states (n_states,) in unknowns x."""
        n = self.forward.system.of.n_states
        return np.asarray(x[self.program.blocks.states] * self.states.scale[1 : 1 + n])

    def known(self, x: Array, limits: Limits) -> Linearised:
        """Return the equations at the tensions and states in unknowns x."""
        system = self.forward.system
        return Linearised(system, system.x(self.tensions(x, limits), 1.0, self.states_of(x)))

    def poses(self, x: Array) -> Array:
        """Return the poses (K, 7) at the stations, in unknowns x."""
        nodes = [self.forward.mesh.node(s) for s in self.stations]
        return self.forward.system.poses(self.states_of(x))[nodes]

    def directions(self, targets: tuple[Target, ...]) -> list[Array]:
        """Return the directions (3, width) of the requests of targets."""
        numbers = np.concatenate([target.parameters(self.arm) for target in targets])
        of = self.program.objective
        return [np.array(D) for D in of.directions.call([numbers[: of.n_own]])]

    def compliances(self, x: Array, directions: list[Array]) -> Array:
        """Return the tip's compliances in unknowns x along the requests' directions, stacked."""
        blocks, scale, k = self.program.blocks, self.states.scale, 0
        tip = blocks.of.first + blocks.of.nodes[-1, 4:7]
        blocks_of = [np.zeros(0)]
        for D in directions:
            places = [blocks.response(k + i).start + tip for i in range(D.shape[1])]
            displaced = np.stack([x[at] * scale[at - self.n_free] for at in places], axis=1)
            blocks_of.append((D.T @ displaced / self.states.force).ravel("F"))
            k += D.shape[1]
        return np.concatenate(blocks_of)

    def constraints(self, x: Array, p: Array) -> Array:
        """Return the constraints at unknowns x."""
        return self.program.evaluate(x, p).g

    def stability(self, x: Array, tensions: Array) -> float:
        """Return the stability of the equilibrium in unknowns x, infinite without loads."""
        if not is_loaded(self.scene):
            return np.inf
        system = self.forward.system
        try:
            return stability(Linearised(system, system.x(tensions, 1.0, self.states_of(x))))
        except (OctoplanError, np.linalg.LinAlgError):
            return -np.inf


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


def build(
    arm: Arm,
    targets: tuple[Target, ...],
    scene: Scene,
    statement: Statement | None = None,
    machine_code: bool = False,
) -> Problem:
    """Return the problem, built once for all targets of one structure."""
    structure = tuple(target.structure(arm) for target in targets)
    stated = (statement or Statement()).but(iterations=0, solver="ipopt")
    return _built(arm, scene, structure, Same(targets), stated, machine_code)


@lru_cache(maxsize=24)
def _built(
    arm: Arm,
    scene: Scene,
    structure: tuple[object, ...],
    targets: Same,
    statement: Statement,
    machine_code: bool,
) -> Problem:
    return Problem(arm, scene, targets.value, statement, machine_code)
