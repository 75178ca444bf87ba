"""Exact derivatives of a program through quantities inside it that have derivatives of their own.

They are put together by the chain rule as in planner.program.derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise

import casadi as ca

from planner.program.derivatives import Derivatives, gradient_function, hessian_blocks, objective


@dataclass(frozen=True, eq=False)
class Inner:
    """Quantities (r,) that a program looks at, functions of its unknowns x (n,) and parameters p.

    Attributes
    ----------
    values : casadi.Function
        x, p -> the quantities.
    first : casadi.Function
        x, p -> the quantities, their slopes (r, n).
    second : casadi.Function
        x, p, weights (r,) -> Hessian (n, n) of their sum with weights.
    """

    values: ca.Function
    first: ca.Function
    second: ca.Function

    @classmethod
    def of_tensions(
        cls,
        x: ca.MX,
        p: ca.MX,
        unit: ca.MX,
        states: int,
        functions: tuple[ca.Function, ca.Function, ca.Function],
        *more: ca.MX,
    ) -> Inner:
        """Return quantities that are functions of tensions, scaled starts and more of p.

        `unit` (n_tendons,), an expression of p, scales the first unknowns to tensions [N]; from
        `states` on they are the starts. `functions` give the values; these and their slopes
        against tensions and starts; and the Hessian for one more argument, weights.
        """
        values, first, second = functions
        n, rest = unit.numel(), x.numel() - states
        at = (x[:n] * unit, x[states:], *more)
        place = ca.MX(n + rest, x.numel())
        place[:n, :n] = ca.diag(unit)
        place[n:, states:] = ca.DM.eye(rest)
        shape = first.size_out(0)
        weights = ca.MX.sym("weights", shape[0] * shape[1])
        found, slopes = first(*at)
        bent = place.T @ (second(*at, ca.reshape(weights, *shape)) @ place)
        return cls(
            ca.Function("values", [x, p], [ca.vec(values(*at))]),
            ca.Function("slopes", [x, p], [ca.vec(found), ca.densify(slopes @ place)]),
            ca.Function("bent", [x, p, weights], [ca.densify(bent)]),
        )


def through(x: ca.MX, p: ca.MX, outer: ca.Function, inner: list[Inner]) -> Derivatives:
    """Return the derivatives of a program, `outer`: x, p, all quantities stacked -> f, g."""
    w = ca.MX.sym("w", outer.numel_in(2))
    f, g = outer(x, p, w)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    order1 = [ca.jacobian(v, part) for v in (f, g) for part in (x, w)]
    first = ca.Function("first", [x, p, w], [g, *order1])
    blocks = hessian_blocks(sigma * f + ca.dot(lam, g), x, w)
    second = ca.Function("second", [x, p, w, sigma, lam], blocks)

    parts = [part.first(x, p) for part in inner]
    found, Z = (ca.vertcat(*(part[k] for part in parts)) for k in (0, 1))
    value, f_x, f_w, g_x, g_w = first(x, p, found)
    L_xx, L_xw, L_ww, L_w = second(x, p, found, sigma, lam)
    mixed = L_xw @ Z
    hessian = L_xx + mixed + mixed.T + Z.T @ (L_ww @ Z)
    ends = [0, *accumulate(part.values.numel_out(0) for part in inner)]
    for part, (low, high) in zip(inner, pairwise(ends), strict=True):
        hessian += part.second(x, p, L_w[low:high])
    slope = ca.densify((f_x + f_w @ Z).T)
    return Derivatives(
        gradient_function(x, p, *objective(x, p, (found,), outer, slope)),
        ca.Function("slopes", [x, p], [slope, value, ca.densify(g_x + g_w @ Z)]),
        ca.Function("curvature", [x, p, sigma, lam], [ca.densify(hessian)]),
    )
