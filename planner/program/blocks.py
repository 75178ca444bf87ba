"""What the capabilities of a planner add to its program: blocks of unknowns, with equations.

Behind the tensions, and what the objective adds to them, a program has the load factor, which is 1,
then blocks: the states of the arm, and one for each further capability. A block has as many
equations as unknowns, so that these follow from the tensions. It is a structure without numbers:

    size                      how many unknowns it has, and as many equations
    terms(place, start, row)  the terms of its equations, the first of which is at `row`; its
                              unknowns begin at `start`, those of the layout are at `place` (n_x,)
    numbers(at, forces)       the numbers (n_c, N) of each term for the equations of an arm, by the
                              forces (3, k) of all responses [N]
    scales(at)                what one unit of each unknown, and of each equation, is worth (size,)
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import CrossSection, size
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.stability import least_modes, rest_stiffness
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.element import run
from octoplan.model.rod.equations import Term
from octoplan.model.rod.kernels import Kernel, Places, What
from octoplan.model.rod.layout import POSE, Layout
from octoplan.model.rod.system import DiscreteRod
from octoplan.model.support.machine.functions import cached
from octoplan.model.tendons import least_compliance
from octoplan.planner.targets.base import ComplianceRequest


@dataclass(frozen=True)
class States:
    """The states of an arm, with the equations of equilibrium.

    They are those of octoplan.model.rod.layout: poses, moments and forces at the nodes,
    strains at the stages of each element, and what friction adds; the tensions change at the
    anchorages.

    Attributes
    ----------
    layout : Layout
    nodes : tuple of int
        Nodes of the poses that targets see.
    slim : tuple of (int, int)
        The element in each segment with tendons at one of whose ends, 0 or 1, the body is slimmest
        and 1 + q least; none without extension.
    """

    layout: Layout
    nodes: tuple[int, ...]
    slim: tuple[tuple[int, int], ...]

    @classmethod
    def seen(cls, at: DiscreteRod, stations: tuple[float, ...]) -> States:
        """Return the states of an arm that targets see at arc lengths [m]."""
        mesh, slim = at.mesh, list[tuple[int, int]]()
        radius = at.arm.radius.evaluate(mesh.s, at.arm.length)[0]
        for count in (
            np.unique(mesh.active[mesh.active > 0]) if at.layout.form.law.extension else ()
        ):
            inside = np.flatnonzero(mesh.active == count)
            k, end = divmod(int(radius[inside[:, None] + [0, 1]].argmin()), 2)
            slim.append((int(inside[k]), end))
        return cls(at.layout, tuple(mesh.node(s) for s in stations), tuple(slim))

    @property
    def size(self) -> int:
        """See octoplan.planner.program.blocks."""
        return self.layout.n_states

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See octoplan.planner.program.blocks."""
        terms = self.layout.equations.terms
        return [Term(term.kernel, place[term.unknowns], row + term.rows) for term in terms]

    def numbers(self, at: DiscreteRod, forces: Array) -> list[Array]:
        """See octoplan.planner.program.blocks: those of the equations of equilibrium."""
        equations = at.layout.equations
        terms = zip(equations.terms, equations.slices, strict=True)
        return [at.p[numbers].reshape(term.count, -1).T for term, numbers in terms]

    def scales(self, at: DiscreteRod) -> tuple[Array, Array]:
        """See octoplan.planner.program.blocks."""
        of, L = at.layout, at.arm.length
        R = at.arm.radius.evaluate(np.concatenate([at.mesh.s, at.s]), L)[0]
        EA = at.arm.material.E * np.pi * R**2
        EJ = EA * R**2 / 4
        nodes = at.mesh.s.size
        state, row = np.ones(of.n_states), np.ones(of.n_states)
        # Moments, then forces, where there are any; last what friction adds.
        wrench = np.repeat(EJ[:nodes, None] / [L, L**2], 3, axis=1)[:, : of.form.wrench]
        turned = np.ones((nodes, of.turned.shape[1]))
        pose = np.tile(np.repeat([1.0, L], [4, 3]), (nodes, 1))
        state[of.nodes] = row[of.nodes] = np.hstack([pose, wrench, turned])
        curved = np.arange(of.form.strains) < 2 + of.form.law.torsion
        state[of.stages] = np.where(curved, 1 / L, 1.0)
        row[of.stages] = np.where(curved, EJ[nodes:, None] / L, EA[nodes:, None])
        if of.form.friction:
            state[of.rates], row[of.rates] = state[of.stages] / L, row[of.stages] / L
        return state, row

    def poses(self, states: ca.MX) -> ca.MX:
        """Return the poses (7, K) at the stations, of states in SI."""
        places = self.layout.nodes[list(self.nodes), :POSE]
        return ca.reshape(states[places.ravel().tolist()], POSE, len(places))

    def stretches(self, states: ca.MX) -> ca.MX:
        """Return 1 + q where it is least in each segment, by the polynomials through the stages."""
        law, m, stretches = self.layout.form.law, self.layout.form.stages, [ca.MX(0, 1)]
        for element, end in self.slim:
            places = self.layout.stages[element * m : (element + 1) * m, 2 + law.torsion]
            weights = ca.DM(gauss(m).at(float(end)))
            stretches.append(ca.dot(weights, states[places.tolist()]) + 1 - law.along_at_rest)
        return ca.vertcat(*stretches)


