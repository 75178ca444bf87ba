"""A program in symbols where poses are explicit functions of the tensions, with its derivatives.

Closed forms are derived step by step, by kernels that may be compiled; those as printed by CasADi
as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.forward import ExplicitMap
from model.machine.compiled import kernels
from model.unloaded.condensed_steps import CondensedSteps
from planner.program.program import Objective, split


@dataclass(frozen=True, eq=False)
class Expressions:
    """A program in symbols, all SX or all MX: unknowns, parameters, values and derivatives.

    See program.Program.
    """

    x: Any
    p: Any
    f: Any
    g: Any
    gradient: Any
    jacobian: Any
    sigma: Any
    lam: Any
    hessian: Any


def by_steps(steps: CondensedSteps, objective: Objective, machine_code: bool) -> Expressions:
    """Return the program of an objective that sees poses of a closed form, and its stretch."""
    n, n_free = steps.n, steps.n + objective.n_peak + objective.n_lack
    outer = _outer(objective, n)
    value, first, second = kernels(outer, machine_code)
    x, p = ca.MX.sym("x", n_free), ca.MX.sym("p", value.numel_in(1))
    unit = p[objective.n_numbers :]
    T = x[:n] * unit
    (poses, slopes), (stretch, thinner) = steps.first(T), steps.stretch(T)
    f, g = value(x, p, steps.poses(T), stretch)
    seen = ca.vertcat(slopes, thinner) @ ca.diag(unit)
    across = ca.vertcat(ca.MX.eye(n_free), ca.horzcat(seen, ca.MX(seen.shape[0], n_free - n)))
    by_all, rows_by_all = first(x, p, poses, stretch)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    weights, thin, hessian = second(x, p, poses, stretch, sigma, lam)
    bent = steps.second(T, weights) + steps.stretch_second(T, thin)
    bent = ca.diag(unit) @ bent @ ca.diag(unit)
    whole = across.T @ hessian @ across + ca.diagcat(bent, ca.MX(n_free - n, n_free - n))
    gradient, jacobian = across.T @ by_all, rows_by_all @ across
    return Expressions(x, p, f, g, gradient, jacobian, sigma, lam, ca.densify(whole))


def _outer(objective: Objective, n: int) -> tuple[ca.Function, ...]:
    """Return (x, p, poses, stretch) -> f, g; gradient of f, Jacobian of g, both in all but p.

    And, with sigma and lam, the Lagrangian's gradient in poses (7, K) and stretch, and its Hessian.
    """
    n_peak, n_numbers, thin = objective.n_peak, objective.n_numbers, objective.function.numel_in(5)
    x = ca.SX.sym("x", n + n_peak + objective.n_lack)
    p, poses = ca.SX.sym("p", n_numbers + n), ca.SX.sym("poses", 7, objective.terms.size2_in(0))
    T, last, stretch = x[:n] * p[n_numbers:], n + n_peak, ca.SX.sym("stretch", thin)
    parts = (T, x[n:last], x[last:], p[:n_numbers], poses, stretch, ca.SX(0, 1))
    f, g = objective.function.expand().call(parts, True)
    y, sigma = ca.vertcat(x, ca.vec(poses), stretch), ca.SX.sym("sigma")
    lam = ca.SX.sym("lam", g.numel())
    hessian, gradient = ca.hessian(sigma * f + ca.dot(lam, g), y)
    weights, thinner = ca.vertsplit(
        ca.densify(gradient[x.numel() :]), [0, poses.numel(), poses.numel() + thin]
    )
    weights = ca.reshape(weights, *poses.shape)
    first = [ca.densify(ca.gradient(f, y)), ca.densify(ca.jacobian(g, y))]
    at, cse = [x, p, poses, stretch], {"cse": True}
    return (
        ca.Function("outer_value", at, [f, ca.densify(g)], cse),
        ca.Function("outer_first", at, first, cse),
        ca.Function(
            "outer_second", [*at, sigma, lam], [weights, thinner, ca.densify(hessian)], cse
        ),
    )


def by_casadi(
    forward: ExplicitMap, objective: Objective, nodes: list[int], rows: list[int]
) -> Expressions:
    """Return the program of an objective that sees the poses at some nodes, derived as a whole."""
    n = forward.function.numel_in(0)
    sizes = (objective.n_numbers, n)
    x, p = ca.SX.sym("x", n + objective.n_peak + objective.n_lack), ca.SX.sym("p", sum(sizes))
    given, unit = split(p, sizes)
    T, last = x[:n] * unit, n + objective.n_peak
    poses, stretch = forward.function.expand()(T)[:2]
    least = stretch[rows].T if rows else ca.SX(0, 1)
    parts = (T, x[n:last], x[last:], given, poses[:, nodes], least, ca.SX(0, 1))
    f, g = objective.function.expand().call(parts, True)
    sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", g.numel())
    hessian = ca.hessian(sigma * f + ca.dot(lam, g), x)[0]
    return Expressions(x, p, f, g, ca.gradient(f, x), ca.jacobian(g, x), sigma, lam, hessian)
