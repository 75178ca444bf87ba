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

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from model.arm import Arm
from model.machine.buffered import Buffered
from model.machine.repeated import InC
from model.paths import Array
from model.transcription.layout import Layout
from model.transcription.terms import Equations
from planner.program.objective import Rows, objective_of
from planner.program.parts import Parts
from planner.program.same import Same
from planner.program.statement import Statement
from planner.program.states import Blocks, Stations
from planner.program.symbols import Symbols
from planner.program.terms import compliance_requests
from planner.targets.base import Target

Index = NDArray[np.int32]
STABILITY, STROKES = "stability", "strokes"
# Far from any equilibrium numbers may overflow; who asks looks whether they are finite.
_QUIET = np.errstate(over="ignore", invalid="ignore")


class Program:
    """The program of a structure with the states as unknowns: multiple shooting, all in one.

    Unknowns are scaled: tensions, peak, lack, load factor, states, responses. Parameters are those
    of planner.program.parts.

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
        own = (1, self.equations.n_p, self.blocks.size, self.blocks.n_rows)
        self.parts = Parts.of((self.objective.n_numbers, n, *own))

    @cached_property
    def symbols(self) -> Symbols:
        """The program in symbols, as CasADi's solvers take it."""
        return Symbols(self.objective, self.blocks, self._seen, self.equations, self.parts)

    @cached_property
    def values(self) -> Buffered:
        """x, p -> f, constraints besides equilibrium."""
        of = self.symbols
        return Buffered(ca.Function("values", [of.x, of.p], [of.f, ca.densify(of.outer)]))

    @cached_property
    def first(self) -> Buffered:
        """x, p -> f, its gradient, constraints besides equilibrium, their Jacobian transposed."""
        of = self.symbols
        found = [of.f, of.gradient, of.outer, of.outer_jacobian]
        return Buffered(ca.Function("first", [of.x, of.p], [ca.densify(v) for v in found]))

    @_QUIET
    def equilibrium(self, x: Array, p: Array) -> Array:
        """Return the equations of equilibrium (n_rows,)."""
        found = self.value_call(x * self.whole(p), p[self.parts.numbers])[0][0]
        return np.asarray(found / p[self.parts.row_scale])

    @_QUIET
    def inner(self, x: Array, p: Array) -> csc_array:
        """Return the Jacobian of the equations of equilibrium (n_rows, size)."""
        whole, (rows, columns, ends) = self.whole(p), self.jacobian_places
        nonzeros = self.jacobian_call(x * whole, p[self.parts.numbers])[0][0]
        scaled = nonzeros * whole[columns] / p[self.parts.row_scale][rows]
        return csc_array((scaled, rows, ends), shape=(self.blocks.n_rows, self.size))

    def whole(self, p: Array) -> Array:
        """Return what one unit of each unknown is worth (size,)."""
        unit, scale = p[self.parts.unit], p[self.parts.scale]
        return np.concatenate([unit, np.ones(self.n_free - unit.size), scale])

    @cached_property
    def value_call(self) -> Buffered | InC:
        """The equations in their own unknowns and numbers."""
        return self.equations.call("value")

    @cached_property
    def jacobian_call(self) -> Buffered | InC:
        """The nonzeros of their Jacobian."""
        return self.equations.call("jacobian")

    @cached_property
    def jacobian_places(self) -> tuple[Index, Index, Index]:
        """Rows and columns of these, and where each column begins."""
        own = self.equations.places("jacobian")
        rows, columns, begins = (
            np.array(of, dtype=np.int32) for of in (own.row(), own.get_col(), own.colind())
        )
        return rows, columns, begins


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
