"""Poses along an arm with their derivatives by the tensions, where strains are closed forms.

Derivatives are spatial twists zeta (6,), rotation and displacement at the origin, by which a pose g
becomes exp(zeta) g. Steps add them up along the arm (model.unloaded.tip_slopes, hessian_step).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from model.machine.compiled import kernels
from model.stations import base_pose
from model.unloaded.closed_form import ClosedForm, nodes_of, pull_and_data
from model.unloaded.hessian_step import across, hessian_step
from model.unloaded.pulls import TERMS, PullPolynomials
from model.unloaded.statics import closed_statics
from model.unloaded.tip_slopes import twist_step


class PoseDerivatives:
    """The poses at some nodes of a mesh, as expressions of the tensions T (n,)."""

    def __init__(
        self,
        forward: ClosedForm,
        polynomials: PullPolynomials,
        nodes: Sequence[int],
        machine_code: bool,
    ) -> None:
        self.forward, self.polynomials, self.nodes = forward, polynomials, tuple(nodes)
        statics = closed_statics(forward.scene, forward.arm)
        both = twist_step(statics, forward.scheme), hessian_step(statics, forward.scheme)
        self._twists, self._hessian = kernels(both, machine_code)
        self._n = TERMS * statics.n_pull
        # The step at whose end the tendons of each section end.
        active = forward.mesh.active
        self._ends = [int(np.flatnonzero(active > i)[-1]) + 1 for i in range(len(polynomials.own))]

    def first(self, T: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the poses (7, K), and their twists per newton (6 K, n), one below the other."""
        states = ca.horzcat(self._start, self._across_steps(self._twists)(*self._given(T)))
        poses = ca.horzcat(*(states[:7, node] for node in self.nodes))
        return poses, ca.vertcat(ca.MX(0, T.numel()), *(self._at(states, k) for k in self.nodes))

    def second(self, T: ca.MX, wrenches: ca.MX) -> ca.MX:
        """Return the second derivatives (n, n) of the twists' work with wrenches (6, K).

        A wrench is a moment about the origin, then a force.
        """
        columns = []
        for k in range(self.forward.mesh.steps):
            beyond = [wrenches[:, i] for i, node in enumerate(self.nodes) if node > k]
            columns.append(sum(beyond[1:], beyond[0]) if beyond else ca.MX.zeros(6))
        across_steps = self._across_steps(self._hessian)
        states, added = across_steps(*self._given(T), ca.horzcat(*columns))
        return self._gathered(ca.horzcat(self._start, states), added, columns)

    def _gathered(self, states: ca.MX, added: ca.MX, wrenches: list[ca.MX]) -> ca.MX:
        """Return the Hessian by tensions from what steps add by coefficients, (n (n + 1) / 2, S).

        Of two sections the one that ends first shares its steps with the other; beyond, its twists
        are those before the other's.
        """
        own, ends, blocks = self.polynomials.own, self._ends, {}
        lower = ca.Sparsity.lower(self._n)
        for i, end in enumerate(ends):
            part = ca.MX(lower, ca.sum2(added[:, :end]))
            shared = ca.DM(own[i]).T @ ca.tril2symm(part)
            here = ca.reshape(states[7:, end], 6, -1)
            twists = here @ ca.DM(own[i])
            for j in range(i + 1):
                block = shared @ ca.DM(own[j])
                for first, last, wrench in self._stretches(end, ends[j], wrenches):
                    moved = ca.reshape(states[7:, last] - states[7:, first], 6, -1)
                    block += twists.T @ across(moved @ ca.DM(own[j]), wrench) / 2
                blocks[i, j], blocks[j, i] = block, block.T
        rows = range(len(ends))
        return ca.vertcat(*(ca.horzcat(*(blocks[i, j] for j in rows)) for i in rows))

    def _stretches(
        self, first: int, last: int, wrenches: list[ca.MX]
    ) -> list[tuple[int, int, ca.MX]]:
        """Return the parts (from node, to node, wrench) between nodes, split where looked at."""
        cuts = sorted({first, last, *(k for k in self.nodes if first < k < last)})
        return [(a, b, wrenches[a]) for a, b in pairwise(cuts)]

    def _at(self, states: ca.MX, node: int) -> ca.MX:
        """Return the twists (6, n) of a node per newton."""
        columns = []
        for own, end in zip(self.polynomials.own, self._ends, strict=True):
            columns.append(ca.reshape(states[7:, min(node, end)], 6, -1) @ ca.DM(own))
        found: ca.MX = ca.horzcat(*columns)
        return found

    def _across_steps(self, step: ca.Function) -> ca.Function:
        """Return a function of twist_step's states chained over all steps, from the base."""
        return step.mapaccum(self.forward.mesh.steps)

    @cached_property
    def _start(self) -> ca.DM:
        found: ca.DM = ca.vertcat(base_pose(self.forward.arm), ca.DM.zeros(6 * self._n))
        return found

    def _given(self, T: ca.MX) -> tuple[ca.DM, ca.MX, ca.DM, ca.DM, ca.DM]:
        """Return the first state, then pull, data, lengths and basis of all steps."""
        arm, mesh, scheme = self.forward.arm, self.forward.mesh, self.forward.scheme
        s = nodes_of(scheme, mesh.s[:-1], mesh.s[1:])
        statics = closed_statics(self.forward.scene, arm)
        pull, data = pull_and_data(arm, statics, s, np.repeat(mesh.active, len(scheme.nodes)), T)
        lengths, basis = ca.DM(np.diff(mesh.s)).T, ca.DM(self.polynomials.basis(s))
        return self._start, pull, data, lengths, basis
