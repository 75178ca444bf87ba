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
from model.transcription.layout import POSE, Layout
from model.transcription.terms import Equations
from planner.program.objective import Rows, objective_of
from planner.program.statement import Statement
from planner.program.states import Blocks, Stations
from planner.program.symbols import Parts, Symbols
from planner.program.terms import Same, compliance_requests
from planner.targets.base import Target

Index = NDArray[np.int32]
STABILITY, STROKES = "stability", "strokes"


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

    Unknowns are scaled: tensions, peak, lack, load factor, states, responses. Parameters are those
    of planner.program.symbols.

    Attributes
    ----------
    size, n_free : int
        How many unknowns there are, and how many come before the load factor.
    rows, outer_rows : tuple of Rows
        What the rows of the constraints are, in order; and those besides equilibrium.
    """

    def __init__(
        self,
        arm: Arm,
        targets: tuple[Target, ...],
        statement: Statement,
        blocks: Callable[[int], Blocks],
        seen: Stations,
    ) -> None:
        self.objective = objective_of(arm, targets, statement, len(seen.slim))
        n = arm.n_tendons
        self.n_free = n + self.objective.n_peak + self.objective.n_lack
        self.blocks, self._seen = blocks(self.n_free), seen
        self.size, machine_code = self.n_free + self.blocks.size, self.blocks.of.form.machine_code
        self.equations = Equations(self.size, self.blocks.n_rows, self.blocks.terms(), machine_code)
        modes = [Rows(STABILITY, self.blocks.modes, 0.0, np.inf)] * (self.blocks.modes > 0)
        wound = [Rows(STROKES, n, -np.inf, np.inf)] * self.blocks.wound
        self.outer_rows = (*self.objective.rows, *modes, *wound)
        self.rows = (*self.outer_rows, Rows("equilibrium", self.blocks.n_rows, 0.0, 0.0))
        own = (1, self.equations.n_p, self.blocks.size, self.blocks.n_rows, sum(self.measured))
        self.parts = Parts.of((self.objective.n_numbers, n, *own))

    @property
    def measured(self) -> tuple[int, int, int, int]:
        """How many numbers are measured: of poses, compliances, eigenvalues, lengths."""
        blocks, compliances = self.blocks, self.objective.terms.numel_in(2)
        wound = blocks.wound * blocks.of.n_tendons
        return POSE * len(self._seen.nodes), compliances, blocks.modes, wound

    @cached_property
    def symbols(self) -> Symbols:
        """The program in symbols, as CasADi's solvers take it."""
        return Symbols(
            self.objective, self.blocks, self._seen, self.equations, self.parts, self.measured
        )

    @cached_property
    def _function(self) -> tuple[Buffered, tuple[Index, Index]]:
        """x, p -> f, its gradient, g, nonzeros of its Jacobian; and where these are."""
        of = self.symbols
        found = [of.f, of.gradient, of.g, of.jacobian.nz[:]]
        dense = [ca.densify(own) for own in found]
        own = of.jacobian.sparsity()
        places = np.array(own.row(), np.int32), np.array(own.colind(), np.int32)
        return Buffered(ca.Function("program", [of.x, of.p], dense)), places

    def evaluate(self, x: Array, p: Array) -> Evaluated:
        """Return objective and constraints at unknowns x, with derivatives."""
        function, places = self._function
        f, gradient, g, nonzeros = (own.ravel() for own in function(x, p))
        J = csc_array((nonzeros, *places), shape=(g.size, x.size))
        return Evaluated(float(f[0]), gradient, g, J)

    def whole(self, p: Array) -> Array:
        """Return what one unit of each unknown is worth (size,)."""
        unit, scale = p[self.parts.unit], p[self.parts.scale]
        return np.concatenate([unit, np.ones(self.n_free - unit.size), scale])


def program(
    arm: Arm, targets: tuple[Target, ...], statement: Statement, of: Layout, seen: Stations
) -> Program:
    """Return the program of a structure, built once for all arms and numbers that have it."""
    structure = tuple(target.structure(arm) for target in targets)
    # What targets take of an arm besides its shape.
    skeleton = (arm.length, arm.base_frame, arm.base_position, arm.tendons, arm.anchorages)
    no_numbers = {"refinement": 0, "margin": 0.0, "floor": 0.0, "solver": "ipopt", "iterations": 0}
    stated = statement.but(**no_numbers)
    return _built((skeleton, structure, stated), of, seen, Same((arm, targets, statement)))


@lru_cache(maxsize=16)
def _built(key: Hashable, of: Layout, seen: Stations, given: Same) -> Program:
    arm, targets, statement = given.value
    requests, more = compliance_requests(targets), (statement.modes, statement.wound)
    return Program(arm, targets, statement, lambda first: Blocks(of, requests, first, *more), seen)
