"""The poses of a closed form and their derivatives by the tensions, step by step.

The strains v of a cross-section balance its wrench, w(v, pull) = 0, and move with what its tendons
pull by the implicit function theorem: v' = -w_v^-1 w_pull, and with e = e(v) and l = w_v^-T e_v^T
weights the Hessian of weights . e is that of weights . e - l . w along (v', 1). CasADi
differentiates w, e, and one step by the pose before it and the strains at its nodes. Along the arm
the chain rule does the rest: with
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

from model.cross_section.law import size
from model.integrators.magnus import Magnus
from model.machine.compiled import kernels
from model.paths import Array
from model.rotations import compose
from model.stations import base_pose
from model.unloaded.closed_form import ClosedForm, twist
from model.unloaded.statics import ClosedStatics, closed_statics

# Numbers of a pose; of the strains at a node: xi, k, q.
POSE, STRAINS = 7, 3


class CondensedSteps:
    """Poses at some nodes of a closed form and 1 + q at some of its places, with derivatives.

    All are functions of the tensions; `slim` are places among the closed form's `stretch_at`.

    Attributes
    ----------
    n, steps : int
        Tensions; steps along the arm, as far as it is seen.
    seen : list of int
        The nodes.
    kernels : tuple of casadi.Function
        Of a cross-section: strains that settle it, those reported of them, their derivatives and
        Hessian; of a step: the pose after it, its derivatives and Hessian.
    numbers, slim_numbers : (maps, data, h, base)
        (K, n_pull, n), (K, n_data), (S,), (7,), of K cross-sections: the nodes of the S steps, and
        the slim places as those of one step.
    """

    def __init__(
        self, forward: ClosedForm, nodes: list[int], slim: list[int], machine_code: bool
    ) -> None:
        arm, scheme = forward.arm, forward.scheme
        self.n, self.steps, self.seen = arm.n_tendons, max([*nodes, 1]), nodes
        self._m = len(scheme.nodes)
        count = self.steps * self._m
        maps = forward.maps[:count]
        self._maps, self._by_node = (
            ca.sparsify(ca.DM(maps.reshape(-1, self.n))),
            np.hstack(list(maps)),
        )
        self._data = ca.DM(forward.data[:count].T)
        h, base = np.diff(forward.mesh.s)[: self.steps], base_pose(arm)
        self.numbers = _whole(maps, forward.data[:count], h, base)
        self.slim_numbers = _whole(forward.maps[slim], forward.data[slim], np.ones(1), base)
        self._h, self._base = ca.DM(h[None]), ca.DM(base)
        self._slim, self._slim_maps = len(slim), [ca.DM(forward.maps[i]) for i in slim]
        self._slim_data = ca.DM(forward.data[slim].T)
        statics = closed_statics(forward.scene, arm)
        functions = (*_strain_kernels(statics), *_step_kernels(scheme))
        self.kernels = tuple(kernels(functions, machine_code))
        self._solve, self._strain, self._strain_first, self._strain_second, *rest = self.kernels
        self._march, self._first, self._second = rest

    def poses(self, T: ca.MX) -> ca.MX:
        """Return the poses (7, K) at the nodes under tensions (n_tendons,)."""
        v, _, _ = self._settled(T)
        return self._poses(self._by_step(self._each(self._strain)(v)))[:, self.seen]

    def first(self, T: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return the poses (7, K), and their derivatives by the tensions (7 K, n_tendons)."""
        poses, jacobian = self._jacobian(self._settled(T))[:2]
        by_node = ca.horzsplit(jacobian, self.n)
        return poses[:, self.seen], ca.vertcat(*(by_node[node] for node in self.seen))

    def stretch(self, T: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return 1 + q (r,) at the places of `slim`, and its derivatives (r, n_tendons)."""
        if not self._slim:
            return ca.MX(0, 1), ca.MX(0, self.n)
        strains, jacobian = self._strain_first.map(self._slim)(*self._slim_settled(T))
        own = zip(ca.horzsplit(jacobian, self._by_node.shape[0]), self._slim_maps, strict=True)
        return 1 + strains[2, :].T, ca.vertcat(*(by_pull[2, :] @ maps for by_pull, maps in own))

    def stretch_second(self, T: ca.MX, weights: ca.MX) -> ca.MX:
        """Return the Hessian (n_tendons, n_tendons) of a weighted sum (r,) of what stretch is."""
        if not self._slim:
            return ca.MX(self.n, self.n)
        along = ca.vertcat(ca.MX.zeros(2, self._slim), weights.T)
        found = self._strain_second.map(self._slim)(*self._slim_settled(T), along)
        own = zip(ca.horzsplit(found, self._by_node.shape[0]), self._slim_maps, strict=True)
        return sum((maps.T @ (H @ maps) for H, maps in own), ca.MX.zeros(self.n, self.n))

    def _slim_settled(self, T: ca.MX) -> tuple[ca.MX, ca.MX, ca.DM]:
        """See _settled, of the places of `slim`."""
        pull = ca.horzcat(*(ca.sparsify(maps) @ T for maps in self._slim_maps))
        return self._solve.map(self._slim)(pull, self._slim_data), pull, self._slim_data

    def second(self, T: ca.MX, weights: ca.MX) -> ca.MX:
        """Return the Hessian (n_tendons, n_tendons) of a weighted sum (7, K) of the poses."""
        settled = self._settled(T)
        poses, jacobian, strains, by_tensions, by_pose, by_strains = self._jacobian(settled)
        lam = self._adjoints(by_pose, weights)
        H = self._second.map(self.steps)(poses[:, : self.steps], strains, self._h, lam)
        start, before = ca.MX.zeros(self.n, self.n), jacobian[:, : self.steps * self.n]
        folded = _folded(self.n, self._m * STRAINS).fold(self.steps)(start, before, by_tensions, H)
        works = _works(self._m * STRAINS).map(self.steps)(by_strains, lam)
        own = self._each(self._strain_second)(*settled, ca.reshape(works, STRAINS, -1))
        rows = self._by_node.shape[0]
        return _own(self.n, rows).fold(self.steps * self._m)(folded, self._by_node, own)

    def _settled(self, T: ca.MX) -> tuple[ca.MX, ca.MX, ca.DM]:
        """Return the law's strains at all nodes of all steps, the resultants and numbers there."""
        pull = ca.reshape(self._maps @ T, -1, self.steps * self._m)
        return self._each(self._solve)(pull, self._data), pull, self._data

    def _each(self, function: ca.Function) -> ca.Function:
        return function.map(self.steps * self._m)

    def _by_step(self, strains: ca.MX) -> ca.MX:
        return ca.reshape(strains, -1, self.steps)

    def _poses(self, strains: ca.MX) -> ca.MX:
        """Return the poses at all nodes (7, steps + 1)."""
        after = self._march.mapaccum(self.steps)(self._base, strains, self._h)
        return ca.horzcat(self._base, after)

    def _jacobian(self, settled: tuple[ca.MX, ca.MX, ca.DM]) -> tuple[ca.MX, ...]:
        """Return the poses, P at all nodes, strains, E, A and B of all steps."""
        size = self._m * STRAINS
        strains, by_pull = self._each(self._strain_first)(*settled)
        chained = _chained(self.n, self._m, self._by_node.shape[0])
        by_tensions = chained.map(self.steps)(by_pull, self._by_node)
        strains = self._by_step(strains)
        poses = self._poses(strains)
        A, B = self._first.map(self.steps)(poses[:, : self.steps], strains, self._h)
        none = ca.MX.zeros(POSE, self.n)
        after = _forward(self.n, size).mapaccum(self.steps)(none, A, B, by_tensions)
        return poses, ca.horzcat(none, after), strains, by_tensions, A, B

    def _adjoints(self, by_pose: ca.MX, weights: ca.MX) -> ca.MX:
        """Return lam after each step (7, steps)."""
        own = [ca.MX.zeros(POSE)] * (self.steps + 1)
        for column, node in enumerate(self.seen):
            own[node] = weights[:, column]
        reverse = range(self.steps - 1, 0, -1)
        if not reverse:
            return own[-1]
        columns = [POSE * k + i for k in reverse for i in range(POSE)]
        given = by_pose[:, columns], ca.horzcat(*(own[k] for k in reverse))
        before = _backward().mapaccum(len(reverse))(own[-1], *given)
        return ca.horzcat(own[-1], before)[:, list(range(self.steps))[::-1]]


def _whole(*parts: Array) -> tuple[Array, ...]:
    """Return arrays whose numbers stand one after the other."""
    return tuple(np.ascontiguousarray(part) for part in parts)


@lru_cache(maxsize=24)
def _strain_kernels(statics: ClosedStatics) -> tuple[ca.Function, ...]:
    """Return (pull, data) -> v; v -> xi, k, q; with pull, data -> both derivatives by pull.

    That is the first ones with the strains; and, with weights (3,) besides, the Hessian.
    """
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    v, weights = ca.SX.sym("v", size(statics.law)), ca.SX.sym("weights", STRAINS)
    e, wrench = ca.densify(statics.law.reported(v)[1:]), statics.wrench(v, pull, data)
    inverse = ca.inv_minor(ca.densify(ca.jacobian(wrench, v)))
    by_pull = -inverse @ ca.jacobian(wrench, pull)
    work, held = inverse.T @ (ca.jacobian(e, v).T @ weights), ca.SX.sym("work", v.numel())
    L = ca.dot(weights, e) - ca.dot(held, wrench)
    bent = ca.substitute(ca.hessian(L, ca.vertcat(v, pull))[0], held, work)
    along, at = ca.vertcat(by_pull, ca.SX.eye(pull.numel())), [v, pull, data]
    jacobian, curvature = ca.jacobian(e, v) @ by_pull, along.T @ (bent @ along)
    settled, cse = statics.solve(pull, data), {"cse": True}
    return (
        ca.Function("strain_solve", [pull, data], [ca.densify(settled)], cse),
        ca.Function("strain_value", [v], [e], cse),
        ca.Function("strain_first", at, [e, ca.densify(jacobian)], cse),
        ca.Function("strain_second", [*at, weights], [ca.densify(curvature)], cse),
    )


@lru_cache(maxsize=8)
def _step_kernels(scheme: Magnus) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return (pose, strains at the nodes, h) -> pose after a step; A, B; and with lam, H."""
    g, h = ca.SX.sym("g", POSE), ca.SX.sym("h")
    e, lam = ca.SX.sym("e", STRAINS * len(scheme.nodes)), ca.SX.sym("lam", POSE)
    twists = [twist(ca.vertcat(0, own)) for own in ca.vertsplit(e, STRAINS)]
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
    D, M = ca.MX.sym("D", STRAINS, rows * m), ca.MX.sym("M", rows, n * m)
    pairs = zip(ca.horzsplit(D, rows), ca.horzsplit(M, n), strict=True)
    return ca.Function("chained", [D, M], [ca.vertcat(*(d @ own for d, own in pairs))])


@lru_cache(maxsize=16)
def _forward(n: int, size: int) -> ca.Function:
    """Return (P, A, B, E) -> A P + B E."""
    P, A = ca.MX.sym("P", POSE, n), ca.MX.sym("A", POSE, POSE)
    B, E = ca.MX.sym("B", POSE, size), ca.MX.sym("E", size, n)
    return ca.Function("forward", [P, A, B, E], [A @ P + B @ E])


@lru_cache(maxsize=1)
def _backward() -> ca.Function:
    """Return (lam, A, weights) -> A^T lam + weights."""
    lam, A, own = ca.MX.sym("lam", POSE), ca.MX.sym("A", POSE, POSE), ca.MX.sym("own", POSE)
    return ca.Function("backward", [lam, A, own], [A.T @ lam + own])


@lru_cache(maxsize=8)
def _works(size: int) -> ca.Function:
    """Return (B, lam) -> B^T lam."""
    B, lam = ca.MX.sym("B", POSE, size), ca.MX.sym("lam", POSE)
    return ca.Function("works", [B, lam], [B.T @ lam])


@lru_cache(maxsize=16)
def _folded(n: int, size: int) -> ca.Function:
    """Return (sum, P, E, H) -> sum + (P, E)^T H (P, E)."""
    total, P = ca.MX.sym("total", n, n), ca.MX.sym("P", POSE, n)
    E, H = ca.MX.sym("E", size, n), ca.MX.sym("H", POSE + size, POSE + size)
    both = ca.vertcat(P, E)
    return ca.Function("folded", [total, P, E, H], [total + both.T @ (H @ both)])


@lru_cache(maxsize=16)
def _own(n: int, rows: int) -> ca.Function:
    """Return (sum, M, H) -> sum + M^T H M."""
    total, M, H = ca.MX.sym("total", n, n), ca.MX.sym("M", rows, n), ca.MX.sym("H", rows, rows)
    return ca.Function("own", [total, M, H], [total + M.T @ (H @ M)])
