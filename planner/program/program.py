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

from model.arm import Arm
from model.machine.buffered import Buffered
from model.transcription.collocation import gauss
from model.transcription.layout import POSE, Layout
from model.transcription.terms import Equations
from planner.program.objective import Rows, objective_of, split
from planner.program.reduced import Sparse
from planner.program.same import Same
from planner.program.statement import Statement
from planner.program.states import Blocks, Stations
from planner.program.terms import compliance_requests
from planner.targets.base import Target

STABILITY, STROKES = "stability", "strokes"


class Program:
    """The program of a structure with the states as unknowns: multiple shooting, all in one.

    Unknowns are scaled: tensions, peak, lack, load factor, states, responses. Parameters are those
    of the objective, the unit of each tension, the force of the responses, the numbers of the
    equations, and what one unit of each further unknown and of each equation is worth.

    Attributes
    ----------
    x, p, f, g : casadi.MX
        Unknowns, parameters, objective, constraints; the equations of equilibrium come last.
    gradient, jacobian, hessian : casadi.MX
        Of f, of g, and of sigma f + lam . g.
    sigma, lam : casadi.MX
        Weights of the Hessian.
    rows, outer_rows : tuple of Rows
        What the rows of g are, in order; and those besides equilibrium.
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
        self.blocks = blocks(self.n_free)
        size, machine_code = self.n_free + self.blocks.size, self.blocks.of.form.machine_code
        self.equations = Equations(size, self.blocks.n_rows, self.blocks.terms(), machine_code)
        modes = [Rows(STABILITY, self.blocks.modes, 0.0, np.inf)] * (self.blocks.modes > 0)
        wound = [Rows(STROKES, n, -np.inf, np.inf)] * self.blocks.wound
        self.outer_rows = (*self.objective.rows, *modes, *wound)
        self.rows = (*self.outer_rows, Rows("equilibrium", self.blocks.n_rows, 0.0, 0.0))
        own = (1, self.equations.n_p, self.blocks.size, self.blocks.n_rows)
        self.sizes = (self.objective.n_numbers, n, *own)
        self._build(seen)

    def _build(self, seen: Stations) -> None:
        x, p = ca.MX.sym("x", self.equations.n_x), ca.MX.sym("p", sum(self.sizes))
        given, unit, force, numbers, scale, row_scale = split(p, self.sizes)
        whole = ca.vertcat(unit, ca.MX.ones(self.n_free - unit.numel()), scale)
        X = x * whole
        f, outer = self._outer(X, x, given, force, seen)
        eigenvalues = (x[place] for place in self.blocks.eigenvalues)
        outer = ca.vertcat(outer, *eigenvalues, x[self.blocks.lengths])
        places, nonzeros = self.equations.jacobian[1], self.equations.jacobian[0](X, numbers)
        row, column = places.row(), places.get_col()
        J = ca.MX(places, nonzeros * whole[column] / row_scale[row])
        self.x, self.p, self.f = x, p, f
        self.g = ca.vertcat(outer, self.equations.value(X, numbers) / row_scale)
        self.gradient = ca.densify(ca.gradient(f, x))
        self.outer, self.outer_jacobian = outer, ca.jacobian(outer, x)
        self.jacobian = ca.vertcat(self.outer_jacobian, J)
        self.sigma, self.lam = ca.MX.sym("sigma"), ca.MX.sym("lam", self.g.numel())
        m = outer.numel()
        function, places = self.equations.hessian
        nonzeros = function(X, numbers, self.lam[m:] / row_scale)
        row, column = places.row(), places.get_col()
        H = ca.MX(places, nonzeros * whole[column] * whole[row])
        own = ca.hessian(self.sigma * f + ca.dot(self.lam[:m], outer), x)[0]
        self.hessian = own + H

    def _outer(
        self, X: ca.MX, x: ca.MX, given: ca.MX, force: ca.MX, seen: Stations
    ) -> tuple[ca.MX, ca.MX]:
        """Return the objective, and the constraints besides equilibrium."""
        of, first = self.blocks.of, self.blocks.states.start
        n, n_peak = of.n_tendons, self.objective.n_peak
        places = first + of.nodes[list(seen.nodes), :POSE]
        poses = ca.reshape(X[places.ravel().tolist()], POSE, len(seen.nodes))
        thin = ca.vertcat(ca.MX(0, 1), *(self._stretch(X, k, end) for k, end in seen.slim))
        own = poses[:, self.objective.seen]
        parts = (X[:n], x[n : n + n_peak], x[n + n_peak : self.n_free], given, own, thin)
        f, g = self.objective.function.call([*parts, self._compliances(X, given, force)], True)
        gaps = self.objective.gaps().value(poses, given[self.objective.n_own : -3])
        return f, self.objective.with_gaps(g, gaps)

    def _stretch(self, X: ca.MX, element: int, end: int) -> ca.MX:
        """Return 1 + q at an end of an element, by the polynomial through its stages."""
        of, m = self.blocks.of, self.blocks.of.form.stages
        stages = element * m + np.arange(m)
        places = self.blocks.states.start + of.stages[stages, 2 + of.form.law.torsion]
        weights = ca.DM(gauss(m).at(float(end)))
        return ca.dot(weights, X[places.tolist()]) + 1 - of.form.law.along_at_rest

    def _compliances(self, X: ca.MX, given: ca.MX, force: ca.MX) -> ca.MX:
        """Return the compliances along the requests' directions, column by column."""
        of, compliances, k = self.blocks.of, [ca.MX(0, 1)], 0
        tip = (of.first + of.nodes[-1, 4:POSE]).tolist()
        for request, D in zip(
            self.objective.requests,
            self.objective.directions.call([given[: self.objective.n_own]]),
            strict=True,
        ):
            moved = [X[self.blocks.response(k + i)][tip] for i in range(request.width)]
            compliances.append(ca.vec(D.T @ ca.horzcat(*moved) / force))
            k += request.width
        return ca.vertcat(*compliances)

    @property
    def symbols(self) -> Program:
        """The program in symbols, as CasADi's solvers take it: itself."""
        return self

    @property
    def size(self) -> int:
        """How many unknowns there are."""
        return int(self.x.numel())

    @cached_property
    def values(self) -> Buffered:
        """x, p -> f, constraints besides equilibrium."""
        found = [self.f, ca.densify(self.outer)]
        return Buffered(ca.Function("values", [self.x, self.p], found))

    @cached_property
    def first(self) -> Buffered:
        """x, p -> f, its gradient, constraints besides equilibrium, their Jacobian transposed."""
        found = [self.f, self.gradient, self.outer, self.outer_jacobian]
        found = [ca.densify(value) for value in found]
        return Buffered(ca.Function("first", [self.x, self.p], found))

    @cached_property
    def equilibrium(self) -> Buffered:
        """x, p -> the equations of equilibrium."""
        own = ca.densify(self.g[self.outer.numel() :])
        return Buffered(ca.Function("equilibrium", [self.x, self.p], [own]))

    @cached_property
    def inner(self) -> Sparse:
        """x, p -> the Jacobian of the equations of equilibrium."""
        return Sparse("inner", [self.x, self.p], self.jacobian[self.outer.numel() :, :])

    @cached_property
    def second(self) -> Sparse:
        """x, p, sigma, lam -> the Hessian of sigma f + lam . g, all of it."""
        return Sparse("second", [self.x, self.p, self.sigma, self.lam], self.hessian)


def program(
    arm: Arm, targets: tuple[Target, ...], statement: Statement, of: Layout, seen: Stations
) -> Program:
    """Return the program of a structure, built once for all arms and numbers that have it."""
    structure = tuple(target.structure(arm) for target in targets)
    # What targets take of an arm besides its shape.
    skeleton = (arm.length, arm.base_frame, arm.base_position, arm.tendons, arm.anchorages)
    stated = statement.but(refinement=0, form="multiple-shooting", margin=0.0)
    return _built((skeleton, structure, stated), of, seen, Same((arm, targets, statement)))


@lru_cache(maxsize=16)
def _built(key: Hashable, of: Layout, seen: Stations, given: Same) -> Program:
    arm, targets, statement = given.value
    requests, more = compliance_requests(targets), (statement.modes, statement.wound)
    return Program(arm, targets, statement, lambda first: Blocks(of, requests, first, *more), seen)