@dataclass(frozen=True, eq=False)
class Responses:
    """The responses of the tip to small forces along the directions of a target, for stiffness.

    A response is the change Y of all unknowns of the equations of equilibrium by a small force,
    which are differentiated along Y, and tendons that are held by their tensions or their lengths
    meanwhile. Its equations have exact derivatives as all others, and with them the compliance has,
    as what the tip is displaced by along the force.

    Attributes
    ----------
    states : States
    request : ComplianceRequest
    first : int
        Where its directions are among those of all targets.
    """

    states: States
    request: ComplianceRequest
    first: int

    @property
    def size(self) -> int:
        """See octoplan.planner.program.blocks."""
        return self.request.width * self.states.layout.n_x

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See octoplan.planner.program.blocks."""
        shifts = np.arange(self.request.width) * self.states.layout.n_x
        each = (self._response(place, start + shift, row + shift) for shift in shifts.tolist())
        return [term for terms in each for term in terms]

    def _response(self, place: Places, start: int, row: int) -> list[Term]:
        """Return the terms of one response: of equilibrium, of the tensions, of the load factor."""
        of, terms = self.states.layout, list[Term]()
        for term in of.equations.terms:
            unknowns = np.vstack([place[term.unknowns], start + term.unknowns])
            terms.append(Term(tangent(term.kernel), unknowns, row + term.rows))
        n, row = of.n_tendons, row + of.n_states
        tensions, rows = start + np.arange(n)[None, :], row + np.arange(n)[None, :]
        terms.append(Term(cached(_scaled), np.array([[start + n]]), np.array([[row + n]])))
        if self.request.hold == "length":
            (lengths,) = of.lengths.terms
            own = start + lengths.unknowns, start + lengths.rows
            unknowns = np.vstack([place[lengths.unknowns], *own, place[lengths.rows]])
            terms.append(Term(cached(_locked, of.form.law), unknowns, row + lengths.rows))
        return [*terms, Term(cached(_scaled), tensions, rows)]

    def numbers(self, at: DiscreteRod, forces: Array) -> list[Array]:
        """See octoplan.planner.program.blocks."""
        columns, of, of_terms = list[Array](), self.states.layout, self.states.numbers(at, forces)
        for k in range(self.first, self.first + self.request.width):
            for term, numbers in zip(of.equations.terms, of_terms, strict=True):
                change = np.zeros_like(numbers)
                if term.kernel.name == "element":
                    change[1:4] = forces[:, k, None]
                columns.append(np.vstack([numbers, change]))
            columns.append(np.ones((1, 1)))
            kept = 1.0
            if self.request.hold == "length":
                lengths, EA = at.length_numbers.reshape(-1, 5).T, self.request.tendon_EA
                stretch = np.full((1, lengths.shape[1]), 0.0 if EA is None else 1 / EA)
                columns.append(np.vstack([lengths, stretch]))
                kept = -least_compliance(at.arm)
            columns.append(np.full((1, of.n_tendons), kept))
        return columns

    def scales(self, at: DiscreteRod) -> tuple[Array, Array]:
        """See octoplan.planner.program.blocks."""
        state, row = self.states.scales(at)
        force, n, width = at.arm.bending_force, self.states.layout.n_tendons, self.request.width
        length = at.arm.length if self.request.hold == "length" else force
        unknowns = np.concatenate([np.full(n + 1, force), state])
        rows = np.concatenate([row, np.full(n, length), [1.0]])
        return np.tile(unknowns, width), np.tile(rows, width)

    def displaced(self, unknowns: ca.MX) -> ca.MX:
        """Return the displacements (3, width) of the tip, of its unknowns in SI."""
        by_force = ca.reshape(unknowns, self.states.layout.n_x, self.request.width)
        return by_force[
            (self.states.layout.first + self.states.layout.nodes[-1, 4:POSE]).tolist(), :
        ]


def _locked(law: CrossSection) -> Kernel:
    """Return the kernel of a locked tendon: how its path lengthens, less how its tension does.

    Strains, their changes, change of its tension, the tension; its path and a weight, 1 / E A of
    the tendon, which is as long as its path under its tension.
    """
    kernel = cached(run, law)
    change, pull, tension = ca.SX.sym("change", size(law)), ca.SX.sym("pull"), ca.SX.sym("tension")
    compliance = ca.SX.sym("compliance")
    stretch = kernel.r * compliance / (1 + compliance * tension)
    grows = ca.jtimes(kernel.r, kernel.y, change) - stretch * pull
    y = ca.vertcat(kernel.y, change, pull, tension)
    return Kernel("locked", y, ca.vertcat(kernel.c, compliance), grows)


@dataclass(frozen=True, eq=False)
class LeastMode:
    """The least stable mode, and its eigenvalue last, for a margin of stability.

    It is a change y of the states with J y = lambda B y, J the Jacobian of the equations against
    the states and B the stiffness of the body at rest, at the stages; lambda is the eigenvalue of
    the scaled Hessian of the energy (octoplan.model.equilibrium.stability). Its equations are those
    of equilibrium differentiated along y, less lambda B y, and the size of y: stability with a
    margin is a bound on an unknown.
    """

    states: States

    @property
    def size(self) -> int:
        """See octoplan.planner.program.blocks."""
        return self.states.layout.n_states + 1

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See octoplan.planner.program.blocks."""
        of, terms = self.states.layout, list[Term]()
        for term in of.equations.terms:
            rows = tuple(np.flatnonzero(term.unknowns[:, 0] >= of.first).tolist())
            change = start + term.unknowns[list(rows)] - of.first
            unknowns = np.vstack([place[term.unknowns], change])
            terms.append(Term(mode(term.kernel, rows), unknowns, row + term.rows))
        stages, last = np.ravel(of.stages), of.n_states
        unknowns = np.stack([np.full(stages.size, start + last), start + stages])
        terms.append(Term(cached(_inertia), unknowns, row + stages[None, :]))
        one = np.full((1, stages.size), row + last)
        return [*terms, Term(cached(_part), start + stages[None, :], one)]

    def numbers(self, at: DiscreteRod, forces: Array) -> list[Array]:
        """See octoplan.planner.program.blocks."""
        stiff, equations = rest_stiffness(at)[1], self.states.numbers(at, forces)
        return [*equations, -stiff[None, :], np.zeros((2, stiff.size))]

    def scales(self, at: DiscreteRod) -> tuple[Array, Array]:
        """See octoplan.planner.program.blocks."""
        state, row = self.states.scales(at)
        return np.append(state, 1.0), np.append(row, 1.0)

    def at(self, equilibrium: Equilibrium) -> Array:
        """Return its unknowns (size,) in an equilibrium, strains of some 1 rad in all."""
        system, stages = equilibrium.system, np.ravel(self.states.layout.stages)
        values, y = least_modes(equilibrium, 1)
        strains = y[stages, 0] / self.states.scales(system)[0][stages]
        size = np.sqrt(rest_stiffness(system)[0] / system.arm.length @ strains**2)
        return np.append(y[:, 0] / size, values)

    def share_of(self, y: Array, at: DiscreteRod) -> Array:
        """Return the numbers (2, N) of its size: the share of a mode y (size,) in it, less 1.

        Modes are orthogonal by the stiffness of the body at rest. So none becomes another.
        """
        strains = y[np.ravel(self.states.layout.stages)]
        forces = rest_stiffness(at)[1] * strains
        return np.stack([forces / (forces @ strains), np.full(forces.size, 1 / forces.size)])


