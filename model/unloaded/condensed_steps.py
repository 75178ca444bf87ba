"""The poses of a closed form and their derivatives by the tensions, step by step.

CasADi differentiates the strains of one cross-section by its tendons' resultants, and one step by
the pose before it and the strains e at its nodes. Along the arm the chain rule does the rest: with
A, B the derivatives of a step by pose and strains, E those of strains by the tensions, and H the
second ones of lam . (pose after the step),

    P after a step = A P + B E              from the base to the tip: derivatives of the poses
    lam before it = A^T lam + weights       from the tip to the base
    Hessian = sum of (P, E)^T H (P, E)      of the weighted sum of poses,

and the second derivatives of B^T lam . e besides. That is the condensing of multiple shooting;
source: Bock, Plitt, "A multiple shooting algorithm for direct solution of optimal control
problems", IFAC Proc. 17 (1984). The kernels are those of one step, so that they compile soon,
whatever the mesh and the number of tendons.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.integrators.magnus import Magnus
from model.machine.compiled import kernels
from model.rotations import compose
from model.stations import base_pose
from model.unloaded.closed_form import ClosedForm, strain_function, twist
from model.unloaded.statics import ClosedStatics, closed_statics

# Numbers of a pose; of the strains at a node: xi, k, q.
_POSE, _STRAINS = 7, 3


class CondensedSteps:
    """Poses at some nodes of a closed form, by tensions, and their derivatives."""

    def __init__(self, forward: ClosedForm, nodes: list[int], machine_code: bool) -> None:
        arm, scheme = forward.arm, forward.scheme
        self.n, self.steps, self._seen = arm.n_tendons, max([*nodes, 1]), nodes
        self._m = len(scheme.nodes)
        count = self.steps * self._m
        maps = forward.maps[:count]
        self._maps, self._by_node = (
            ca.sparsify(ca.DM(maps.reshape(-1, self.n))),
            np.hstack(list(maps)),
        )
        self._data = ca.DM(forward.data[:count].T)
        self._h = ca.DM(np.diff(forward.mesh.s)[None, : self.steps])
        self._base = ca.DM(base_pose(arm))
        statics = closed_statics(forward.scene, arm)
        functions = (*_strain_kernels(statics), *_step_kernels(scheme))
        self._strain, self._strain_first, self._strain_second, *rest = kernels(
            functions, machine_code
        )
        self._march, self._first, self._second = rest

    def poses(self, T: ca.MX) -> ca.MX:
        """Return the poses (7, K) at the nodes under tensions (n_tendons,)."""
        return self._poses(self._by_step(self._each(self._strain)(*self._pulled(T))))[:, self._seen]

    def first(self, T: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the poses (7, K), and their derivatives by the tensions (7 K, n_tendons)."""
        poses, slopes = self._slopes(T)[:2]
        by_node = ca.horzsplit(slopes, self.n)
        return poses[:, self._seen], ca.vertcat(*(by_node[node] for node in self._seen))

    def second(self, T: ca.MX, weights: ca.MX) -> ca.MX:
        """Return the Hessian (n_tendons, n_tendons) of a weighted sum (7, K) of the poses."""
        poses, slopes, strains, by_tensions, by_pose, by_strains = self._slopes(T)
        lam = self._adjoints(by_pose, weights)
        H = self._second.map(self.steps)(poses[:, : self.steps], strains, self._h, lam)
        start, before = ca.MX.zeros(self.n, self.n), slopes[:, : self.steps * self.n]
        folded = _folded(self.n, self._m * _STRAINS).fold(self.steps)(start, before, by_tensions, H)
        works = _works(self._m * _STRAINS).map(self.steps)(by_strains, lam)
        own = self._each(self._strain_second)(*self._pulled(T), ca.reshape(works, _STRAINS, -1))
        rows = self._by_node.shape[0]
        return _own(self.n, rows).fold(self.steps * self._m)(folded, self._by_node, own)

    def _pulled(self, T: ca.MX) -> tuple[ca.MX, ca.DM]:
        """Return the resultants at all nodes of all steps, and the numbers there."""
        return ca.reshape(self._maps @ T, -1, self.steps * self._m), self._data

    def _each(self, function: ca.Function) -> ca.Function:
        return function.map(self.steps * self._m)

    def _by_step(self, strains: ca.MX) -> ca.MX:
        return ca.reshape(strains, -1, self.steps)

    def _poses(self, strains: ca.MX) -> ca.MX:
        """Return the poses at all nodes (7, steps + 1)."""
        after = self._march.mapaccum(self.steps)(self._base, strains, self._h)
        return ca.horzcat(self._base, after)

    def _slopes(self, T: ca.MX) -> tuple[ca.MX, ...]:
        """Return the poses, P at all nodes, strains, E, A and B of all steps."""
        size = self._m * _STRAINS
        strains, by_pull = self._each(self._strain_first)(*self._pulled(T))
        chained = _chained(self.n, self._m, self._by_node.shape[0])
        by_tensions = chained.map(self.steps)(by_pull, self._by_node)
        strains = self._by_step(strains)
        poses = self._poses(strains)
        A, B = self._first.map(self.steps)(poses[:, : self.steps], strains, self._h)
        none = ca.MX.zeros(_POSE, self.n)
        after = _forward(self.n, size).mapaccum(self.steps)(none, A, B, by_tensions)
        return poses, ca.horzcat(none, after), strains, by_tensions, A, B

    def _adjoints(self, by_pose: ca.MX, weights: ca.MX) -> ca.MX:
        """Return lam after each step (7, steps)."""
        own = [ca.MX.zeros(_POSE)] * (self.steps + 1)
        for column, node in enumerate(self._seen):
            own[node] = weights[:, column]
        reverse = range(self.steps - 1, 0, -1)
        if not reverse:
            return own[-1]
        columns = [_POSE * k + i for k in reverse for i in range(_POSE)]
        given = by_pose[:, columns], ca.horzcat(*(own[k] for k in reverse))
        before = _backward().mapaccum(len(reverse))(own[-1], *given)
        return ca.horzcat(own[-1], before)[:, list(range(self.steps))[::-1]]


