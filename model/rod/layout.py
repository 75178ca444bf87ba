"""Layout of the unknowns and equations of a rod on a mesh.

The unknowns are the tensions, the load factor, then from base to tip each node and the stages of
the element beyond it. A node has its pose q (4,), u (3,), moment M (3,) and force F (3,) if the
structure has them, the states of the tendons and the node variables of the terms. A stage has its
strains and the stage variables of the terms. If a term has a force or moment at a node, M and F are
the values on the base side. Equations and states have the same order, so that the Jacobian is a
narrow band.

An anchorage is one node, which both segments share: pose, moment and force are continuous there,
the set of tendons that cross changes, and the strains jump.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from octoplan.model.paths import Mask
from octoplan.model.rod.element import clamp, element, node, node_kernel_name, tip, zero
from octoplan.model.rod.equations import Equations, PlacedKernel
from octoplan.model.rod.kernels import Places
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.rod.structure import NodeGroup, RodPlaces, RodStructure
from octoplan.model.rod.tendons import (
    body,
    idle_tendon,
    tendon,
    tendon_in_element,
    tendon_jump,
    tendon_length,
)
from octoplan.model.rotations import POSE
from octoplan.model.support.machine.functions import cached


class Layout:
    """Indices of the unknowns and equations of a rod of N elements with m stages each.

    A layout contains no parameter values. Places are indices among the states.

    Attributes
    ----------
    structure : RodStructure
    ends : (n_tendons,)
        The node up to which each tendon is guided continuously; the base is node 0, the end of all
        tendons that run straight between guides.
    elements : int
        N.
    node_groups : tuple of NodeGroup
        The terms that act at nodes.
    n_before_states : int
        Number of unknowns before the states: the tensions and the load factor.
    n_tendons, n_states, n_x : int
        Number of tensions, of states (and equations), of all unknowns.
    node_size, stage_size, stride : int
        Number of unknowns of a node, of the stages of an element, of both.
    nodes : (N + 1, node_size)
        Places of the nodes' unknowns.
    inside : (stage_size, N)
        Places of all unknowns of the stages of each element.
    stages : (N m, n_strains)
        Places of the strains, from base to tip.
    stage_variables : tuple of (N m, n)
        Places of the stage variables of each term.
    tendon_states : (N + 1, n_tendons, n_tendon_states)
        Places of the states of the tendons.
    node_variables : list of list of (N + 1, n)
        Places of the node variables, by group and term.
    crossings : (P,), (P,)
        Stage and tendon of each crossing of a tendon through the cross-section of a stage.
    passages : (P,), (P,)
        Element and tendon of each passage of a tendon through an element.
    lengths : Equations
        The lengths of the tendons [m].
    kinks : (P,), (P,)
        Element before an anchorage or a kink of tendons, and tendon, for each tendon that
        continues beyond.
    """

    def __init__(
        self,
        structure: RodStructure,
        ends: tuple[int, ...],
        elements: int,
        node_groups: tuple[NodeGroup, ...] = (),
        kink_nodes: tuple[int, ...] = (),
    ) -> None:
        self.structure = structure
        self.ends = ends
        self.elements = elements
        self.node_groups = node_groups
        self.n_tendons = len(ends)
        self.n_before_states = self.n_tendons + 1
        m = structure.stages
        n_tendon_states = self.n_tendons * structure.n_tendon_states
        variables = sum(group.n_variables * len(group.nodes) for group in node_groups)
        self.node_size = POSE + structure.n_wrench + n_tendon_states + variables
        self.stage_size = m * structure.n_stage
        self.stride = self.node_size + self.stage_size
        self.n_states = elements * self.stride + self.node_size
        self.n_x = self.n_before_states + self.n_states
        start = np.arange(elements + 1) * self.stride
        self.nodes: Places = start[:, None] + np.arange(self.node_size)
        self.inside: Places = start[:-1] + self.node_size + np.arange(self.stage_size)[:, None]
        by_stage: Places = self.inside.T.reshape(elements * m, -1)
        self.stages: Places = by_stage[:, : structure.n_strains]
        self.stage_variables = tuple(by_stage[:, part] for part in structure.variable_slices)
        column = POSE + structure.n_wrench
        states = self.nodes[:, column : column + n_tendon_states]
        self.tendon_states: Places = states.reshape(elements + 1, self.n_tendons, -1)
        column += n_tendon_states
        self.node_variables = list[list[Places]]()
        for group in node_groups:
            ends_of = column + np.arange(len(group.nodes) + 1) * group.n_variables
            self.node_variables.append([self.nodes[:, a:b] for a, b in pairwise(ends_of)])
            column = int(ends_of[-1])
        self.passages = _pairs(np.arange(elements)[:, None] < np.array(ends))
        stage_elements = np.repeat(np.arange(elements), m)
        self.crossings = _pairs(stage_elements[:, None] < np.array(ends))
        stage, tendon_index = self.crossings
        crossed = self.n_before_states + self.stages[stage].T
        of_lengths = [
            PlacedKernel(cached(tendon_length, structure.law), crossed, tendon_index[None, :])
        ]
        for term, places in self._node_terms():
            of_lengths += term.length_kernels(places)
        self.lengths = Equations(self.n_x, self.n_tendons, of_lengths, structure.machine_code)
        jumps = {end for end in ends if 0 < end < elements} | {*kink_nodes}
        nodes = np.array(sorted(jumps), dtype=np.int64)
        k, j = _pairs(nodes[:, None] < np.array(ends))
        self.kinks: tuple[Places, Places] = (nodes[k] - 1, j)

    @cached_property
    def band(self) -> Band:
        """The nonzeros of the Jacobian in LAPACK's band storage."""
        rows, columns = self.equations.jacobian.triplet
        return Band(
            rows[: -self.n_states],
            columns[: -self.n_states],
            self.n_states,
            self.n_before_states,
            self.nodes,
        )

    @cached_property
    def equations(self) -> Equations:
        """The equilibrium: as many equations as states, group by group."""
        terms = [
            *self.base_condition(),
            *self.element_equations(),
            *self.stage_equations(),
            *self.jumps(),
            *self.tip_condition(),
        ]
        return Equations(self.n_x, self.n_states, terms, self.structure.machine_code)

    @cached_property
    def clamp(self) -> slice:
        """The pose of the clamp among the parameters of the equations."""
        (part,) = [
            part
            for term, part in zip(self.equations.terms, self.equations.slices, strict=True)
            if term.kernel.name == "clamp"
        ]
        return part

    @cached_property
    def couples_nodes(self) -> bool:
        """Whether a term has node variables, or couples nodes by kernels of its own."""
        return any(
            group.n_variables or group.structure.term.couples_nodes for group in self.node_groups
        )

    @property
    def _node_states(self) -> Places:
        """Places of pose, moment and force of the nodes (N + 1, 7 + n_wrench)."""
        return self.nodes[:, : POSE + self.structure.n_wrench]

    def base_condition(self) -> list[PlacedKernel]:
        """Return the equations of the clamped base, and of the tendon states, which are 0 there."""
        pose = self.nodes[:1, :POSE].T
        return [
            PlacedKernel(clamp(), self.n_before_states + pose, pose),
            self._zero(self.tendon_states[0]),
        ]

    def element_equations(self) -> list[PlacedKernel]:
        """Return the elements: (R, u)_{k+1} from node k, and (M, F)_k from node k + 1.

        The kernel of an element also writes minus the local wrench into the rows of its stages, to
        which `stage_equations` add body and tendons.
        """
        nodes = self._node_states
        load = np.full((1, self.elements), self.n_tendons)[: int(self.structure.has_moment)]
        states = np.vstack([nodes[:-1].T, self.inside, nodes[1:].T])
        unknowns = np.vstack([load, self.n_before_states + states])
        # The element before a node has the equations of its pose; the element beyond has the
        # equations of its wrench.
        rows = np.vstack([nodes[:-1, POSE:].T, self.inside, nodes[1:, :POSE].T])
        return [PlacedKernel(cached(element, self.structure), unknowns, rows)]

    def stage_equations(self) -> list[PlacedKernel]:
        """Return the shares of body and tendons in the stage equations G = 0.

        The kernels of elements of the terms are added: their loads, such as pressure.
        """
        by_stage = np.vstack([self.stages.T, *(each.T for each in self.stage_variables)])
        kernel = cached(body, self.structure)
        bodies = PlacedKernel(kernel, self.n_before_states + by_stage, by_stage)
        couples = self.structure.couples_stages
        tendons = self._tendons_in_elements() if couples else self._tendons()
        loads = [
            placed for term, places in self._node_terms() for placed in term.element_kernels(places)
        ]
        return [bodies, tendons, *loads]

    @cached_property
    def node_kernel_names(self) -> frozenset[str]:
        """The names of the kernels with jumps of moment and force at nodes as rows."""
        return frozenset(term.kernel.name for term in self._at_nodes()) - {"zero"}

    def jumps(self) -> list[PlacedKernel]:
        """Return the jumps at nodes: of moments and forces, and of tendon states."""
        terms = self._at_nodes() if self.structure.has_moment else []
        terms += self._tendon_jumps() if self.structure.n_tendon_states else []
        return terms

    def tip_condition(self) -> list[PlacedKernel]:
        """Return M_N = 0 and F_N = 0, to which `jumps` add loads at the tip; [] without loads."""
        if not self.structure.has_moment:
            return []
        wrench = self._node_states[-1:, POSE:].T
        return [PlacedKernel(cached(tip, self.structure), self.n_before_states + wrench, wrench)]

    def _node_terms(self) -> list[tuple[RodTerm, RodPlaces]]:
        """Return the terms that act at nodes, with the places for their own kernels."""
        return [
            (group.structure.term, self._places(variables, nodes))
            for group, members in zip(self.node_groups, self.node_variables, strict=True)
            for variables, nodes in zip(members, group.nodes, strict=True)
        ]

    def _places(self, variables: Places, acting: tuple[int, ...]) -> RodPlaces:
        """Return the places for a term's own kernels, by its node variables and its nodes."""
        return RodPlaces(
            self.structure, self.n_before_states, self._node_states, self.inside, variables, acting
        )

    def _zero(self, places: Places) -> PlacedKernel:
        """Return equations that fix states at 0."""
        flat = places.reshape(1, -1)
        return PlacedKernel(zero(), self.n_before_states + flat, flat)

    def _at_nodes(self) -> list[PlacedKernel]:
        """Return the forces, moments and node equations of the terms at the nodes."""
        terms = list[PlacedKernel]()
        wrench = slice(POSE, POSE + self.structure.n_wrench)
        for i, group in enumerate(self.node_groups):
            nodes = [k for each in group.nodes for k in each]
            variables = self.node_variables[i]
            pairs = zip(variables, group.nodes, strict=True)
            here = np.vstack([places[list(each)] for places, each in pairs]).T
            own_kernels = [
                placed
                for places, acting in zip(variables, group.nodes, strict=True)
                for placed in group.structure.term.node_kernels(self._places(places, acting))
            ]
            terms += own_kernels
            if nodes and not own_kernels:
                load = np.full((1, len(nodes)), self.n_tendons)
                poses = self.nodes[nodes, :POSE].T
                unknowns = np.vstack(
                    [load, self.n_before_states + poses, self.n_before_states + here]
                )
                rows = np.vstack([self.nodes[nodes, wrench].T, here])
                name = node_kernel_name(i)
                kernel = cached(node, name, group.structure, self.structure.n_wrench)
                terms.append(PlacedKernel(kernel, unknowns, rows))
            unused = np.setdiff1d(np.concatenate([each.ravel() for each in variables]), here)
            terms.append(self._zero(unused))
        return terms

    def _tendons(self) -> PlacedKernel:
        """Return the tendons of constant tension at the stages."""
        strains = self.stages.T
        stage, tendon_index = self.crossings
        unknowns = np.vstack([tendon_index, self.n_before_states + strains[:, stage]])
        return PlacedKernel(cached(tendon, self.structure.law), unknowns, strains[:, stage])

    def _tendons_in_elements(self) -> PlacedKernel:
        """Return the tendons of the elements, with their states at the nodes."""
        y = self.tendon_states
        k, j = self.passages
        inside = self.inside[:, k]
        load = np.full((1, j.size), self.n_tendons)
        states = np.vstack([y[k, j].T, y[k + 1, j].T, inside])
        unknowns = np.vstack([load, j[None], self.n_before_states + states])
        rows = np.vstack([inside, y[k + 1, j].T])
        return PlacedKernel(cached(tendon_in_element, self.structure), unknowns, rows)

    def _tendon_jumps(self) -> list[PlacedKernel]:
        """Return the jumps of tendon states at anchorages; states are constant beyond the end."""
        y = self.tendon_states
        k, j = self.kinks
        both = np.vstack([self.inside[:, k], self.inside[:, k + 1]])
        k_idle, j_idle = np.nonzero(np.arange(self.elements)[:, None] >= np.array(self.ends))
        before = y[k_idle, j_idle].reshape(1, -1)
        after = y[k_idle + 1, j_idle].reshape(1, -1)
        idle = np.vstack([before, after])
        jump = cached(tendon_jump, self.structure)
        return [
            PlacedKernel(jump, self.n_before_states + both, y[k + 1, j].T),
            PlacedKernel(idle_tendon(), self.n_before_states + idle, after),
        ]


