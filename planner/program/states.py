"""The states of an arm inside of a program: the equations of equilibrium, and what targets look at.

A directional compliance is one unknown vector more for each direction: the change Y of all unknowns
by a small force on the tip, whose equations are those of equilibrium differentiated along Y.

So is the least stable mode, where stability is a constraint: a change y of the states with
J y = lambda B y, J the Jacobian of the equations against the states and B the stiffness of the body
at rest, at the stages; lambda is the eigenvalue of the scaled Hessian of the energy
(model.equilibrium.stability). Its equations are those of equilibrium differentiated along y, less
lambda B y, and the size of y. They have exact derivatives as all others, and with them the
eigenvalue has: stability with a margin is a bound on an unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.cross_section.law import CrossSection, size
from model.equilibrium.stability import rest_stiffness
from model.paths import Array
from model.transcription.element import run
from model.transcription.kernel import Kernel, Places, mode, tangent
from model.transcription.layout import Layout
from model.transcription.system import System
from model.transcription.terms import Term
from planner.targets.base import ComplianceRequest


@dataclass(frozen=True)
class Stations:
    """Where on a mesh targets look at an arm: a structure, without numbers.

    Attributes
    ----------
    nodes : tuple of int
        Nodes of the poses that targets see.
    slim : tuple of (int, int)
        The element in each segment with tendons at one of whose ends, 0 or 1, the body is slimmest
        and 1 + q least; none without extension.
    """

    nodes: tuple[int, ...]
    slim: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, at: System, places: tuple[float, ...]) -> Stations:
        """Return the stations at arc lengths [m]."""
        mesh, slim = at.mesh, []
        radius = at.arm.radius.evaluate(mesh.s, at.arm.length)[0]
        for count in np.unique(mesh.active[mesh.active > 0]):
            inside = np.flatnonzero(mesh.active == count)
            ends = np.stack([radius[inside], radius[inside + 1]])
            end, k = np.unravel_index(int(np.argmin(ends)), ends.shape)
            slim.append((int(inside[k]), int(end)))
        extends = at.of.form.law.extension
        return cls(tuple(mesh.node(s) for s in places), tuple(slim) if extends else ())


@dataclass(frozen=True)
class Blocks:
    """The unknowns of a program behind its tensions: load factor and states, and each response.

    Attributes
    ----------
    of : Layout
    requests : tuple of ComplianceRequest
    first : int
        Place of the load factor.
    modes : int
        How many of the least stable modes are unknowns; see planner.program.states.
    wound : bool
        Whether the lengths of the tendons are.
    """

    of: Layout
    requests: tuple[ComplianceRequest, ...]
    first: int
    modes: int = 0
    wound: bool = False

    @property
    def responses(self) -> list[ComplianceRequest]:
        """The request of each response, one for each direction."""
        return [request for request in self.requests for _ in range(request.width)]

    @property
    def size(self) -> int:
        """Number of unknowns: load factor, states, responses of all, modes, lengths."""
        return 1 + self.n_answers + self.of.n_states

    @property
    def n_answers(self) -> int:
        """Number of unknowns that are neither load factor nor states."""
        size = len(self.responses) * self.of.n_x
        return size + self.modes * (self.of.n_states + 1) + self.wound * self.of.n_tendons

    @property
    def n_rows(self) -> int:
        """Number of equations: one less, as the load factor is given."""
        return self.size - 1

    @property
    def states(self) -> slice:
        """Places of the states."""
        return slice(self.first + 1, self.first + 1 + self.of.n_states)

    def places(self) -> Places:
        """Return the place in the program of each unknown of the layout."""
        return np.concatenate(
            [np.arange(self.of.n_tendons), self.first + np.arange(1 + self.of.n_states)]
        )

    def response(self, k: int) -> slice:
        """Return the places of a response."""
        start = self.states.stop + k * self.of.n_x
        return slice(start, start + self.of.n_x)

    def response_rows(self, k: int) -> slice:
        """Return the rows of a response: of equilibrium, then of tensions and load factor."""
        start = self.of.n_states + k * self.of.n_x
        return slice(start, start + self.of.n_x)

    def mode(self, k: int) -> slice:
        """Return the places of a mode; that of its eigenvalue is the next."""
        start = self.response(len(self.responses)).start + k * (self.of.n_states + 1)
        return slice(start, start + self.of.n_states)

    @property
    def eigenvalues(self) -> list[int]:
        """The places of the modes' eigenvalues."""
        return [self.mode(k).stop for k in range(self.modes)]

    @property
    def lengths(self) -> slice:
        """The places of the tendons' lengths."""
        start = self.mode(self.modes).start
        return slice(start, start + self.wound * self.of.n_tendons)

    def terms(self) -> list[Term]:
        """Return the terms of all equations, in the places of the program."""
        place = self.places()
        equilibrium = self.of.equations.terms
        terms = [Term(term.kernel, place[term.unknowns], term.rows) for term in equilibrium]
        for k, request in enumerate(self.responses):
            shift, row = self.response(k).start, self.response_rows(k).start
            for term in equilibrium:
                unknowns = np.vstack([place[term.unknowns], shift + term.unknowns])
                terms.append(Term(tangent(term.kernel), unknowns, row + term.rows))
            terms += self._held(request, place, shift, row + self.of.n_states)
        row = self.response_rows(len(self.responses)).start
        for k in range(self.modes):
            terms += mode_terms(self.of, place, self.mode(k).start, row)
            row += self.of.n_states + 1
        if self.wound:
            (runs,) = self.of.lengths.terms
            own_places = np.arange(self.lengths.start, self.lengths.stop)[None, :]
            rows = row + np.arange(self.of.n_tendons)[None, :]
            terms.append(Term(runs.kernel, place[runs.unknowns], row + runs.rows))
            terms.append(Term(_scaled(), own_places, rows))
        return terms

    def _held(self, request: ComplianceRequest, place: Places, shift: int, row: int) -> list[Term]:
        """Return what holds the tendons while the arm responds, and the load factor that stays."""
        n = self.of.n_tendons
        tensions, rows = shift + np.arange(n)[None, :], row + np.arange(n)[None, :]
        terms = [Term(_scaled(), np.array([[shift + n]]), np.array([[row + n]]))]
        if request.hold == "tension":
            return [*terms, Term(_scaled(), tensions, rows)]
        (lengths,) = self.of.lengths.terms
        kernel = _locked(self.of.form.law)
        unknowns = np.vstack(
            [place[lengths.unknowns], shift + lengths.unknowns, shift + lengths.rows]
        )
        terms.append(Term(kernel, unknowns, row + lengths.rows))
        return [*terms, Term(_scaled(), tensions, rows)]


