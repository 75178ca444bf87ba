"""Exact derivatives of a program: through the chain of poses where there is one, else by CasADi.

The program's functions depend on the tensions directly and through the poses at the stations. A
change of poses is written as spatial twists zeta, so that with Z the twists per unknown

    Jacobian = g_x + g_zeta Z      Hessian = V^T L_ww V + L_zeta . Z'      V = [1; Z], w = (x, zeta)

where Z and Z' come from model.pose_derivatives and everything else is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.pose_derivatives import PoseDerivatives, moved_pose


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Functions of a program.

    Attributes
    ----------
    gradient : casadi.Function
        x, p -> f, its gradient.
    slopes : casadi.Function
        x, p -> gradient of f, g, Jacobian of g.
    curvature : casadi.Function
        x, p, weight of f, multipliers of g -> Hessian of their sum.
    """

    gradient: ca.Function
    slopes: ca.Function
    curvature: ca.Function


def plain(x: ca.MX, p: ca.MX, f: ca.MX, g: ca.MX) -> Derivatives:
    """Return the derivatives as CasADi finds them."""
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    hessian = ca.hessian(sigma * f + ca.dot(lam, g), x)[0]
    return Derivatives(
        _gradient(x, p, f, ca.gradient(f, x)),
        ca.Function("slopes", [x, p], [ca.gradient(f, x), g, ca.jacobian(g, x)]),
        ca.Function("curvature", [x, p, sigma, lam], [hessian]),
    )


def through_poses(
    x: ca.MX, p: ca.MX, unit: ca.MX, outer: ca.Function, chain: PoseDerivatives
) -> Derivatives:
    """Return the derivatives of a program, `outer`: x, p, poses (7, K) -> f, g.

    `unit` (n,), an expression of p, scales the first n unknowns to tensions [N].
    """
    K = outer.size2_in(2)
    here, zeta = ca.MX.sym("here", 7, K), ca.MX.sym("zeta", 6 * K)
    moved = [moved_pose()(here[:, k], zeta[6 * k : 6 * k + 6]) for k in range(K)]
    f, g = outer(x, p, ca.horzcat(*moved))
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    order1 = [ca.jacobian(v, part) for v in (f, g) for part in (x, zeta)]
    first = ca.Function("first", [x, p, here, zeta], [g, *order1])
    blocks = _hessian_blocks(sigma * f + ca.dot(lam, g), x, zeta)
    second = ca.Function("second", [x, p, here, zeta, sigma, lam], blocks)

    n, still = unit.numel(), ca.DM.zeros(6 * K)
    T = x[:n] * unit
    at, twists = chain.first(T)
    scaled = twists @ ca.diag(unit)
    Z = ca.horzcat(scaled, ca.MX(6 * K, x.numel() - n))
    value, f_x, f_zeta, g_x, g_zeta = first(x, p, at, still)
    slopes = [(f_x + f_zeta @ Z).T, value, g_x + g_zeta @ Z]
    L_xx, L_xz, L_zz, L_z = second(x, p, at, still, sigma, lam)
    bent = ca.diag(unit) @ chain.second(T, ca.reshape(L_z, 6, K)) @ ca.diag(unit)
    own = ca.diagcat(bent, ca.MX(x.numel() - n, x.numel() - n))
    mixed = L_xz @ Z
    hessian = L_xx + mixed + mixed.T + Z.T @ (L_zz @ Z) + own
    return Derivatives(
        _gradient(x, p, *_objective(x, p, at, outer, slopes[0])),
        ca.Function("slopes", [x, p], slopes),
        ca.Function("curvature", [x, p, sigma, lam], [ca.densify(hessian)]),
    )


def _objective(
    x: ca.MX, p: ca.MX, at: ca.MX, outer: ca.Function, slope: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """Return f and its gradient, without the chain where f does not look at the poses."""
    if outer.jac_sparsity(0, 2).nnz() > 0:
        return outer(x, p, at)[0], slope
    f = outer(x, p, ca.DM.ones(outer.size_in(2)))[0]
    return f, ca.gradient(f, x)


def _gradient(x: ca.MX, p: ca.MX, f: ca.MX, gradient: ca.MX) -> ca.Function:
    return ca.Function("nlp_grad_f", [x, p], [f, gradient], ["x", "p"], ["f", "grad:f:x"])


def _hessian_blocks(L: ca.MX, x: ca.MX, zeta: ca.MX) -> list[ca.MX]:
    """Return L_xx, L_xz, L_zz and the gradient in zeta."""
    L_xx, L_x = ca.hessian(L, x)
    L_zz, L_z = ca.hessian(L, zeta)
    return [L_xx, ca.jacobian(L_x, zeta), L_zz, L_z]