def _inertia() -> Kernel:
    """Return the kernel of an eigenvalue times a stiffness and a strain."""
    y, stiff = ca.SX.sym("y", 2), ca.SX.sym("stiff")
    return Kernel("inertia", y, stiff, stiff * y[0] * y[1])


def _part() -> Kernel:
    """Return the kernel of a part of a mode's size, less the size that it is scaled to."""
    y, c = ca.SX.sym("y"), ca.SX.sym("c", 2)
    return Kernel("size", y, c, c[0] * y - c[1])


@dataclass(frozen=True, eq=False)
class TendonLengths:
    """The lengths of the tendons, counted in the arm's, for limits of strokes and their rates."""

    layout: Layout

    @property
    def size(self) -> int:
        """See octoplan.planner.program.blocks."""
        return self.layout.n_tendons

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See octoplan.planner.program.blocks."""
        (runs,) = self.layout.lengths.terms
        each = np.arange(self.size)[None, :]
        path = Term(runs.kernel, place[runs.unknowns], row + runs.rows)
        return [path, Term(cached(_scaled), start + each, row + each)]

    def numbers(self, at: DiscreteRod, forces: Array) -> list[Array]:
        """See octoplan.planner.program.blocks."""
        return [at.length_numbers.reshape(-1, 5).T, np.full((1, self.size), -1.0)]

    def scales(self, at: DiscreteRod) -> tuple[Array, Array]:
        """See octoplan.planner.program.blocks."""
        length = np.full(self.size, at.arm.length)
        return length, length


# The blocks a program may have.
Block = States | Responses | LeastMode | TendonLengths


def _scaled() -> Kernel:
    """Return the kernel of a number times an unknown."""
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    return Kernel("scaled", x, c, c * x)


class Tangent(Kernel):
    """The derivative of a kernel along changes of some of its unknowns, and of its numbers.

    Attributes
    ----------
    of : Kernel
    change_of : (n_y,) of int
        Place of each unknown's change among all unknowns, which begin with those of `of`; -1 for
        unknowns that stay.
    """

    def __init__(self, name: str, of: Kernel, rows: tuple[int, ...], by_numbers: bool) -> None:
        self.layout, n = of, of.y.numel()
        change = ca.SX.sym("change", len(rows))
        numbers = ca.SX.sym("numbers", of.c.numel() * by_numbers)
        self.change_of = np.full(n, -1, dtype=np.int64)
        self.change_of[list(rows)] = n + np.arange(len(rows))
        self._dy = ca.SX.zeros(n)
        self._dy[list(rows)] = change
        self._dc = numbers if by_numbers else ca.SX.zeros(of.c.numel())
        super().__init__(
            name, ca.vertcat(of.y, change), ca.vertcat(of.c, numbers), self._along(of.r)
        )

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        """See Kernel: (J', J), r', and (H', H; H, 0)."""
        if what == "by_numbers":
            return super()._differentiated(what)
        lam, symmetric = ca.SX.sym("lam", self.r.numel()), what == "hessian"
        function, i, j = self.layout.derivative(what)
        whole = function.call([self.layout.y, self.layout.c, lam][: 2 + symmetric])[0]
        changed = ca.sparsify(self._along(whole))
        kept = np.array(changed.sparsity().row(), dtype=np.int64)
        also = np.flatnonzero(self.change_of[j] >= 0)
        across, change = whole[also.tolist()], self.change_of[j[also]]
        rows, columns = [i[kept], i[also]], [j[kept], change]
        values = [ca.vec(changed.nz[:]), across]
        if symmetric:
            rows, columns, values = [*rows, change], [*columns, i[also]], [*values, across]
        inputs = [self.y, self.c, lam][: 2 + symmetric]
        # What the kernel's own share, their derivatives share already.
        results = [ca.densify(ca.vertcat(*values)), *[self.r] * (what == "jacobian")]
        result = ca.Function(f"{self.name}_{what}", inputs, results)
        return result, np.concatenate(rows), np.concatenate(columns)

    def _along(self, r: ca.SX) -> ca.SX:
        """Return the derivative of an expression along the changes."""
        return ca.jtimes(r, self.layout.y, self._dy) + ca.jtimes(r, self.layout.c, self._dc)


def tangent(kernel: Kernel) -> Tangent:
    """Return the derivative of a kernel along changes of all its unknowns and numbers."""
    every = tuple(range(kernel.y.numel()))
    return cached(Tangent, f"{kernel.name}_tangent", kernel, every, True)


def mode(kernel: Kernel, rows: tuple[int, ...]) -> Tangent:
    """Return the derivative of a kernel along changes of some of its unknowns, by their rows."""
    return cached(Tangent, f"{kernel.name}_mode", kernel, rows, False)
