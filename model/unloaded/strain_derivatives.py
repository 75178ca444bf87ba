"""First and second derivatives of strains with respect to tensions, section by section.

Sections settle where a residual R(v, u) of unknowns v and pull u vanishes, so that derivatives
follow from the implicit function theorem; how v was found does not matter.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.arm import Arm
from model.paths import Array
from model.scene import Scene
from model.statics import ClosedStatics
from model.stations import Counts
from model.unloaded.closed_form import closed_statics, full_strain, sections, strain_function


class StretchDerivatives:
    """1 + q at stations s (N,), with derivatives.

    Attributes
    ----------
    first : casadi.Function
        tensions (n,) -> 1 + q (N,), Jacobian (N, n).
    second : casadi.Function
        tensions (n,), weights (N,) -> Hessian (n, n) of their product with 1 + q.
    """

    def __init__(self, arm: Arm, scene: Scene, s: Array, active: Counts) -> None:
        statics, N = closed_statics(scene, arm), s.size
        at, u = sections(arm, statics, s, active), statics.n_pull
        T, weights = ca.MX.sym("T", arm.n_tendons), ca.MX.sym("weights", N)
        pull = at.pull(T)
        strains = strain_function(statics).map(N)(pull, at.data)[1:, :]
        slopes = strain_slopes(statics).map(N)(strains, pull, at.data)
        rows = block_diagonal(slopes, 3, u) @ at.map
        jacobian = rows[2::3, :]
        self.first = ca.Function("stretch", [T], [1 + strains[2, :].T, jacobian])
        mu = ca.vertcat(ca.MX.zeros(2, N), weights.T)
        K = strain_curvature(statics).map(N)(strains, pull, at.data, mu)
        hessian = at.map.T @ (block_diagonal(K, u, u) @ at.map)
        self.second = ca.Function("stretch_curvature", [T, weights], [ca.densify(hessian)])


def block_diagonal(dense: ca.MX, rows: int, columns: int) -> ca.MX:
    """Return the block diagonal matrix of blocks that stand side by side (rows, columns N)."""
    count = dense.numel() // (rows * columns)
    pattern = ca.diagcat(*[ca.Sparsity.dense(rows, columns)] * count)
    return ca.MX(pattern, ca.vec(dense))


@lru_cache(maxsize=64)
def strain_slopes(statics: ClosedStatics) -> ca.Function:
    """Return (strains xi, k, q, pull, data) -> slopes (3, n_pull) of the strains against pull."""
    e, v, pull, data = _section_symbols(statics)
    residual = statics.residual(v, pull, data)
    strain = full_strain(statics, statics.strain(v), pull, data)[1:]
    turn = -_solve(ca.jacobian(residual, v), ca.jacobian(residual, pull))
    slope = ca.jacobian(strain, v) @ turn + ca.jacobian(strain, pull)
    found = ca.substitute([ca.densify(slope)], [v], [statics.unknowns(_states(statics, e))])
    return ca.Function("slopes", [e, pull, data], found, {"cse": True})


@lru_cache(maxsize=64)
def strain_curvature(statics: ClosedStatics) -> ca.Function:
    """Return (strains, pull, data, weights (3,)) -> second derivative of the strains in pull.

    With v(u) from R(v, u) = 0 and the strains S(v, u), the second derivative of mu . S is that of
    L = mu . S - lam . R along (v', 1), where lam = R_v^-T S_v^T mu.
    """
    e, v, pull, data = _section_symbols(statics)
    mu, lam = ca.SX.sym("mu", 3), ca.SX.sym("lam", v.numel())
    residual = statics.residual(v, pull, data)
    strain = full_strain(statics, statics.strain(v), pull, data)[1:]
    R_v = ca.jacobian(residual, v)
    turn = -_solve(R_v, ca.jacobian(residual, pull))
    weight = _solve(R_v.T, ca.jtimes(strain, v, mu, True))
    L = ca.dot(mu, strain) - ca.dot(lam, residual)
    L_vv, L_v = ca.hessian(L, v)
    L_vu, L_uu = ca.jacobian(L_v, pull), ca.hessian(L, pull)[0]
    mixed = turn.T @ L_vu
    hessian = turn.T @ L_vv @ turn + mixed + mixed.T + L_uu
    hessian = ca.substitute(ca.densify(hessian), lam, weight)
    found = ca.substitute([hessian], [v], [statics.unknowns(_states(statics, e))])
    return ca.Function("curvature", [e, pull, data, mu], found, {"cse": True})


def _section_symbols(statics: ClosedStatics) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return symbols: strains xi, k, q, unknowns v, pull, data."""
    e, v = ca.SX.sym("e", 3), ca.SX.sym("v", len(statics.names))
    return e, v, ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)


def _states(statics: ClosedStatics, e: ca.SX) -> ca.SX:
    """Return those of xi, k, q that the statics carry as states."""
    kept = [e[i] for i, name in enumerate(("xi", "k", "q")) if name in statics.names]
    return ca.vertcat(*kept)


def _solve(A: ca.SX, B: ca.SX) -> ca.SX:
    """Return A^-1 B for a small matrix A, by minors."""
    return ca.inv_minor(A) @ B
