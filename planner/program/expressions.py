"""A program in symbols where poses are explicit functions of the tensions, with its derivatives.

Closed forms are derived step by step, by kernels that may be compiled; those as printed by CasADi
as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from model.forward import ExplicitMap
from model.machine.compiled import kernels
from model.unloaded.condensed_steps import CondensedSteps
from planner.program.objective import Objective, split


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


@dataclass(frozen=True, eq=False)
class Outer:
    """What an objective makes of poses (7, K) and stretch (r,), and of what is known of these.

    With unknowns x and parameters p; `seen` (7 K + r, n) are the derivatives of poses, column by
    column, and stretch by the tensions.

    Attributes
    ----------
    value : x, p, poses, stretch -> f, g
    first : x, p, poses, stretch, seen -> f, its gradient, g, its Jacobian
    weights : x, p, poses, stretch, sigma, lam -> gradient of the Lagrangian in poses and in stretch
    second : x, p, poses, stretch, seen, sigma, lam, bent -> its Hessian
        `bent` (n, n) is the Hessian by the tensions of poses and stretch, so weighted.
    """

    value: ca.Function
    first: ca.Function
    weights: ca.Function
    second: ca.Function


@lru_cache(maxsize=24)
def outer_of(objective: Objective, n: int, stations: int, machine_code: bool) -> Outer:
    """Return the functions of an objective of n tensions that sees K stations, built once."""
    value, first_of_all, weights, second_of_all = kernels(_kernels(objective, n), machine_code)
    n_free, n_numbers, gaps = (
        value.numel_in(0),
        objective.n_numbers,
        objective.gaps(machine_code),
    )
    x, p = ca.MX.sym("x", n_free), ca.MX.sym("p", n_numbers + n)
    poses, stretch = ca.MX.sym("poses", 7, stations), ca.MX.sym("stretch", value.numel_in(3))
    given, own = [x, p, poses, stretch], [x, p, poses[:, objective.seen], stretch]
    near = poses, p[objective.n_own : n_numbers - 3]
    seen = ca.MX.sym("seen", poses.numel() + stretch.numel(), n)
    moved = ca.horzcat(seen @ ca.diag(p[n_numbers:]), ca.MX(seen.shape[0], n_free - n))
    moved_poses = moved[: poses.numel(), :]
    places = [7 * k + i for k in objective.seen for i in range(7)]
    across = ca.vertcat(ca.MX.eye(n_free), moved_poses[places, :], moved[poses.numel() :, :])
    f, g = value(*own)
    g = objective.with_gaps(g, gaps.value(*near))
    by_all, rows_by_all = first_of_all(*own)
    steep = gaps.jacobian(*near)
    jacobian = objective.with_gaps(rows_by_all @ across, steep @ moved_poses)
    first = [f, across.T @ by_all, g, jacobian]
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    lam_own, pressed = objective.without_gaps(lam, gaps.size)
    slope, thin = weights(*own, sigma, lam_own)
    slope_of_all = ca.reshape(steep.T @ pressed, *poses.shape)
    slope_of_all[:, objective.seen] += slope
    bent, unit = ca.MX.sym("bent", n, n), ca.diag(p[n_numbers:])
    hessian = across.T @ second_of_all(*own, sigma, lam_own) @ across
    hessian += moved_poses.T @ gaps.second(*near, pressed) @ moved_poses
    hessian += ca.diagcat(unit @ bent @ unit, ca.MX(n_free - n, n_free - n))
    along = [sigma, lam]
    return Outer(
        ca.Function("value", given, [f, ca.densify(g)]),
        ca.Function("first", [*given, seen], [ca.densify(v) for v in first]),
        ca.Function("weights", [*given, *along], [ca.densify(slope_of_all), thin]),
        ca.Function("second", [*given, seen, *along, bent], [ca.densify(hessian)]),
    )


def by_steps(steps: CondensedSteps, outer: Outer) -> Expressions:
    """Return the program of an objective that sees poses of a closed form, and its stretch."""
    first = outer.first
    x, p = ca.MX.sym("x", first.numel_in(0)), ca.MX.sym("p", first.numel_in(1))
    T = x[: steps.n] * p[-steps.n :]
    (poses, by_tensions), (stretch, thinner) = steps.first(T), steps.stretch(T)
    f, g = outer.value(x, p, steps.poses(T), stretch)
    seen = ca.vertcat(by_tensions, thinner)
    _, gradient, _, jacobian = first(x, p, poses, stretch, seen)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    weights, thin = outer.weights(x, p, poses, stretch, sigma, lam)
    bent = steps.second(T, weights) + steps.stretch_second(T, thin)
    hessian = outer.second(x, p, poses, stretch, seen, sigma, lam, bent)
    return Expressions(x, p, f, g, gradient, jacobian, sigma, lam, hessian)


def _kernels(objective: Objective, n: int) -> tuple[ca.Function, ...]:
    """Return (x, p, poses, stretch) -> f, g; gradient of f, Jacobian of g, both in all but p.

    And, with sigma and lam, the Lagrangian's gradient in poses (7, K) and stretch; its Hessian.
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
    along = [*at, sigma, lam]
    return (
        ca.Function("outer_value", at, [f, ca.densify(g)], cse),
        ca.Function("outer_first", at, first, cse),
        ca.Function("outer_weights", along, [weights, thinner], cse),
        ca.Function("outer_second", along, [ca.densify(hessian)], cse),
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
    own = poses[:, [nodes[k] for k in objective.seen]]
    parts = (T, x[n:last], x[last:], given, own, least, ca.SX(0, 1))
    f, g = objective.function.expand().call(parts, True)
    near = ca.MX.sym("poses", 7, len(nodes)), ca.MX.sym("p", given.numel() - objective.n_own - 3)
    gaps = ca.Function("gaps", [*near], [objective.gaps().value(*near)]).expand()
    g = objective.with_gaps(g, gaps(poses[:, nodes], given[objective.n_own : -3]))
    sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", g.numel())
    hessian = ca.hessian(sigma * f + ca.dot(lam, g), x)[0]
    return Expressions(x, p, f, g, ca.gradient(f, x), ca.jacobian(g, x), sigma, lam, hessian)
