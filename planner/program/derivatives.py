"""Exact derivatives of a program: through the chain of poses where there is one, else by CasADi.

The program's functions depend on the tensions directly, through the poses at the stations, and
through the least stretches. A change of poses is written as spatial twists; with w the twists and
the changes of stretch, and Z their slopes against the unknowns,

    Jacobian = g_x + g_w Z        Hessian = L_xx + L_xw Z + (L_xw Z)^T + Z^T L_ww Z + L_w . Z'

where Z and Z' come from the model's derivatives and everything else is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.unloaded.pose_derivatives import PoseDerivatives, moved_pose
from model.unloaded.strain_derivatives import StretchDerivatives


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
        gradient_function(x, p, f, ca.gradient(f, x)),
        ca.Function("slopes", [x, p], [ca.gradient(f, x), g, ca.jacobian(g, x)]),
        ca.Function("curvature", [x, p, sigma, lam], [hessian]),
    )


def through_poses(
    x: ca.MX,
    p: ca.MX,
    unit: ca.MX,
    outer: ca.Function,
    chain: PoseDerivatives,
    least: StretchDerivatives | None,
) -> Derivatives:
    """Return the derivatives of a program, `outer`: x, p, poses (7, K), stretches (r,) -> f, g.

    `unit` (n,), an expression of p, scales the first n unknowns to tensions [N].
    """
    K, r = outer.size2_in(2), outer.size1_in(3)
    here, thin = ca.MX.sym("here", 7, K), ca.MX.sym("thin", r)
    w = ca.MX.sym("w", 6 * K + r)
    moved = [moved_pose()(here[:, k], w[6 * k : 6 * k + 6]) for k in range(K)]
    f, g = outer(x, p, ca.horzcat(*moved), thin + w[6 * K :])
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    order1 = [ca.jacobian(v, part) for v in (f, g) for part in (x, w)]
    first = ca.Function("first", [x, p, here, thin, w], [g, *order1])
    blocks = hessian_blocks(sigma * f + ca.dot(lam, g), x, w)
    second = ca.Function("second", [x, p, here, thin, w, sigma, lam], blocks)

    n, still = unit.numel(), ca.DM.zeros(6 * K + r)
    T = x[:n] * unit
    poses, twists = chain.first(T)
    stretch, slopes = least.first(T) if least else (ca.MX(0, 1), ca.MX(0, n))
    Z = ca.horzcat(ca.vertcat(twists, slopes) @ ca.diag(unit), ca.MX(6 * K + r, x.numel() - n))
    at = (x, p, poses, stretch, still)
    value, f_x, f_w, g_x, g_w = first(*at)
    outputs = [(f_x + f_w @ Z).T, value, g_x + g_w @ Z]
    L_xx, L_xw, L_ww, L_w = second(*at, sigma, lam)
    bent = chain.second(T, ca.reshape(L_w[: 6 * K], 6, K))
    bent = bent + least.second(T, L_w[6 * K :]) if least else bent
    own = ca.diagcat(ca.diag(unit) @ bent @ ca.diag(unit), ca.MX(x.numel() - n, x.numel() - n))
    mixed = L_xw @ Z
    hessian = L_xx + mixed + mixed.T + Z.T @ (L_ww @ Z) + own
    return Derivatives(
        gradient_function(x, p, *objective(x, p, (poses, stretch), outer, outputs[0])),
        ca.Function("slopes", [x, p], outputs),
        ca.Function("curvature", [x, p, sigma, lam], [ca.densify(hessian)]),
    )


def objective(
    x: ca.MX, p: ca.MX, at: tuple[ca.MX, ...], outer: ca.Function, slope: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """Return f and its gradient, without the chain where f does not look at what it gives."""
    if outer.jac_sparsity(0, 2).nnz() > 0:
        return outer(x, p, *at)[0], slope
    f = outer(x, p, *(ca.DM.ones(value.shape) for value in at))[0]
    return f, ca.gradient(f, x)


def gradient_function(x: ca.MX, p: ca.MX, f: ca.MX, gradient: ca.MX) -> ca.Function:
    """Return x, p -> f, its gradient, by the names that nlpsol knows."""
    return ca.Function(
        "nlp_grad_f", [x, p], [f, ca.densify(gradient)], ["x", "p"], ["f", "grad:f:x"]
    )


def hessian_blocks(L: ca.MX, x: ca.MX, zeta: ca.MX) -> list[ca.MX]:
    """Return L_xx, L_xz, L_zz and the gradient in zeta."""
    L_xx, L_x = ca.hessian(L, x)
    L_zz, L_z = ca.hessian(L, zeta)
    return [L_xx, ca.jacobian(L_x, zeta), L_zz, L_z]
