"""A planning problem: a program with the numbers of an arm, a scene, targets and limits."""

from __future__ import annotations

from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import PrintedStatics
from model.equilibrium.forward import Known
from model.errors import OctoplanError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.winches import rest_lengths
from planner.program.collocated import Collocated
from planner.program.condensed import Condensed
from planner.program.explicit import Explicit
from planner.program.limits import Limits, natural_tensions
from planner.program.objective import Rows
from planner.program.program import STABILITY, STROKES
from planner.program.same import Same
from planner.program.statement import Statement
from planner.program.terms import compliance_requests, stations_of
from planner.targets.base import ComplianceRequest, Target

Bounds = tuple[Array, Array, Array, Array]
TRACES = (1e-6, 1e-11)
# Over what bends the arm by some rad: maxima below this share do nothing, those above are none.
_NOTHING, _NO_LIMIT = 1e-7, 1e12


def is_explicit(
    scene: Scene, statement: Statement, requests: tuple[ComplianceRequest, ...]
) -> bool:
    """Return whether a program's poses are an explicit function of the tensions.

    As printed they are; without loads where the states are eliminated.
    """
    if scene.has(PrintedStatics):
        return True
    if statement.wound:
        return False
    return statement.form == "condensed" and not is_loaded(scene) and not requests


class Problem:
    """A program in scaled unknowns, and the numbers that go with it.

    Attributes
    ----------
    arm, scene, statement
        What is planned, and how it is stated.
    machine_code : bool
        Whether its kernels are compiled.
    mechanics : Collocated or Explicit
        What turns tensions into a shape, and the program that it is part of.
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
        asked = (arm, scene, targets, statement, self.stations)
        explicit = is_explicit(scene, statement, self.requests)
        self.mechanics = (Explicit if explicit else Collocated)(*asked, machine_code)
        self.program = self.mechanics.program
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
        """How many unknowns come before the states: tensions, peak, lack."""
        return self.program.n_free

    @property
    def n_lack(self) -> int:
        """How many inequalities may lack something."""
        return self.program.objective.n_lack

    def parameters(
        self, targets: tuple[Target, ...], limits: Limits, trace: float = TRACES[-1]
    ) -> Array:
        """Return the parameters for targets of this structure, limits and trace of effort."""
        unit = units(self.arm, limits)
        numbers = np.concatenate([target.parameters(self.arm) for target in targets])
        given = np.concatenate([numbers, [unit.max(), limits.total or 0.0, trace], unit])
        return np.concatenate([given, self.mechanics.numbers(numbers)])

    def magnified(self, trace: float) -> float:
        """Return what the objective is multiplied by for a solver to see effort in it.

        In the least squares of the modes besides "exact" effort is a trace, far below tolerances.
        """
        return 1.0 if self.statement.mode == "exact" else 1e-2 / trace

    def bounds(self, limits: Limits) -> Bounds:
        """Return lower and upper bounds of unknowns and constraints, not to be written to.

        Those of the last limits are kept: many problems of a motion, and of a search, share them.
        """
        kept = self._bounds
        if kept is None or kept[0] != limits:
            kept = self._bounds = limits, self._bounded(limits)
            for own in kept[1]:
                own.setflags(write=False)
        return kept[1]

    def _bounded(self, limits: Limits) -> Bounds:
        unit = units(self.arm, limits)
        lower, upper = np.array(limits.lower), np.array(limits.upper)
        upper = np.where(_does_nothing(self.arm, upper), lower, upper)
        upper = np.where(upper < _NO_LIMIT * unit, upper, np.inf)
        free = np.full(self.program.size - unit.size, np.inf)
        lbx, ubx = np.concatenate([lower / unit, -free]), np.concatenate([upper / unit, free])
        lbx[self.n_free :][:1] = ubx[self.n_free :][:1] = 1.0
        floors = {STABILITY: self.statement.least}
        lbg = np.concatenate([np.full(r.size, floors.get(r.name, r.lower)) for r in self.rows])
        ubg = np.concatenate([np.full(r.size, r.upper) for r in self.rows])
        if limits.strokes is not None:
            at = [r.name == STROKES for r in self.rows for _ in range(r.size)]
            least, most = (np.array(own) for own in limits.strokes)
            rest = np.array(limits.stroke_zero or rest_lengths(self.arm))
            lbg[at], ubg[at] = (rest - most) / self.arm.length, (rest - least) / self.arm.length
        return lbx, ubx, lbg, ubg

    def free_bounds(self, limits: Limits) -> Bounds:
        """Return the bounds without those of states and equilibrium."""
        m = sum(row.size for row in self.condensed.rows)
        lbx, ubx, lbg, ubg = self.bounds(limits)
        return lbx[: self.n_free], ubx[: self.n_free], lbg[:m], ubg[:m]

    def constraints(self, x: Array, p: Array) -> Array:
        """Return the constraints at unknowns x."""
        return np.array(self.mechanics.values(x, p)).ravel()

    def unknowns(self, tensions: Array, limits: Limits, p: Array) -> Array:
        """Return the unknowns for tensions: states that settle them, what inequalities lack."""
        return self.mechanics.unknowns(self.free(tensions, limits), tensions, p)

    def free(self, tensions: Array, limits: Limits) -> Array:
        """Return the unknowns before the states for tensions; nothing lacks yet."""
        unit = units(self.arm, limits)
        peak = np.full(self.program.objective.n_peak, tensions.max() / unit.max())
        return np.concatenate([tensions / unit, peak, np.zeros(self.n_lack)])

    def tensions(self, x: Array, limits: Limits) -> Array:
        """Return the tensions in unknowns x, within the limits to the last digit [N]."""
        T = x[: self.arm.n_tendons] * units(self.arm, limits)
        return np.clip(T, limits.lower, limits.upper)

    def stability(self, x: Array, tensions: Array, near: Known | None = None) -> float:
        """Return the stability of the shape at unknowns x, infinite without loads.

        Of unknowns without states, of the shape near one that is known, or else from rest.
        """
        return self.mechanics.stability(x, tensions, near)

    def is_from_rest(self, x: Array, tensions: Array) -> bool:
        """Return whether the shape at unknowns x is that which the unloaded arm comes to."""
        return self.mechanics.is_from_rest(x, tensions)

    def moved_by_loads(self, tensions: Array) -> float:
        """Return how far the loads move the tip [m], infinite where they are too heavy."""
        return self.mechanics.moved_by_loads(tensions)

    def with_modes(self, of: Problem, x: Array, limits: Limits, p: Array) -> Array | None:
        """Return unknowns with the least stable modes, at unknowns x of a problem without them.

        None where there is no such shape.
        """
        other, T = of.mechanics, of.tensions(x, limits)
        if not isinstance(self.mechanics, Collocated) or not isinstance(other, Collocated):
            return None
        try:
            states = other.states_of(x, T)
            return self.mechanics.condensed.whole(self.free(T, limits), states, p)
        except (OctoplanError, np.linalg.LinAlgError):
            return None

    @cached_property
    def condensed(self) -> Condensed | Explicit:
        """The same problem with the states eliminated."""
        return self.mechanics.condensed


@lru_cache(maxsize=32)
def units(arm: Arm, limits: Limits) -> Array:
    """Return the tension that each unknown is counted in [N]: what bends the arm by some rad."""
    most, upper = 5 * natural_tensions(arm), np.array(limits.upper)
    found = np.where(_does_nothing(arm, upper), most, np.minimum(upper, most))
    found.setflags(write=False)
    return found


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
    given = Same(targets)
    return _built(arm, scene, structure, given, statement or Statement(), machine_code)


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
