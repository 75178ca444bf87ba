"""First and second derivatives of poses with respect to tensions, by the structure of the chain.

A pose is a product of steps, g = g_0 r_1 ... r_S. A change of tensions turns each step into
exp(x_i) r_i, where x_i is a spatial twist; to second order the product is exp(z) g with

    z = sum x_i + 1/2 sum over i < j of [x_i, x_j] + what the x_i have of second order themselves.

So the Jacobian of a pose is a sum of 6 x n blocks, and its Hessian against a covector a product of
two matrices with six rows a step, instead of a sweep along the arm for each tendon. Only what is
small and local to a step is differentiated symbol by symbol.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.integrators.magnus import Magnus
from model.mesh import Mesh
from model.rotations import compose, exponential, matrix, rotate
from model.scene import Scene
from model.unloaded.closed_form import (
    base_pose,
    closed_statics,
    nodes_of,
    sections,
    strain_function,
    twist,
)
from model.unloaded.step_twist import chain_function, step_curvature, step_slopes
from model.unloaded.strain_derivatives import block_diagonal, strain_curvature, strain_slopes


class PoseDerivatives:
    """Derivatives of the poses at stations of a closed-form scene, on one mesh.

    Attributes
    ----------
    first : casadi.Function
        tensions (n,) -> poses (7, K) at the stations, twists (6 K, n): the spatial twist of each
        pose per newton, (turn, shift of the point at the base frame's origin).
    second : casadi.Function
        tensions (n,), covectors (6, K) -> (n, n): the sum over stations of covector times the
        second derivative of z above.
    """

    def __init__(
        self, arm: Arm, scene: Scene, mesh: Mesh, scheme: Magnus, at: tuple[float, ...]
    ) -> None:
        n, m, S = arm.n_tendons, len(scheme.nodes), mesh.steps
        s = nodes_of(scheme, mesh.s[:-1], mesh.s[1:])
        active = np.repeat(mesh.active, m)
        statics = closed_statics(scene, arm)
        u, at_nodes = statics.n_pull, sections(arm, statics, s, active)
        W, data, h = at_nodes.map, at_nodes.data, ca.DM(np.diff(mesh.s)).T
        columns = [mesh.node(place) for place in at]
        T, G = ca.MX.sym("T", n), ca.MX.sym("G", 6, len(at))

        pull = at_nodes.pull(T)
        strains = strain_function(statics).map(s.size)(pull, data)[1:, :]
        slopes = strain_slopes(statics).map(s.size)(strains, pull, data)
        steps, local = _step_slopes(scheme).map(S)(_by_step(strains, S), h)
        g = ca.horzcat(
            ca.DM(base_pose(arm)), chain_function().mapaccum(S)(ca.DM(base_pose(arm)), steps)
        )
        D = block_diagonal(slopes, 3, u) @ W
        seen = block_diagonal(adjoint_function().map(S)(g[:, :S]), 6, 6)
        X = seen @ (block_diagonal(local, 6, 3 * m) @ D)
        Y = _sums(X, S)
        twists = ca.vertcat(*(Y[c] for c in columns))
        self.first = ca.Function("first", [T], [g[:, columns], twists])

        beyond = G @ ca.DM([[float(i < column) for i in range(S)] for column in columns])
        turned = block_diagonal(_bracket_form().map(S)(beyond), 6, 6) @ X
        crossed = ca.vertcat(*Y[:S]).T @ turned
        covectors = _pulled_back().map(S)(g[:, :S], beyond)
        Q, in_strains = _step_curvature(scheme).map(S)(_by_step(strains, S), h, covectors)
        weights = ca.reshape(in_strains, 3, s.size)
        K = strain_curvature(statics).map(s.size)(strains, pull, data, weights)
        own = D.T @ (block_diagonal(Q, 3 * m, 3 * m) @ D) + W.T @ (block_diagonal(K, u, u) @ W)
        self.second = ca.Function("second", [T, G], [(crossed + crossed.T) / 2 + own])


def _by_step(strains: ca.MX, S: int) -> ca.MX:
    return ca.reshape(strains, -1, S)


def _sums(X: ca.MX, S: int) -> list[ca.MX]:
    """Return the sums of the first 0, 1, ... S blocks (6, n) of X (6 S, n)."""
    total = [ca.MX.zeros(6, X.shape[1])]
    for block in ca.vertsplit(X, 6):
        total.append(total[-1] + block)
    return total


@lru_cache(maxsize=64)
def _step_slopes(scheme: Magnus) -> ca.Function:
    """Return (strains (3 m,), h) -> pose (7,), slopes (6, 3 m) of its twist against strains."""
    e, twists, h = _step_symbols(scheme)
    return ca.Function("step", [e, h], step_slopes(scheme, twists, h, e), {"cse": True})


@lru_cache(maxsize=64)
def _step_curvature(scheme: Magnus) -> ca.Function:
    """Return (strains (3 m,), h, covector (6,)) -> second derivative of z, its slope (3 m,)."""
    e, twists, h = _step_symbols(scheme)
    G = ca.SX.sym("G", 6)
    found = step_curvature(scheme, twists, h, e, G)
    return ca.Function("step_curvature", [e, h, G], found, {"cse": True})


def _step_symbols(scheme: Magnus) -> tuple[ca.SX, list[ca.SX], ca.SX]:
    """Return strains xi, k, q (3 m,) at a step's nodes, the twists they are, h."""
    m = len(scheme.nodes)
    e = ca.SX.sym("e", 3 * m)
    return e, [twist(ca.vertcat(0, e[3 * i : 3 * i + 3])) for i in range(m)], ca.SX.sym("h")


@lru_cache(maxsize=8)
def adjoint_function() -> ca.Function:
    """Return pose -> (6, 6), the map of local twists to spatial ones."""
    g = ca.SX.sym("g", 7)
    R = matrix(g[:4])
    return ca.Function(
        "adjoint", [g], [ca.densify(ca.blockcat([[R, ca.SX(3, 3)], [ca.skew(g[4:]) @ R, R]]))]
    )


@lru_cache(maxsize=8)
def _bracket_form() -> ca.Function:
    """Return covector G -> the form (6, 6) with y . form . x = G . [y, x]."""
    G = ca.SX.sym("G", 6)
    turn, shift = -ca.skew(G[:3]), -ca.skew(G[3:])
    form = ca.blockcat([[turn, shift], [shift, ca.SX(3, 3)]])
    return ca.Function("bracket", [G], [ca.densify(form)])


@lru_cache(maxsize=8)
def _pulled_back() -> ca.Function:
    """Return (g, G) -> the covector G (6,) seen from the frame g."""
    g, G = ca.SX.sym("g", 7), ca.SX.sym("G", 6)
    back = ca.vertcat(g[0], -g[1:4])
    moment = G[:3] + ca.cross(G[3:], g[4:])
    return ca.Function("back", [g, G], [ca.vertcat(rotate(back, moment), rotate(back, G[3:]))])


@lru_cache(maxsize=8)
def moved_pose() -> ca.Function:
    """Return (pose, z (6,)) -> exp(z) pose: what a spatial twist does to a pose."""
    g, z = ca.SX.sym("g", 7), ca.SX.sym("z", 6)
    return ca.Function("moved", [g, z], [compose(exponential(z[:3], z[3:]), g)], {"cse": True})
