"""Where unknowns and equations of an arm's elements, anchorages and ends have their places.

The unknowns are the tensions, the load factor, then from base to tip each node and the stages of
the element beyond it. A node has its pose q (4,), u (3,), moment M (3,), force F (3,), with
friction the angle Theta that each tendon has turned, and of each contact its two unknowns; a stage
has its strains, and with friction their rates; as far as the form has them. Where a force acts off
the midline the moment is that on its base side, where the arm touches something the force is.
Equations and states stand in the same order, so that the Jacobian is a narrow band.
At an anchorage pose, moment and force are those of one node, and the tendons that cross change:
that is the interface condition between segments, across which the strains jump.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from octoplan.model.paths import Mask
from octoplan.model.rod.element import (
    Form,
    at_zero,
    body,
    clamp,
    element,
    lever,
    run,
    tendon,
    tip,
)
from octoplan.model.rod.equations import Equations, Term
from octoplan.model.rod.friction import body_rates, idle_tendon, kink, sliding_tendon
from octoplan.model.rod.kernels import Places
from octoplan.model.rod.touch import pressure, touch
from octoplan.model.support.machine.functions import cached

POSE = 7


class Band:
    """Where the nonzeros of a layout's Jacobian are, and in LAPACK's band storage.

    Attributes
    ----------
    rows, columns : (nnz,)
        Of all nonzeros; columns are tensions, load factor, states.
    first : int
        The first column of the states.
    below, above : int
        Width of the band.
    height : int
        Rows of the storage, those that pivoting fills among them.
    inside : (n,)
        Which nonzeros are against the states.
    states, equations : (n_states,)
        Their order in the storage. Of a node's states the quaternion comes last, on which all of
        its element depends, and equations come in the order of their first states: the band is as
        narrow as that, and a factorisation costs its width times what is below the diagonal.
    stored : (n,)
        Where those inside stand in the storage, column by column.
    """

    def __init__(self, of: Layout) -> None:
        self.first, n = of.first, of.n_states
        self.rows, self.columns = (each[:-n] for each in of.equations.jacobian.triplet)
        self.inside = np.flatnonzero(self.columns >= of.first)
        self.states = np.arange(n)
        self.states[of.nodes] = np.roll(of.nodes, -4, axis=1)
        column = np.argsort(self.states)[self.columns[self.inside] - of.first]
        earliest = np.full(n, n)
        np.minimum.at(earliest, self.rows[self.inside], column)
        self.equations = np.argsort(earliest, kind="stable")
        row = np.argsort(self.equations)[self.rows[self.inside]]
        self.below, self.above = int((row - column).max()), int((column - row).max())
        self.height = 2 * self.below + self.above + 1
        self.stored = column * self.height + self.below + self.above + row - column


class Layout:
    """The structure of an arm's equations on a mesh; numbers are no part of it.

    Places are those among the states, of N elements with m stages each.

    Attributes
    ----------
    form : Form
    ends : (n_tendons,)
        The element, counted from 1 at the base, at whose far node each tendon ends.
    elements : int
        N.
    levers : tuple of int
        The nodes at which forces act off the midline.
    first : int
        Place of the first state among all unknowns, behind the tensions and the load factor.
    n_tendons, n_states, n_x : int
        Numbers of tensions, of states and equations, of all unknowns.
    touching : int
        Number of a node's unknowns that are about contact.
    node_size, stage_size, stride : int
        Numbers of unknowns of a node, of the stages of an element, of both.
    nodes : (N + 1, node_size)
        Places of the nodes' unknowns.
    inside : (stage_size, N)
        Places of all that the stages of each element have.
    stages, rates : (N m, strains)
        Places of the strains, from base to tip, and of their rates with friction.
    turned : (N + 1, n_tendons)
        Places of the angles that tendons have turned, with friction.
    touches : (N + 1, contacts, 2)
        Places of the two unknowns of each contact; see touch.
    friction_forces, tractions : (N + 1, contacts, 3)
        Places of the friction of each contact, and of that per length; see touch.
    crossings : (P,), (P,)
        Stage and tendon of each crossing of a tendon through the cross-section of a stage.
    passages : (P,), (P,)
        Element and tendon of each passage of a tendon through an element.
    lengths : Equations
        The lengths of the tendons [m].
    kinks : (P,), (P,)
        Element before an anchorage, and tendon, for each that goes on beyond one.
    """

    def __init__(
        self, form: Form, ends: tuple[int, ...], elements: int, levers: tuple[int, ...] = ()
    ) -> None:
        self.form, self.ends, self.elements, self.levers = form, ends, elements, levers
        self.n_tendons, self.first, K = len(ends), len(ends) + 1, form.contacts
        self.touching = (2 + 6 * form.contact_friction) * K
        turning = self.n_tendons * form.friction
        self.node_size = POSE + form.wrench + turning + self.touching
        n, m = form.strains, form.stages
        self.stage_size = m * n * (1 + form.friction)
        self.stride = self.node_size + self.stage_size
        self.n_states = elements * self.stride + self.node_size
        self.n_x = self.first + self.n_states
        start = np.arange(elements + 1) * self.stride
        self.nodes: Places = start[:, None] + np.arange(self.node_size)
        self.inside: Places = start[:-1] + self.node_size + np.arange(self.stage_size)[:, None]
        by_stage: Places = self.inside.T.reshape(elements * m, -1)
        self.stages, self.rates = by_stage[:, :n], by_stage[:, n:]
        first = POSE + form.wrench
        self.turned, touching = self.nodes[:, first : first + turning], first + turning
        values = self.nodes[:, touching : touching + 2 * K]
        self.touches: Places = values.reshape(elements + 1, K, 2)
        self._frictions: Places = self.nodes[:, touching + 2 * K :].reshape(elements + 1, -1, 6)
        self.friction_forces, self.tractions = self._frictions[:, :, :3], self._frictions[:, :, 3:]
        self.passages = _pairs(np.arange(elements)[:, None] < np.array(ends))
        self.crossings = stage, number = _pairs(
            np.repeat(np.arange(elements), m)[:, None] < np.array(ends)
        )
        crossed = self.first + self.stages[stage].T
        term = Term(cached(run, form.law), crossed, number[None, :])
        self.lengths = Equations(self.n_x, self.n_tendons, [term], form.machine_code)
        at = np.array(sorted({end for end in ends if end < elements}), dtype=np.int64)
        k, j = _pairs(at[:, None] < np.array(ends))
        self.kinks: tuple[Places, Places] = (at[k] - 1, j)

    @cached_property
    def band(self) -> Band:
        """Where the nonzeros of the Jacobian are, in LAPACK's band storage."""
        return Band(self)

    @cached_property
    def equations(self) -> Equations:
        """The equilibrium: as many equations as states, group by group."""
        terms = [
            *self.base_condition(),
            *self.dynamics(),
            *self.stage_equations(),
            *self.jumps(),
            *self.tip_condition(),
        ]
        return Equations(self.n_x, self.n_states, terms, self.form.machine_code)

    @property
    def _node_states(self) -> Places:
        """Places of pose, moment and force of the nodes (N + 1, 7 + wrench)."""
        return self.nodes[:, : POSE + self.form.wrench]

    def base_condition(self) -> list[Term]:
        """Return the clamped base; tendons have turned by 0 and nothing is touched there."""
        at = self.first
        pose = self.nodes[:1, :POSE].T
        terms = [Term(clamp(), at + pose, pose)]
        if self.form.friction:
            terms.append(Term(at_zero(), at + self.turned[:1], self.turned[:1]))
        if self.form.contacts:
            free = self.touches[0].reshape(1, -1)
            if self.form.contact_friction:
                free = np.hstack([free, self._frictions[0].reshape(1, -1)])
            terms.append(Term(at_zero(), at + free, free))
        return terms

    def dynamics(self) -> list[Term]:
        """Return the elements: x_{k+1} = F(x_k, v_k), and the local wrench of all stages."""
        at, nodes = self.first, self._node_states
        load = np.full((1, self.elements), self.n_tendons)[: int(self.form.loaded)]
        values = at + np.vstack([nodes[:-1].T, self.inside])
        unknowns = np.vstack([load, values, at + nodes[1:].T])
        # The pose of a node is an equation of the element before, the wrench of the one beyond.
        rows = np.vstack([nodes[:-1, POSE:].T, self.inside, nodes[1:, :POSE].T])
        return [Term(cached(element, self.form), unknowns, rows)]

    def stage_equations(self) -> list[Term]:
        """Return body and tendons of the stages, which balance the local wrench."""
        return self._sliding_tendons() if self.form.friction else self._tendons()

    def jumps(self) -> list[Term]:
        """Return the jumps at nodes: moments of forces off the midline, kinks, contact."""
        terms = list[Term]()
        if self.levers:
            values = self._node_states[list(self.levers)].T
            loads = np.full((1, len(self.levers)), self.n_tendons)
            unknowns = np.vstack([loads, self.first + values[:4]])
            terms.append(Term(lever(), unknowns, values[POSE : POSE + 3]))
        terms += self._kinks() if self.form.friction else []
        terms += self._contact() if self.form.contacts else []
        return terms

    def tip_condition(self) -> list[Term]:
        """Return M_N and F_N equal to the load on the tip; no equation without loads."""
        if not self.form.loaded:
            return []
        at, last = self.first, self._node_states[-1]
        ends = np.concatenate([[self.n_tendons], at + last[:4], at + last[POSE:]])
        return [Term(tip(self.form), ends[:, None], last[POSE:, None])]

    def _contact(self) -> list[Term]:
        """Return the contact of the nodes, each with all obstacles, and of the elements."""
        form, at, touches, nodes = self.form, self.first, self.touches, self.nodes
        law, m, K = form.law, form.stages, form.contacts
        inside = np.repeat(self.inside.T, K, axis=0)
        before, after = (np.repeat(part[:, :POSE], K, axis=0) for part in (nodes[:-1], nodes[1:]))
        wrench = np.repeat(nodes[:, POSE : POSE + 6], K, axis=0)
        here = touches[1:].reshape(self.elements * K, -1)
        unknowns, rows = [inside, after, here], [wrench[K:], here]
        if form.contact_friction:
            # No part begins at the tip, so that what is beyond it does not matter.
            beyond = [*range(2, self.elements + 1), -2]
            rubbed = np.concatenate([touches[:, :, 1:], self.tractions], axis=2)
            near = np.concatenate([rubbed[:-1], rubbed[beyond]], axis=2).reshape(-1, 8)
            Q = self._frictions[1:].reshape(-1, 6)
            unknowns, rows = [*unknowns, near, Q], [*rows, Q]
        kernel = cached(touch, law, m, form.contact_friction)
        terms = [Term(kernel, at + np.hstack(unknowns).T, np.hstack(rows).T)]
        if form.pressed:
            both = np.stack([touches[:-1, :, 1], touches[1:, :, 1]], axis=2).reshape(-1, 2)
            rubbed = np.concatenate([self.tractions[:-1], self.tractions[1:]], axis=2)
            both = np.hstack([both, rubbed.reshape(len(both), -1)])
            values = at + np.hstack([before, inside, both]).T
            kernel = cached(pressure, law, m, form.contact_friction)
            terms.append(Term(kernel, values, np.hstack([wrench[:-K], inside]).T))
        return terms

    def _tendons(self) -> list[Term]:
        """Return the bodies and tendons of the stages, tensions the same all along."""
        law, strains = self.form.law, self.stages.T
        stage, number = self.crossings
        unknowns = np.vstack([number, self.first + strains[:, stage]])
        return [
            Term(cached(body, law), self.first + strains, strains),
            Term(cached(tendon, law), unknowns, strains[:, stage]),
        ]

    def _sliding_tendons(self) -> list[Term]:
        """Return the bodies and tendons of the elements if tensions fall by friction."""
        form, law, at, turned = self.form, self.form.law, self.first, self.turned
        both = np.vstack([self.stages.T, self.rates.T])
        k, j = self.passages
        inside = self.inside[:, k]
        unknowns = [np.full(j.size, self.n_tendons), j, at + turned[k, j], at + turned[k + 1, j]]
        slides = Term(
            cached(sliding_tendon, law, form.stages),
            np.vstack([*unknowns, at + inside]),
            np.vstack([inside, turned[k + 1, j]]),
        )
        return [Term(cached(body_rates, law), at + both, both), slides]

    def _kinks(self) -> list[Term]:
        """Return the turning of tendons at anchorages; beyond its end a tendon turns no further."""
        at, turned = self.first, self.turned
        k, j = self.kinks
        bends = np.vstack([at + self.inside[:, k], at + self.inside[:, k + 1]])
        kernel = cached(kink, self.form.law, self.form.stages)
        k_idle, j_idle = np.nonzero(np.arange(self.elements)[:, None] >= np.array(self.ends))
        held = np.vstack([at + turned[k_idle, j_idle], at + turned[k_idle + 1, j_idle]])
        return [
            Term(kernel, bends, turned[k + 1, j][None, :]),
            Term(idle_tendon(), held, turned[k_idle + 1, j_idle][None, :]),
        ]


def _pairs(are: Mask) -> tuple[Places, Places]:
    """Return rows and columns of what is true."""
    i, j = np.nonzero(are)
    return i, j


# The layout of a structure, built once.
layout = lru_cache(maxsize=32)(Layout)