def _pairs(are: Mask) -> tuple[Places, Places]:
    """Return the rows and columns of the true entries."""
    i, j = np.nonzero(are)
    return i, j


class Band:
    """Indices of the nonzeros of the Jacobian, and their places in LAPACK's band storage.

    Attributes
    ----------
    rows, columns : (nnz,)
        Equation and unknown of each nonzero; unknowns are tensions, load factor, states.
    inside : (n,)
        Indices of the nonzeros in the columns of the states.
    below, above : int
        Numbers of diagonals below and above the main diagonal.
    height : int
        Number of rows of the storage, with the rows that pivoting fills.
    states, equations : (n_states,)
        Order of states and equations in the storage. The quaternion of a node, on which its whole
        element depends, is the last of the states of the node, and equations have the order of
        their first states. This order makes the band narrow. The cost of a factorisation is
        proportional to its width times the number of diagonals below the main diagonal.
    stored : (n,)
        Place in the storage of each nonzero in `inside`, column by column.
    """

    def __init__(
        self,
        rows: Places,
        columns: Places,
        n_states: int,
        n_before_states: int,
        nodes: Places,
    ) -> None:
        """Choose the order.

        Parameters
        ----------
        rows, columns : (nnz,)
        n_states, n_before_states : int
        nodes : (N + 1, node_size)
            Places of the unknowns of each node among the states; the quaternion first.
        """
        self.rows = rows
        self.columns = columns
        self.inside = np.flatnonzero(columns >= n_before_states)
        self.states = np.arange(n_states)
        self.states[nodes] = np.roll(nodes, -4, axis=1)
        column = np.argsort(self.states)[columns[self.inside] - n_before_states]
        earliest = np.full(n_states, n_states)
        np.minimum.at(earliest, rows[self.inside], column)
        self.equations = np.argsort(earliest, kind="stable")
        row = np.argsort(self.equations)[rows[self.inside]]
        self.below = int((row - column).max())
        self.above = int((column - row).max())
        self.height = 2 * self.below + self.above + 1
        self.stored = column * self.height + self.below + self.above + row - column


# Return the layout of a structure; cached.
layout = lru_cache(maxsize=32)(Layout)
