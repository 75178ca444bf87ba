"""The derivatives of an objective by the tensions, through the twists of the poses that it sees.

With y = (x, zeta, e), the unknowns, small twists zeta by which the poses g become exp(zeta) g, and
the least stretches e, the chain rule takes Jacobian and Hessian in y to those in x: the first
derivatives of zeta and e, and their second ones times the Lagrangian's slopes against them, which
for a twist are a wrench.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.arm import Arm
from model.machine.compiled import kernels
from model.paths import Array
from model.rotations import multiply
from model.stations import Counts, stations
from model.unloaded.closed_form import ClosedForm, strain_function
from model.unloaded.pose_derivatives import PoseDerivatives
from model.unloaded.pulls import PullPolynomials
from model.unloaded.statics import closed_statics
from planner.program.program import Objective


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


def by_twists(
    forward: ClosedForm,
    polynomials: PullPolynomials,
    objective: Objective,
    nodes: list[int],
    slimmest: tuple[Array, Counts],
    machine_code: bool,
) -> Expressions:
    """Return the program of an objective that sees the poses at some nodes of a closed form.

    `slimmest` are the arc lengths where 1 + q is looked at, and how many sections cross there.
    """
    n, n_numbers = forward.arm.n_tendons, objective.n_numbers
    functions = [*_outer(objective, n, len(nodes)), *_stretches(forward, *slimmest)]
    value, first, second, stretch, stretched = kernels(functions, machine_code)
    n_free = n + objective.n_peak + objective.n_lack
    x, p = ca.MX.sym("x", n_free), ca.MX.sym("p", n_numbers + n)
    unit = p[n_numbers:]
    T = x[:n] * unit
    derived = PoseDerivatives(forward, polynomials, nodes, machine_code)
    poses, twists = derived.first(T)
    here = ca.horzcat(*(forward.function(T)[0][:, node] for node in nodes))
    least, by_tension = stretch(T)
    f, g = value(x, p, here, least)
    moved = ca.vertcat(twists, by_tension) @ ca.diag(unit)
    others = ca.MX(moved.shape[0], n_free - n)
    across = ca.vertcat(ca.MX.eye(n_free), ca.horzcat(moved, others))
    _, by_all, _, rows_by_all = first(x, p, poses, least)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    slopes, hessian = second(x, p, poses, least, sigma, lam)
    K = 6 * len(nodes)
    wrenches = ca.reshape(slopes[n_free : n_free + K], 6, -1)
    bent = derived.second(T, wrenches) + stretched(T, slopes[n_free + K :])
    bent = ca.diag(unit) @ bent @ ca.diag(unit)
    whole = across.T @ hessian @ across + ca.diagcat(bent, ca.MX(n_free - n, n_free - n))
    return Expressions(
        x, p, f, g, (by_all.T @ across).T, rows_by_all @ across, sigma, lam, ca.densify(whole)
    )


def _outer(objective: Objective, n: int, K: int) -> list[ca.Function]:
    """Return (x, p, poses, least) -> f, g; and f, gradient, g, Jacobian in y; and Lagrangian's.

    The last takes sigma and lam too, and returns the Lagrangian's gradient and Hessian in y.
    """
    n_peak, n_numbers = objective.n_peak, objective.n_numbers
    x = ca.SX.sym("x", n + n_peak + objective.n_lack)
    p, poses = ca.SX.sym("p", n_numbers + n), ca.SX.sym("poses", 7, K)
    least = ca.SX.sym("least", objective.function.size1_in(5))
    zeta, more = ca.SX.sym("zeta", 6, K), ca.SX.sym("more", least.numel())
    seen = ca.horzcat(*(_moved(poses[:, i], zeta[:, i]) for i in range(K)))
    parts = (x[:n] * p[n_numbers:], x[n : n + n_peak], x[n + n_peak :], p[:n_numbers])
    given = (*parts, seen, least + more, ca.SX(0, 1))
    f, g = objective.function.expand().call(given, True)
    y = ca.vertcat(x, ca.vec(zeta), more)
    sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", g.numel())
    hessian, gradient = ca.hessian(sigma * f + ca.dot(lam, g), y)
    still = ca.vertcat(ca.vec(zeta), more)
    all_of_it = [f, g, ca.gradient(f, y), ca.jacobian(g, y), gradient, hessian]
    found = ca.substitute(all_of_it, [still], [ca.SX.zeros(still.numel())])
    f, g, by_all, rows_by_all, slopes, hessian = (ca.densify(value) for value in found)
    at = [x, p, poses, least]
    return [
        ca.Function("value", at, [f, g], {"cse": True}),
        ca.Function("outer_first", at, [f, by_all, g, rows_by_all], {"cse": True}),
        ca.Function("outer_second", [*at, sigma, lam], [slopes, hessian], {"cse": True}),
    ]


def _moved(pose: ca.SX, twist: ca.SX) -> ca.SX:
    """Return a pose moved by a small spatial twist, right to second order."""
    rotation, place = twist[:3], pose[4:]
    turn = ca.vertcat(1 - ca.sumsqr(rotation) / 8, rotation / 2)
    shift = ca.cross(rotation, place) + twist[3:]
    moved = place + shift + ca.cross(rotation, shift) / 2
    return ca.vertcat(multiply(turn, pose[:4]), moved)


def _stretches(forward: ClosedForm, s: Array, active: Counts) -> list[ca.Function]:
    """Return T -> 1 + q (r,) at arc lengths s, slopes (r, n); and T, weights -> Hessian (n, n)."""
    arm: Arm = forward.arm
    statics = closed_statics(forward.scene, arm)
    T, weights = ca.SX.sym("T", arm.n_tendons), ca.SX.sym("weights", s.size)
    found, strain = [], strain_function(statics)
    for i in range(s.size):
        at = stations(arm, s[i : i + 1], active[i : i + 1])
        pull = ca.sparsify(ca.DM(statics.pulls(arm, at)[0])) @ T
        found.append(1 + strain(pull, statics.data(at))[3])
    least = ca.vertcat(ca.SX(0, 1), *found)
    hessian = ca.hessian(ca.dot(weights, least), T)[0]
    slopes = ca.densify(ca.jacobian(least, T))
    return [
        ca.Function("stretch", [T], [least, slopes], {"cse": True}),
        ca.Function("stretched", [T, weights], [ca.densify(hessian)], {"cse": True}),
    ]
