"""The nonlinear program of a structure, in scaled unknowns; numbers are its parameters.

    minimise    the objective                 see planner.program.objective
    subject to  its rows                      lower <= tensions <= upper
                the equations of equilibrium, of the arm and of its responses

The unknowns are the tensions, what the norm and the inequalities add, the load factor, which is 1,
then those of each block, see planner.program.blocks: which there are is decided by scene, targets
and limits.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from model.arm import Arm
from model.errors import SingularError
from model.machine.buffered import Buffered
from model.paths import Array
from model.stations import base_pose
from model.transcription.equations import Equations
from model.transcription.kernels import Places
from model.transcription.layout import POSE, Layout
from model.transcription.system import System
from planner.avoidance.rows import avoidance_of
from planner.program.blocks import Block
from planner.program.least_mode import LeastMode
from planner.program.lengths import TendonLengths
from planner.program.objective import Rows, Seen, soft_rows, stated
from planner.program.responses import Responses
from planner.program.statement import Statement
from planner.program.states import States, Stations
from planner.program.terms import (
    Same,
    compliance_requests,
    stations_of,
    structure_of,
    terms_of,
)
from planner.targets.base import Target

Index = NDArray[np.int32]
STABILITY, STROKES = "stability", "strokes"


class Parts(NamedTuple):
    """Where the parts of the parameters are.

    Attributes
    ----------
    targets, gaps, weights : slice
        Numbers of the targets; of what keeps the arm clear; reference tension, limit of the total
        pull and weight of effort.
    unit : slice
        What one unit of each tension is worth [N].
    force : slice
        Of the responses.
    numbers : slice
        Of the equations.
    scale, row_scale : slice
        What one unit of each unknown of the blocks, and of each equation, is worth.
    defect : slice
        By how much what is measured on the mesh is off, see planner.solve.refine.
    """

    targets: slice
    gaps: slice
    weights: slice
    unit: slice
    force: slice
    numbers: slice
    scale: slice
    row_scale: slice
    defect: slice

    @classmethod
    def of(cls, sizes: tuple[int, ...]) -> Parts:
        """Return the parts of given sizes, one after the other."""
        return cls(*(slice(a, b) for a, b in pairwise([0, *accumulate(sizes)])))

    @property
    def size(self) -> int:
        """How many parameters there are."""
        return int(self.defect.stop)


class Evaluated(NamedTuple):
    """A program at a point: the rows of equilibrium come last."""

    f: float
    gradient: Array
    g: Array
    jacobian: csc_array


def factorised(matrix: csc_array) -> SuperLU:
    """Return the factors of a square matrix; raises SingularError where it has none."""
    try:
        return splu(matrix)
    except RuntimeError as reason:
        raise SingularError("equilibrium is singular in its states: the arm buckles") from reason


class Program:
    """The program of a structure with the states as unknowns: multiple shooting, all in one.

    Unknowns are scaled. In CasADi symbols, as its solvers take it, and as functions of numbers.

    Attributes
    ----------
    size, n_free, n_slack : int
        How many unknowns there are, how many come before the load factor, and how many of these,
        the last, are slacks.
    n_equations : int
        How many equations of the blocks there are; they come last.
    rows, outer_rows : tuple of Rows
        What the rows of the constraints are, in order; and those besides equations.
    states, responses, modes, lengths
        The blocks.
    terms : TargetTerms
        Of all targets but those that keep the arm clear.
    measured : tuple of int
        How many numbers are measured: of poses, least stretches, compliances, eigenvalues, lengths.
    x, p, f, outer : casadi.MX
        Unknowns, parameters, objective, constraints besides the equations.
    sigma, outer_lam, lam : casadi.MX
        Weights of the objective, of the constraints besides equations, and of all.
    """

    def __init__(
        self,
        arm: Arm,
        targets: tuple[Target, ...],
        statement: Statement,
        of: Layout,
        stations: Stations,
    ) -> None:
        n, self.states, stretches = of.n_tendons, States(of, stations), len(stations.slim)
        avoidance = avoidance_of(targets)
        own = tuple(target for target in targets if target is not avoidance)
        self.terms = terms_of(arm, own)
        self._soft = soft_rows(self.terms, statement.mode)
        self.n_slack = len(self._soft)
        self.n_free = n + (statement.norm == "inf") + self.n_slack
        self.responses, directions = list[Responses](), 0
        for request in compliance_requests(targets):
            self.responses.append(Responses(self.states, request, directions))
            directions += request.width
        self.modes = [LeastMode(self.states)] * statement.modes
        self.lengths = [TendonLengths(of)] * statement.wound
        self._blocks: list[Block] = [self.states, *self.responses, *self.modes, *self.lengths]
        ends = np.cumsum([self.n_free + 1, *(block.size for block in self._blocks)]).tolist()
        self._places = [slice(a, b) for a, b in pairwise(ends)]
        self.size, self.n_equations = ends[-1], ends[-1] - ends[0]
        before = np.concatenate([np.arange(n), self.n_free + np.arange(1 + of.n_states)])
        terms = [
            term
            for block, at in zip(self._blocks, self._places, strict=True)
            for term in block.terms(before, at.start, at.start - ends[0])
        ]
        self.equations = Equations(self.size, self.n_equations, terms, of.form.machine_code)
        modes, wound = len(self.modes), n * len(self.lengths)
        _, numbers, compliances = map(self.terms.function.numel_in, range(3))
        self.measured = (POSE * len(stations.nodes), stretches, compliances, modes, wound)
        # CasADi cannot differentiate compiled kernels.
        gaps = avoidance.gaps(arm, stations_of(arm, targets), False) if avoidance else None
        sizes = (1, self.equations.n_p, self.n_equations, self.n_equations, sum(self.measured))
        self.parts = Parts.of((numbers, gaps.n_p if gaps else 0, 3, n, *sizes))
        self.x, self.p = ca.MX.sym("x", self.size), ca.MX.sym("p", self.parts.size)
        self.sigma = ca.MX.sym("sigma")
        self.f, self.outer, rows = self._stated(arm, targets, own, statement, gaps)
        limits = Rows(STABILITY, modes), Rows(STROKES, wound, -np.inf)
        self.outer_rows = (*rows, *limits)
        self.rows = (*self.outer_rows, Rows("equilibrium", self.n_equations, 0.0, 0.0))
        self.outer_lam = ca.MX.sym("lam", self.outer.numel())
        self.lam = ca.MX.sym("lam", self.outer_lam.numel() + self.n_equations)

    def _stated(
        self,
        arm: Arm,
        targets: tuple[Target, ...],
        own: tuple[Target, ...],
        statement: Statement,
        gaps: Equations | None,
    ) -> tuple[ca.MX, ca.MX, tuple[Rows, ...]]:
        """Return the objective, the constraints besides the equations, and the targets' rows.

        `own` are the targets without what keeps the arm clear, whose `gaps` see all stations.
        """
        n, x, p, parts = self.states.of.n_tendons, self.x, self.p, self.parts
        measured = self._measured + p[parts.defect]
        ends = np.cumsum([0, *self.measured]).tolist()
        poses, stretches, compliances, eigenvalues, lengths = ca.vertsplit(measured, ends)
        places, clear = stations_of(arm, targets), ca.MX(0, 1)
        if gaps is not None:
            whole = ca.vertcat(ca.DM(base_pose(arm)), poses)
            clear = gaps.value.function(whole, p[parts.gaps]) / arm.length
        poses = ca.reshape(poses, POSE, -1)[:, [places.index(s) for s in stations_of(arm, own)]]
        tensions, peak, slacks = ca.vertsplit(
            x[: self.n_free], [0, n, self.n_free - self.n_slack, self.n_free]
        )
        reference, total, trace = ca.vertsplit(p[parts.weights])
        pulled = tensions * p[parts.unit], peak, slacks
        weights = p[parts.targets], reference, total, trace
        seen = Seen(*pulled, *weights, poses, stretches, compliances, clear)
        f, outer, rows = stated(statement, own, self.terms, seen)
        return f, ca.vertcat(outer, eigenvalues, lengths), rows

    def place_of(self, block: Block) -> slice:
        """Return the places of a block's unknowns."""
        return self._places[self._blocks.index(block)]

    @property
    def slack_rows(self) -> list[int]:
        """The rows of the inequalities with a slack."""
        return [self.rows[0].size + row for row in self._soft]

    @property
    def places_of_linear(self) -> Places:
        """The places of the unknowns of blocks whose equations are linear in them."""
        pairs = zip(self._blocks, self._places, strict=True)
        linear = [np.arange(at.start, at.stop) for block, at in pairs if block.is_linear]
        return np.concatenate([np.zeros(0, np.int64), *linear])

    def numbers(self, at: System, along: Array) -> Array:
        """Return the numbers of the equations of an arm, by the directions (3, k) of responses."""
        each = (number for block in self._blocks for number in block.numbers(at, along))
        return np.concatenate([np.ravel(number, "F") for number in each])

    def scales(self, at: System) -> tuple[Array, Array]:
        """Return what one unit of each unknown of the blocks, and each equation, is worth."""
        unknowns, rows = zip(*(block.scales(at) for block in self._blocks), strict=True)
        return np.concatenate(unknowns), np.concatenate(rows)

    @cached_property
    def _measured(self) -> ca.MX:
        """What is measured, one below the other: see `measured`."""
        directions = self.terms.directions.call([self.p[self.parts.targets]])
        states = self._in_SI(self.states)
        measured = [ca.vec(self.states.poses(states)), self.states.stretches(states)]
        for responses, D in zip(self.responses, directions, strict=True):
            displaced = responses.displaced(self._in_SI(responses))
            measured.append(ca.vec(D.T @ displaced / self.p[self.parts.force]))
        measured += [self.x[self.place_of(mode)][-1] for mode in self.modes]
        return ca.vertcat(*measured, *(self.x[self.place_of(lengths)] for lengths in self.lengths))

    def _in_SI(self, block: Block) -> ca.MX:
        """Return the unknowns of a block in SI."""
        return self.x[self.place_of(block)] * self.scale[self.place_of(block)]

    @cached_property
    def gradient(self) -> ca.MX:
        """The gradient of f."""
        return ca.densify(ca.gradient(self.f, self.x))

    @cached_property
    def outer_jacobian(self) -> ca.MX:
        """The Jacobian of the constraints besides equilibrium."""
        return ca.jacobian(self.outer, self.x)

    @cached_property
    def outer_hessian(self) -> ca.MX:
        """The Hessian of sigma f + outer_lam . outer."""
        weighted = self.sigma * self.f + ca.dot(self.outer_lam, self.outer)
        return ca.hessian(weighted, self.x)[0]

    @cached_property
    def g(self) -> ca.MX:
        """All constraints; the equations of equilibrium come last."""
        balance = self.equations.value.function(self.x * self.scale, self.p[self.parts.numbers])
        return ca.vertcat(self.outer, balance / self.p[self.parts.row_scale])

    @cached_property
    def jacobian(self) -> ca.MX:
        """The Jacobian of g."""
        of, places = self.equations.jacobian, self.equations.jacobian.places
        scale, row_scale = self.scale, self.p[self.parts.row_scale]
        nonzeros = of.function(self.x * scale, self.p[self.parts.numbers])
        row, column = places.row(), places.get_col()
        J = ca.MX(places, nonzeros * scale[column] / row_scale[row])
        return ca.vertcat(self.outer_jacobian, J)

    @cached_property
    def hessian(self) -> ca.MX:
        """The Hessian of sigma f + lam . g."""
        of, places = self.equations.hessian, self.equations.hessian.places
        scale, row_scale = self.scale, self.p[self.parts.row_scale]
        m = self.outer.numel()
        nonzeros = of.function(self.x * scale, self.p[self.parts.numbers], self.lam[m:] / row_scale)
        row, column = places.row(), places.get_col()
        arguments = [self.x, self.p, self.sigma]
        outer = ca.Function("outer", [*arguments, self.outer_lam], [self.outer_hessian])
        H = outer(*arguments, self.lam[:m])
        return H + ca.MX(places, nonzeros * scale[column] * scale[row])

    @property
    def scale(self) -> ca.MX:
        """What one unit of each unknown is worth."""
        unit, scale = self.p[self.parts.unit], self.p[self.parts.scale]
        return ca.vertcat(unit, ca.MX.ones(self.n_free - unit.numel() + 1), scale)

    def scale_at(self, p: Array) -> Array:
        """Return what one unit of each unknown is worth (size,)."""
        unit, scale = p[self.parts.unit], p[self.parts.scale]
        return np.concatenate([unit, np.ones(self.n_free - unit.size + 1), scale])

    @cached_property
    def _function(self) -> tuple[Buffered, tuple[Index, Index]]:
        """x, p -> f, its gradient, g, nonzeros of its Jacobian; and where these are."""
        values = [self.f, self.gradient, self.g, self.jacobian.nz[:]]
        dense = [ca.densify(J) for J in values]
        J = self.jacobian.sparsity()
        places = np.array(J.row(), np.int32), np.array(J.colind(), np.int32)
        return Buffered(ca.Function("program", [self.x, self.p], dense)), places

    def evaluate(self, x: Array, p: Array) -> Evaluated:
        """Return objective and constraints at unknowns x, with derivatives."""
        function, places = self._function
        f, gradient, g, nonzeros = (value.ravel() for value in function(x, p))
        J = csc_array((nonzeros, *places), shape=(g.size, x.size))
        return Evaluated(float(f[0]), gradient, g, J)

    @cached_property
    def _measure(self) -> Buffered:
        """x, p -> what is measured."""
        return Buffered(ca.Function("measured", [self.x, self.p], [ca.densify(self._measured)]))

    def measure(self, x: Array, p: Array) -> Array:
        """Return what is measured on the mesh at unknowns x, see `measured`."""
        return np.array(self._measure(x, p)[0].ravel())


def program(
    arm: Arm, targets: tuple[Target, ...], statement: Statement, of: Layout, seen: Stations
) -> Program:
    """Return the program of a structure, built once for all arms and numbers that have it."""
    structure = structure_of(arm, targets)
    # What targets take of an arm besides its shape.
    skeleton = (arm.length, arm.base_frame, arm.base_position, arm.tendons, arm.anchorages)
    no_numbers = {"refinement": 0, "margin": 0.0, "floor": 0.0, "solver": "ipopt", "iterations": 0}
    stated = statement.but(**no_numbers)
    return _built((skeleton, structure, stated), of, seen, Same((arm, targets, statement)))


@lru_cache(maxsize=16)
def _built(key: Hashable, of: Layout, seen: Stations, value: Same) -> Program:
    arm, targets, statement = value.value
    return Program(arm, targets, statement, of, seen)
