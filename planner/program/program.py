"""The nonlinear program of a structure, in scaled unknowns; numbers are its parameters.

    minimise    the objective                 see planner.program.objective
    subject to  its rows                      lower <= tensions <= upper
                the equations of equilibrium, of the arm and of its responses

The unknowns are the tensions, what the norm and the inequalities add, then the load factor (which
is 1) and the states; see planner.program.states.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
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
from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.transcription.layout import POSE, Layout
from model.transcription.terms import Equations
from planner.program.objective import Objective, Rows, split
from planner.program.statement import Statement
from planner.program.states import Blocks, Stations
from planner.program.terms import Same, compliance_requests, structure_of
from planner.targets.base import Target

Index = NDArray[np.int32]
STABILITY, STROKES = "stability", "strokes"


class Parts(NamedTuple):
    """Where the parts of the parameters are.

    Attributes
    ----------
    given : slice
        Numbers of the objective.
    unit : slice
        What one unit of each tension is worth [N].
    force : slice
        Of the responses.
    numbers : slice
        Of the equations.
    scale, row_scale : slice
        What one unit of each unknown from the load factor on, and of each equation, is worth.
    defect : slice
        By how much what is measured on the mesh is off, see planner.solve.refine.
    """

    given: slice
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

    Unknowns are scaled: tensions, peak, slacks, load factor, states, responses. In CasADi symbols,
    as its solvers take it, and as functions of numbers.

    Attributes
    ----------
    size, n_free : int
        How many unknowns there are, and how many come before the load factor.
    rows, outer_rows : tuple of Rows
        What the rows of the constraints are, in order; and those besides equilibrium.
    x, p, f, outer : casadi.MX
        Unknowns, parameters, objective, constraints besides the equations of equilibrium.
    sigma, outer_lam, lam : casadi.MX
        Weights of the objective, of the constraints besides equilibrium, and of all.
    """

    def __init__(
        self,
        arm: Arm,
        targets: tuple[Target, ...],
        statement: Statement,
        blocks: Callable[[int], Blocks],
        seen: Stations,
    ) -> None:
        self.objective = Objective(arm, targets, statement, len(seen.slim))
        n = arm.n_tendons
        self.n_free = n + self.objective.n_peak + self.objective.n_slack
        self.blocks, self._seen = blocks(self.n_free), seen
        self.size, machine_code = self.n_free + self.blocks.size, self.blocks.of.form.machine_code
        self.equations = Equations(self.size, self.blocks.n_rows, self.blocks.terms(), machine_code)
        modes = [Rows(STABILITY, self.blocks.modes, 0.0, np.inf)] * (self.blocks.modes > 0)
        wound = [Rows(STROKES, n, -np.inf, np.inf)] * self.blocks.wound
        self.outer_rows = (*self.objective.rows, *modes, *wound)
        self.rows = (*self.outer_rows, Rows("equilibrium", self.blocks.n_rows, 0.0, 0.0))
        sizes = (1, self.equations.n_p, self.blocks.size, self.blocks.n_rows, sum(self.measured))
        self.parts = Parts.of((self.objective.n_numbers, n, *sizes))
        self.x, self.p = ca.MX.sym("x", self.size), ca.MX.sym("p", self.parts.size)
        self.sigma = ca.MX.sym("sigma")
        self.outer_lam = ca.MX.sym("lam", sum(row.size for row in self.outer_rows))
        self.lam = ca.MX.sym("lam", self.outer_lam.numel() + self.blocks.n_rows)

    @property
    def measured(self) -> tuple[int, int, int, int]:
        """How many numbers are measured: of poses, compliances, eigenvalues, lengths."""
        blocks, compliances = self.blocks, self.objective.terms.function.numel_in(2)
        wound = blocks.wound * blocks.of.n_tendons
        return POSE * len(self._seen.nodes), compliances, blocks.modes, wound

    @cached_property
    def _stated(self) -> tuple[ca.MX, ca.MX]:
        """The objective, and the constraints besides equilibrium."""
        of, first, objective = self.blocks.of, self.blocks.states.start, self.objective
        n, n_peak, K = of.n_tendons, objective.n_peak, len(self._seen.nodes)
        pose_error, compliance_error, eigenvalues, lengths = split(
            self.p[self.parts.defect], self.measured
        )
        x, numbers = self.x, self.p[self.parts.given]
        places = first + of.nodes[list(self._seen.nodes), :POSE]
        poses = ca.reshape(self._at(places.ravel()) + pose_error, POSE, K)
        thin = ca.vertcat(ca.MX(0, 1), *(self._stretch(k, end) for k, end in self._seen.slim))
        tensions = x[:n] * self.p[self.parts.unit]
        parts = (tensions, x[n : n + n_peak], x[n + n_peak : self.n_free], numbers)
        compliances = self._compliances(numbers) + compliance_error
        f, g = objective.function.call([*parts, poses[:, objective.seen], thin, compliances], True)
        g = objective.with_gaps(g, objective.gaps(poses, numbers))
        eigenvalues += x[self.blocks.eigenvalues]
        return f, ca.vertcat(g, eigenvalues, x[self.blocks.lengths] + lengths)

    @property
    def f(self) -> ca.MX:
        """The objective."""
        return self._stated[0]

    @property
    def outer(self) -> ca.MX:
        """The constraints besides the equations of equilibrium."""
        return self._stated[1]

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
        return ca.vertcat(unit, ca.MX.ones(self.n_free - unit.numel()), scale)

    def scale_at(self, p: Array) -> Array:
        """Return what one unit of each unknown is worth (size,)."""
        unit, scale = p[self.parts.unit], p[self.parts.scale]
        return np.concatenate([unit, np.ones(self.n_free - unit.size), scale])

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

    def _at(self, places: Places) -> ca.MX:
        """Return the unknowns at places behind those that come before the states, in SI."""
        scale = self.parts.scale.start - self.n_free + places
        return self.x[places.tolist()] * self.p[scale.tolist()]

    def _stretch(self, element: int, end: int) -> ca.MX:
        """Return 1 + q at an end of an element, by the polynomial through its stages."""
        of, m = self.blocks.of, self.blocks.of.form.stages
        stages = element * m + np.arange(m)
        places = self.blocks.states.start + of.stages[stages, 2 + of.form.law.torsion]
        weights = ca.DM(gauss(m).at(float(end)))
        return ca.dot(weights, self._at(places)) + 1 - of.form.law.along_at_rest

    def _compliances(self, numbers: ca.MX) -> ca.MX:
        """Return the compliances along the requests' directions, column by column."""
        of, compliances, k = self.blocks.of, [ca.MX(0, 1)], 0
        tip, force = of.first + of.nodes[-1, 4:POSE], self.p[self.parts.force]
        terms = self.objective.terms
        directions = terms.directions.call([numbers[: self.objective.n_own]])
        for request, D in zip(terms.requests, directions, strict=True):
            starts = [self.blocks.response(k + i).start for i in range(request.width)]
            displaced = ca.horzcat(*(self._at(start + tip) for start in starts))
            compliances.append(ca.vec(D.T @ displaced / force))
            k += request.width
        return ca.vertcat(*compliances)


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
    requests, more = compliance_requests(targets), (statement.modes, statement.wound)
    return Program(arm, targets, statement, lambda first: Blocks(of, requests, first, *more), seen)
