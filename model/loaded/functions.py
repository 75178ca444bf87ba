"""The equations of a loaded arm as functions, built once for each form of loads."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.integrators.runge_kutta import RungeKutta
from model.loaded.equations import LoadEquations
from model.loaded.jumps import jump, tip


@lru_cache(maxsize=64)
def rate_function(equations: LoadEquations) -> ca.Function:
    """Return (x, pull, data, pull rate, data rate, numbers) -> derivative of x along s."""
    x, args = ca.SX.sym("x", equations.n_x), equations.symbols()
    return ca.Function("rate", [x, *args], [equations.rate(x, *args)], {"cse": True})


@lru_cache(maxsize=64)
def load_step(equations: LoadEquations, scheme: RungeKutta) -> ca.Function:
    """Return (x, pulls, datas, pull rates, data rates, numbers, h) -> x across one step.

    All but x and h have a column for each distinct node of the scheme.
    """
    nodes = sorted(set(scheme.nodes))
    x, h, args = ca.SX.sym("x", equations.n_x), ca.SX.sym("h"), equations.symbols(len(nodes))
    slope = rate_function(equations)

    def rate(stage: int, x: ca.SX) -> ca.SX:
        i = nodes.index(scheme.nodes[stage])
        return slope(x, *(values[:, i] for values in args))

    return ca.Function("step", [x, *args, h], [scheme.step(rate, x, h)], {"cse": True})


@lru_cache(maxsize=64)
def jump_function(equations: LoadEquations) -> ca.Function:
    """Return (x, pull, data, numbers outside, y, the same inside, probe) -> residual."""
    x, y = ca.SX.sym("x", equations.n_x), ca.SX.sym("y", equations.n_x)
    outer, inner = ([s[0], s[1], s[4]] for s in (equations.symbols(), equations.symbols()))
    probe = ca.SX.sym("probe", 3 * equations.form.probed)
    residual = jump(equations, x, outer, y, inner, probe)
    return ca.Function("jump", [x, *outer, y, *inner, probe], [residual], {"cse": True})


@lru_cache(maxsize=64)
def tip_function(equations: LoadEquations) -> ca.Function:
    """Return (y, pull, data, numbers, load (6,), probe) -> residual at the tip."""
    y, load, s = ca.SX.sym("y", equations.n_x), ca.SX.sym("load", 6), equations.symbols()
    inner, probe = [s[0], s[1], s[4]], ca.SX.sym("probe", 3 * equations.form.probed)
    residual = tip(equations, y, inner, load, probe)
    return ca.Function("tip", [y, *inner, load, probe], [residual], {"cse": True})


@lru_cache(maxsize=64)
def strain_reader(equations: LoadEquations) -> ca.Function:
    """Return (x, pull, data, numbers) -> (tau, xi, k, q, nu_n, nu_b)."""
    x, s = ca.SX.sym("x", equations.n_x), equations.symbols()
    kappa, nu = equations.twist(x, s[0], s[1], s[4])
    full = ca.vertcat(kappa / nu[0], nu[0] - 1, nu[1:])
    return ca.Function("strain", [x, s[0], s[1], s[4]], [full], {"cse": True})


@lru_cache(maxsize=64)
def state_reader(equations: LoadEquations) -> ca.Function:
    """Return (tau, xi, k, q) without loads -> the strains that are states."""
    e = ca.SX.sym("e", 4)
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], 0, 0)
    return ca.Function("state", [e], [equations.statics.state(kappa, nu)])
