"""A program in CasADi's symbols: what targets make of the states, and all as solvers take it."""

from __future__ import annotations

from functools import cached_property
from itertools import accumulate, pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.transcription.layout import POSE
from model.transcription.terms import Equations
from planner.program.objective import Objective, split
from planner.program.states import Blocks, Stations


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


class Symbols:
    """A program with the states as unknowns; see planner.program.program.

    Attributes
    ----------
    x, p, f, outer : casadi.MX
        Unknowns, parameters, objective, constraints besides the equations of equilibrium.
    sigma, outer_lam, lam : casadi.MX
        Weights of the objective, of the constraints besides equilibrium, and of all.
    """

    def __init__(
        self,
        objective: Objective,
        blocks: Blocks,
        seen: Stations,
        equations: Equations,
        parts: Parts,
        measured: tuple[int, ...],
    ) -> None:
        self.objective, self.blocks = objective, blocks
        self.equations, self.parts = equations, parts
        self.x, self.p = ca.MX.sym("x", equations.n_x), ca.MX.sym("p", parts.size)
        self.sigma = ca.MX.sym("sigma")
        poses, compliances, eigenvalues, lengths = split(self.p[parts.defect], measured)
        f, outer = self._outer(seen, ca.reshape(poses, POSE, len(seen.nodes)), compliances)
        eigenvalues += self.x[blocks.eigenvalues]
        self.f, self.outer = f, ca.vertcat(outer, eigenvalues, self.x[blocks.lengths] + lengths)
        self.outer_lam = ca.MX.sym("lam", self.outer.numel())
        self.lam = ca.MX.sym("lam", self.outer.numel() + blocks.n_rows)

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
        own = self.equations.value(self.x * self.whole, self.p[self.parts.numbers])
        return ca.vertcat(self.outer, own / self.p[self.parts.row_scale])

    @cached_property
    def jacobian(self) -> ca.MX:
        """The Jacobian of g."""
        function, places = self.equations.jacobian
        whole, row_scale = self.whole, self.p[self.parts.row_scale]
        nonzeros = function(self.x * whole, self.p[self.parts.numbers])
        row, column = places.row(), places.get_col()
        J = ca.MX(places, nonzeros * whole[column] / row_scale[row])
        return ca.vertcat(self.outer_jacobian, J)

    @cached_property
    def hessian(self) -> ca.MX:
        """The Hessian of sigma f + lam . g."""
        function, places = self.equations.hessian
        whole, row_scale = self.whole, self.p[self.parts.row_scale]
        m = self.outer.numel()
        nonzeros = function(self.x * whole, self.p[self.parts.numbers], self.lam[m:] / row_scale)
        row, column = places.row(), places.get_col()
        given = [self.x, self.p, self.sigma]
        outer = ca.Function("outer", [*given, self.outer_lam], [self.outer_hessian])
        own = outer(*given, self.lam[:m])
        return own + ca.MX(places, nonzeros * whole[column] * whole[row])

    @property
    def whole(self) -> ca.MX:
        """What one unit of each unknown is worth."""
        unit, scale = self.p[self.parts.unit], self.p[self.parts.scale]
        n = self.equations.n_x - unit.numel() - scale.numel()
        return ca.vertcat(unit, ca.MX.ones(n), scale)

    def _at(self, places: Places) -> ca.MX:
        """Return the unknowns at places behind those that come before the states, in SI."""
        first = self.equations.n_x - self.blocks.size
        return self.x[places.tolist()] * self.p[(self.parts.scale.start - first + places).tolist()]

    def _outer(self, seen: Stations, off: ca.MX, softer: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the objective, and the constraints besides equilibrium.

        Poses (7, K) and compliances are `off` and `softer` by so much.
        """
        of, first, objective = self.blocks.of, self.blocks.states.start, self.objective
        n, n_peak, n_free = of.n_tendons, objective.n_peak, self.equations.n_x - self.blocks.size
        x, given = self.x, self.p[self.parts.given]
        places = first + of.nodes[list(seen.nodes), :POSE]
        poses = ca.reshape(self._at(places.ravel()), POSE, len(seen.nodes)) + off
        thin = ca.vertcat(ca.MX(0, 1), *(self._stretch(k, end) for k, end in seen.slim))
        tensions = x[:n] * self.p[self.parts.unit]
        parts = (tensions, x[n : n + n_peak], x[n + n_peak : n_free], given)
        seen_poses = poses[:, objective.seen]
        compliances = self._compliances(given) + softer
        f, g = objective.function.call([*parts, seen_poses, thin, compliances], True)
        gaps = objective.gaps().value(poses, given[objective.n_own : -3])
        return f, objective.with_gaps(g, gaps)

    def _stretch(self, element: int, end: int) -> ca.MX:
        """Return 1 + q at an end of an element, by the polynomial through its stages."""
        of, m = self.blocks.of, self.blocks.of.form.stages
        stages = element * m + np.arange(m)
        places = self.blocks.states.start + of.stages[stages, 2 + of.form.law.torsion]
        weights = ca.DM(gauss(m).at(float(end)))
        return ca.dot(weights, self._at(places)) + 1 - of.form.law.along_at_rest

    def _compliances(self, given: ca.MX) -> ca.MX:
        """Return the compliances along the requests' directions, column by column."""
        of, compliances, k = self.blocks.of, [ca.MX(0, 1)], 0
        tip, force = of.first + of.nodes[-1, 4:POSE], self.p[self.parts.force]
        directions = self.objective.directions.call([given[: self.objective.n_own]])
        for request, D in zip(self.objective.requests, directions, strict=True):
            starts = [self.blocks.response(k + i).start for i in range(request.width)]
            moved = ca.horzcat(*(self._at(start + tip) for start in starts))
            compliances.append(ca.vec(D.T @ moved / force))
            k += request.width
        return ca.vertcat(*compliances)
