"""The states of an arm as unknowns of a program, with the equations of equilibrium.

They are those of model.transcription.layout: poses, moments and forces at the nodes, strains at the
stages of each element, and what friction adds; the tensions change at the anchorages.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.paths import Array
from model.transcription.collocation import gauss
from model.transcription.equations import Term
from model.transcription.kernels import Places
from model.transcription.layout import POSE, Layout
from model.transcription.system import System


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
class States:
    """The states and the equations of equilibrium; see planner.program.blocks.

    Attributes
    ----------
    of : Layout
    stations : Stations
    """

    of: Layout
    stations: Stations

    is_linear = False

    @property
    def size(self) -> int:
        """See Block.size."""
        return self.of.n_states

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See Block.terms."""
        terms = self.of.equations.terms
        return [Term(term.kernel, place[term.unknowns], row + term.rows) for term in terms]

    def numbers(self, at: System, along: Array) -> list[Array]:
        """See Block.numbers."""
        return numbers_of_terms(at)

    def scales(self, at: System) -> tuple[Array, Array]:
        """See Block.scales."""
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

    def poses(self, states: ca.MX) -> ca.MX:
        """Return the poses (7, K) at the stations, of states in SI."""
        places = self.of.nodes[list(self.stations.nodes), :POSE]
        return ca.reshape(states[places.ravel().tolist()], POSE, len(places))

    def stretches(self, states: ca.MX) -> ca.MX:
        """Return 1 + q where it is least in each segment, by the polynomials through the stages."""
        law, m, stretches = self.of.form.law, self.of.form.stages, [ca.MX(0, 1)]
        for element, end in self.stations.slim:
            places = self.of.stages[element * m : (element + 1) * m, 2 + law.torsion]
            weights = ca.DM(gauss(m).at(float(end)))
            stretches.append(ca.dot(weights, states[places.tolist()]) + 1 - law.along_at_rest)
        return ca.vertcat(*stretches)


def numbers_of_terms(at: System) -> list[Array]:
    """Return the numbers (n_c, N) of each term of the equations of equilibrium."""
    equations = at.of.equations
    terms = zip(equations.terms, equations.slices, strict=True)
    return [at.p[numbers].reshape(term.count, -1).T for term, numbers in terms]