@lru_cache(maxsize=1)
def _scaled() -> Kernel:
    """Return the kernel of a number times an unknown."""
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    return Kernel("scaled", x, c, c * x)


@lru_cache(maxsize=16)
def _locked(law: CrossSection) -> Kernel:
    """Return the kernel of a locked tendon: how its path lengthens, less how its tension does.

    Strains, their changes, change of its tension; its path and a weight, 1 / E A of the tendon.
    """
    kernel = run(law)
    change, pull = ca.SX.sym("change", size(law)), ca.SX.sym("pull")
    compliance = ca.SX.sym("compliance")
    grows = ca.jtimes(kernel.r, kernel.y, change) - kernel.r * pull * compliance
    y = ca.vertcat(kernel.y, change, pull)
    return Kernel("locked", y, ca.vertcat(kernel.c, compliance), grows)


class States:
    """The states of one arm in a program.

    Attributes
    ----------
    force : float
        The small force of the responses [N].
    scale : (size,)
        What one unit of each unknown behind the tensions is worth.
    row_scale : (n_rows,)
        What one unit of each equation is worth.
    """

    def __init__(
        self,
        at: System,
        requests: tuple[ComplianceRequest, ...],
        compliance: float,
        modes: int = 0,
        wound: bool = False,
    ) -> None:
        self.at, self.compliance, self.wound = at, compliance, wound
        self.requests, self.modes = requests, modes
        state, row = _scales(at)
        # A force that bends the straight arm by about 1 rad.
        R = float(at.arm.radius.evaluate(np.zeros(1), at.arm.length)[0][0])
        self.force = at.arm.material.E * np.pi * R**4 / 4 / at.arm.length**2
        whole = np.concatenate([np.full(at.of.first, self.force), state])
        each = [request for request in requests for _ in range(request.width)]
        mode, balance = np.append(state, 1.0), np.append(row, 1.0)
        lengths = np.full(at.of.n_tendons * wound, at.arm.length)
        behind = [*[whole for _ in each], *[mode] * modes, lengths]
        self.scale = np.concatenate([[1.0], state, *behind])
        rows = [np.concatenate([row, self._held_scale(request)]) for request in each]
        self.row_scale = np.concatenate([row, *rows, *[balance] * modes, lengths])
        self._stages = state[at.of.stages].ravel()

    def _held_scale(self, request: ComplianceRequest) -> Array:
        of = self.at.of
        length = self.at.arm.length if request.hold == "length" else self.force
        return np.append(np.full(of.n_tendons, length), 1.0)

    def mode_size(self, y: Array) -> Array:
        """Return modes (n_states, k) of the size that their equations ask for."""
        return mode_size(self.at, self._stages, y)

    def numbers(self, directions: list[Array]) -> Array:
        """Return the numbers (n_p,) with the directions (3, width) of the requests."""
        at, of = self.at, self.at.of
        of_terms = [
            at.p[numbers].reshape(term.count, -1).T
            for term, numbers in zip(of.equations.terms, of.equations.slices, strict=True)
        ]
        columns = list(of_terms)
        pairs = [
            (request, d) for request, D in zip(self.requests, directions, strict=True) for d in D.T
        ]
        for request, d in pairs:
            for term, numbers in zip(of.equations.terms, of_terms, strict=True):
                change = np.zeros_like(numbers)
                if term.kernel.name == "element":
                    change[1:4] = self.force * d[:, None]
                columns.append(np.vstack([numbers, change]))
            columns.append(np.ones((1, 1)))
            if request.hold == "tension":
                columns.append(np.ones((1, of.n_tendons)))
                continue
            lengths = at.length_numbers.reshape(-1, 5).T
            stretch = 0.0 if request.tendon_EA is None else 1 / request.tendon_EA
            columns.append(np.vstack([lengths, np.full((1, lengths.shape[1]), stretch)]))
            columns.append(np.full((1, of.n_tendons), -self.compliance))
        for _ in range(self.modes):
            columns += [*of_terms, *mode_numbers(at, self._stages)]
        if self.wound:
            columns += [at.length_numbers.reshape(-1, 5).T, np.full((1, of.n_tendons), -1.0)]
        return np.concatenate([np.ravel(column, "F") for column in columns])


