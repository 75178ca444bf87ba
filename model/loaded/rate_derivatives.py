"""Derivatives of the rates of a loaded state, by the implicit function theorem where friction is.

With friction the strains' rates w are a fixed point w = h(x, w), and the rates are f(x, w). Then
dw = (1 - h_w)^-1 h_x dx, and the second derivative of mu . f is that of mu . f + lam . (h - w)
along (dx, dw), with lam = (1 - h_w)^-T f_w^T mu: how w was found does not matter.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.loaded.equations import LoadEquations


def varied(e: LoadEquations, args: list[ca.SX]) -> ca.SX:
    """Return those numbers of a cross-section that vary with the tensions."""
    if e.n_tension:
        return ca.SX(0, 1)
    return ca.vertcat(args[0], args[2]) if e.statics.pull_varies else args[0]


@lru_cache(maxsize=64)
def state_slopes(e: LoadEquations) -> ca.Function:
    """Return (x, cross-section) -> rate f, its Jacobian in x."""
    x, args = ca.SX.sym("x", e.n_x), e.symbols()
    return _function("state_slopes", x, args, _slopes(e, x, args, [x]))


@lru_cache(maxsize=64)
def driven_slopes(e: LoadEquations) -> ca.Function:
    """Return (x, cross-section) -> rate f, its Jacobians in x, and in the pull and the force."""
    x, args = ca.SX.sym("x", e.n_x), e.symbols()
    driven = ca.vertcat(varied(e, args), args[4][:3])
    return _function("driven_slopes", x, args, _slopes(e, x, args, [x, driven]))


@lru_cache(maxsize=64)
def rate_slopes(e: LoadEquations) -> ca.Function:
    """Return (x, cross-section) -> rate f, its Jacobians in x and in the pull."""
    x, args = ca.SX.sym("x", e.n_x), e.symbols()
    return _function("rate_slopes", x, args, _slopes(e, x, args, [x, varied(e, args)]))


@lru_cache(maxsize=64)
def rate_curvature(e: LoadEquations) -> ca.Function:
    """Return (x, cross-section, covector mu) -> Hessian of mu . f in x and the pull."""
    x, args, mu = ca.SX.sym("x", e.n_x), e.symbols(), ca.SX.sym("mu", e.n_x)
    v = ca.vertcat(x, varied(e, args))
    if not e.n_tension:
        hessian = ca.hessian(ca.dot(mu, e.rate(x, *args)), v)[0]
        return ca.Function("curvature", [x, *args, mu], [ca.densify(hessian)], {"cse": True})
    w, lam = ca.SX.sym("w", e.statics.size), ca.SX.sym("lam", e.statics.size)
    f = e.swept(x, args, w)
    h = f[e.strains]
    left = ca.SX.eye(w.numel()) - ca.jacobian(h, w)
    z = ca.vertcat(v, w)
    curved = ca.hessian(ca.dot(mu, f) + ca.dot(lam, h), z)[0]
    along = ca.vertcat(ca.SX.eye(v.numel()), ca.solve(left, ca.jacobian(h, v)))
    hessian = ca.densify(along.T @ curved @ along)
    weight = ca.solve(left.T, ca.jtimes(f, w, mu, True))
    found = ca.substitute(hessian, lam, weight)
    rates = e.rate(x, *args)[e.strains]
    return ca.Function("curvature", [x, *args, mu], [ca.substitute(found, w, rates)], {"cse": True})


def _slopes(e: LoadEquations, x: ca.SX, args: list[ca.SX], wrt: list[ca.SX]) -> list[ca.SX]:
    """Return the rate f and its Jacobians."""
    f = e.rate(x, *args)
    if not e.n_tension:
        return [f, *(ca.densify(ca.jacobian(f, v)) for v in wrt)]
    w = ca.SX.sym("w", e.statics.size)
    swept = e.swept(x, args, w)
    h = swept[e.strains]
    left, f_w = ca.SX.eye(w.numel()) - ca.jacobian(h, w), ca.jacobian(swept, w)
    slopes = [
        ca.densify(ca.jacobian(swept, v) + f_w @ ca.solve(left, ca.jacobian(h, v))) for v in wrt
    ]
    return [f, *(ca.substitute(slope, w, f[e.strains]) for slope in slopes)]


def _function(name: str, x: ca.SX, args: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, [x, *args], outputs, {"cse": True})
