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
from model.unloaded.closed_form import ClosedForm, strain_function
from model.unloaded.condensed_steps import CondensedSteps
from model.unloaded.statics import closed_statics
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


def by_steps(
    steps: CondensedSteps, objective: Objective, stretch: ca.Function, machine_code: bool
) -> Expressions:
    """Return the program of an objective that sees poses of a closed form, and its stretch."""
    n, n_free = steps.n, steps.n + objective.n_peak + objective.n_lack
    outer = _outer(objective, n, stretch)
    value, first, second = kernels(outer, machine_code)
    x, p = ca.MX.sym("x", n_free), ca.MX.sym("p", value.numel_in(1))
    unit = p[objective.n_numbers :]
    T = x[:n] * unit
    poses, slopes = steps.first(T)
    f, g = value(x, p, steps.poses(T))
    others = ca.MX(slopes.shape[0], n_free - n)
    across = ca.vertcat(ca.MX.eye(n_free), ca.horzcat(slopes @ ca.diag(unit), others))
    by_all, rows_by_all = first(x, p, poses)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    weights, hessian = second(x, p, poses, sigma, lam)
    bent = ca.diag(unit) @ steps.second(T, weights) @ ca.diag(unit)
    whole = across.T @ hessian @ across + ca.diagcat(bent, ca.MX(n_free - n, n_free - n))
    gradient, jacobian = across.T @ by_all, rows_by_all @ across
    return Expressions(x, p, f, g, gradient, jacobian, sigma, lam, ca.densify(whole))


def _outer(objective: Objective, n: int, stretch: ca.Function) -> tuple[ca.Function, ...]:
    """Return (x, p, poses) -> f, g; gradient of f, Jacobian of g, both in (x, poses).

    And, with sigma and lam, the Lagrangian's gradient in the poses (7, K), Hessian in (x, poses).
    """
    n_peak, n_numbers = objective.n_peak, objective.n_numbers
    x = ca.SX.sym("x", n + n_peak + objective.n_lack)
    p, poses = ca.SX.sym("p", n_numbers + n), ca.SX.sym("poses", 7, objective.terms.size2_in(0))
    T, last = x[:n] * p[n_numbers:], n + n_peak
    parts = (T, x[n:last], x[last:], p[:n_numbers], poses, stretch(T), ca.SX(0, 1))
    f, g = objective.function.expand().call(parts, True)
    y, sigma, lam = ca.vertcat(x, ca.vec(poses)), ca.SX.sym("sigma"), ca.SX.sym("lam", g.numel())
    hessian, gradient = ca.hessian(sigma * f + ca.dot(lam, g), y)
    weights = ca.reshape(ca.densify(gradient[x.numel() :]), *poses.shape)
    first = [ca.densify(ca.gradient(f, y)), ca.densify(ca.jacobian(g, y))]
    at, cse = [x, p, poses], {"cse": True}
    return (
        ca.Function("outer_value", at, [f, ca.densify(g)], cse),
        ca.Function("outer_first", at, first, cse),
        ca.Function("outer_second", [*at, sigma, lam], [weights, ca.densify(hessian)], cse),
    )


def stretch_function(forward: ClosedForm, rows: list[int]) -> ca.Function:
    """Return tensions -> 1 + q (r,) at some places of a closed form."""
    T = ca.SX.sym("T", forward.arm.n_tendons)
    strain = strain_function(closed_statics(forward.scene, forward.arm))
    found = [
        1 + strain(ca.sparsify(ca.DM(forward.maps[i])) @ T, ca.DM(forward.data[i]))[3] for i in rows
    ]
    return ca.Function("stretch", [T], [ca.vertcat(ca.SX(0, 1), *found)], {"cse": True})


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