def _scales(at: System) -> tuple[Array, Array]:
    """Return what one unit of each state and of each equation of equilibrium is worth."""
    of, L = at.of, at.arm.length
    R = at.arm.radius.evaluate(np.concatenate([at.mesh.s, at.s]), L)[0]
    EA = at.arm.material.E * np.pi * R**2
    EJ = EA * R**2 / 4
    nodes = at.mesh.s.size
    state, row = np.ones(of.n_states), np.ones(of.n_states)
    at_nodes = [np.ones((nodes, 4)), np.full((nodes, 3), L)]
    for part in range(of.form.wrench // 3):
        at_nodes.append(np.repeat(EJ[:nodes, None] / L ** (1 + part), 3, axis=1))
    at_nodes.append(np.ones((nodes, of.turned.shape[1])))
    state[of.nodes] = row[of.nodes] = np.hstack(at_nodes)
    curved = np.arange(of.form.strains) < 2 + of.form.law.torsion
    state[of.stages] = np.where(curved, 1 / L, 1.0)
    row[of.stages] = np.where(curved, EJ[nodes:, None] / L, EA[nodes:, None])
    if of.form.friction:
        state[of.rates], row[of.rates] = state[of.stages] / L, row[of.stages] / L
    return state, row


def mode_terms(of: Layout, place: Places, shift: int, row: int) -> list[Term]:
    """Return the terms of a mode whose unknowns begin at `shift`, and its equations at `row`.

    `place` are the places in the program of the unknowns of the layout.
    """
    terms = []
    for term in of.equations.terms:
        is_state = term.unknowns >= of.first
        if not np.all(is_state == is_state[:, :1]):
            raise AssertionError("tensions and states in one row of a term")
        rows = tuple(np.flatnonzero(is_state[:, 0]).tolist())
        change = shift + term.unknowns[list(rows)] - of.first
        kernel = mode(term.kernel, rows)
        terms.append(Term(kernel, np.vstack([place[term.unknowns], change]), row + term.rows))
    stages, last = np.ravel(of.stages), of.n_states
    eigenvalue = np.full(stages.size, shift + last)
    unknowns = np.stack([eigenvalue, shift + stages])
    terms.append(Term(_inertia(), unknowns, row + stages[None, :]))
    size = np.full((1, stages.size), row + last)
    return [*terms, Term(_square(), shift + stages[None, :], size)]


def mode_numbers(at: System, scale: Array) -> list[Array]:
    """Return the numbers (n_c, N) of the last two terms of a mode; `scale` (n,) of the strains."""
    weight, stiff = rest_stiffness(at)
    weights = weight / at.arm.length / scale**2
    return [-stiff[None, :], np.stack([weights, np.full(weights.size, 1 / weights.size)])]


def mode_size(at: System, scale: Array, y: Array) -> Array:
    """Return modes (n_states, k) of the size that their equation asks for."""
    weight, _ = rest_stiffness(at)
    strains = y[np.ravel(at.of.stages)] / scale[:, None]
    return np.asarray(y / np.sqrt((weight[:, None] * strains**2).sum(axis=0) / at.arm.length))


@lru_cache(maxsize=1)
def _inertia() -> Kernel:
    """Return the kernel of an eigenvalue times a stiffness and a strain."""
    y, stiff = ca.SX.sym("y", 2), ca.SX.sym("stiff")
    return Kernel("inertia", y, stiff, stiff * y[0] * y[1])


@lru_cache(maxsize=1)
def _square() -> Kernel:
    """Return the kernel of a part of a mode's size, less the size that it is scaled to."""
    y, c = ca.SX.sym("y"), ca.SX.sym("c", 2)
    return Kernel("size", y, c, c[0] * y**2 - c[1])