@lru_cache(maxsize=24)
def _strain_kernels(statics: ClosedStatics) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return (resultants, numbers) -> xi, k, q; with derivatives; and with weights, Hessian."""
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    weights = ca.SX.sym("weights", _STRAINS)
    e = ca.densify(strain_function(statics)(pull, data)[1:])
    first, H = ca.densify(ca.jacobian(e, pull)), ca.hessian(ca.dot(weights, e), pull)[0]
    given, cse = [pull, data], {"cse": True}
    return (
        ca.Function("strain_value", given, [e], cse),
        ca.Function("strain_first", given, [e, first], cse),
        ca.Function("strain_second", [*given, weights], [ca.densify(H)], cse),
    )


@lru_cache(maxsize=8)
def _step_kernels(scheme: Magnus) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return (pose, strains at the nodes, h) -> pose after a step; A, B; and with lam, H."""
    g, h = ca.SX.sym("g", _POSE), ca.SX.sym("h")
    e, lam = ca.SX.sym("e", _STRAINS * len(scheme.nodes)), ca.SX.sym("lam", _POSE)
    twists = [twist(ca.vertcat(0, own)) for own in ca.vertsplit(e, _STRAINS)]
    after = compose(g, scheme.step(twists, h))
    A, B = ca.jacobian(after, g), ca.jacobian(after, e)
    H = ca.hessian(ca.dot(lam, after), ca.vertcat(g, e))[0]
    given, cse = [g, e, h], {"cse": True}
    return (
        ca.Function("step_value", given, [ca.densify(after)], cse),
        ca.Function("step_first", given, [ca.densify(A), ca.densify(B)], cse),
        ca.Function("step_second", [*given, lam], [ca.densify(H)], cse),
    )


@lru_cache(maxsize=16)
def _chained(n: int, m: int, rows: int) -> ca.Function:
    """Return (derivatives by resultants, of these by the tensions, side by side) -> E."""
    D, M = ca.MX.sym("D", _STRAINS, rows * m), ca.MX.sym("M", rows, n * m)
    pairs = zip(ca.horzsplit(D, rows), ca.horzsplit(M, n), strict=True)
    return ca.Function("chained", [D, M], [ca.vertcat(*(d @ own for d, own in pairs))])


@lru_cache(maxsize=16)
def _forward(n: int, size: int) -> ca.Function:
    """Return (P, A, B, E) -> A P + B E."""
    P, A = ca.MX.sym("P", _POSE, n), ca.MX.sym("A", _POSE, _POSE)
    B, E = ca.MX.sym("B", _POSE, size), ca.MX.sym("E", size, n)
    return ca.Function("forward", [P, A, B, E], [A @ P + B @ E])


@lru_cache(maxsize=1)
def _backward() -> ca.Function:
    """Return (lam, A, weights) -> A^T lam + weights."""
    lam, A, own = ca.MX.sym("lam", _POSE), ca.MX.sym("A", _POSE, _POSE), ca.MX.sym("own", _POSE)
    return ca.Function("backward", [lam, A, own], [A.T @ lam + own])


@lru_cache(maxsize=8)
def _works(size: int) -> ca.Function:
    """Return (B, lam) -> B^T lam."""
    B, lam = ca.MX.sym("B", _POSE, size), ca.MX.sym("lam", _POSE)
    return ca.Function("works", [B, lam], [B.T @ lam])


@lru_cache(maxsize=16)
def _folded(n: int, size: int) -> ca.Function:
    """Return (sum, P, E, H) -> sum + (P, E)^T H (P, E)."""
    total, P = ca.MX.sym("total", n, n), ca.MX.sym("P", _POSE, n)
    E, H = ca.MX.sym("E", size, n), ca.MX.sym("H", _POSE + size, _POSE + size)
    both = ca.vertcat(P, E)
    return ca.Function("folded", [total, P, E, H], [total + both.T @ (H @ both)])


@lru_cache(maxsize=16)
def _own(n: int, rows: int) -> ca.Function:
    """Return (sum, M, H) -> sum + M^T H M."""
    total, M, H = ca.MX.sym("total", n, n), ca.MX.sym("M", rows, n), ca.MX.sym("H", rows, rows)
    return ca.Function("own", [total, M, H], [total + M.T @ (H @ M)])
