"""Central differences, and checks of derivatives and programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from octoplan.planner.program import Program
from octoplan.planner.program_instance import ProgramInstance
from tests.oracles import Array


def fourth_order(f: Callable[[float], Array], h: float) -> Array:
    """The derivative of f at 0 by the central formula of four points."""
    return np.asarray((f(-2 * h) - 8 * f(-h) + 8 * f(h) - f(2 * h)) / (12 * h))


def check_rows(matrix: Array, way: Array, wanted: Array) -> None:
    """Check each row of a matrix times a direction to 1e-7 of its largest terms."""
    size = np.abs(matrix) @ np.abs(way)
    assert size.max() > 0
    assert np.all(np.abs(matrix @ way - wanted) <= 1e-7 * size + 1e-9 * size.max())


class First(NamedTuple):
    """Values and first derivatives."""

    f: float
    gradient: Array
    g: Array
    jacobian: Array


class Twice(NamedTuple):
    """A program as numbers: point -> values and first derivatives; point, sigma, lam -> Hessian."""

    first: Callable[[Array], First]
    second: Callable[[Array, float, Array], Array]


def whole(problem: ProgramInstance, p: Array) -> Twice:
    """Return the program with the states among its unknowns."""

    of = problem.program

    def second(x: Array, sigma: float, lam: Array) -> Array:
        return dense(ca.triu2symm(of.function(x, p, sigma, lam)[-1]))

    return Twice(lambda x: all_of(of, x, p), second)


def all_of(of: Program, x: Array, p: Array) -> First:
    """Values and first derivatives of a program, the equations of equilibrium last."""
    f, gradient, g, J = of.evaluate(x, p)
    return First(f, gradient, g, J.toarray())


def dense(A: Any) -> Array:
    """Return a CasADi matrix with its zeros."""
    return np.array(ca.densify(A))


def check_derivatives(of: Twice, x: Array, step: float) -> None:
    """Hold the first and second derivatives of a program to differences along a random way."""
    rng, sigma = np.random.default_rng(0), 0.7
    here, way = of.first(x), rng.normal(size=x.size)
    lam = rng.normal(size=here.g.size)

    def values(share: float) -> Array:
        there = of.first(x + share * way)
        return np.append(there.f, there.g)

    def gradient(share: float) -> Array:
        there = of.first(x + share * way)
        return np.asarray(sigma * there.gradient + there.jacobian.T @ lam)

    H = of.second(x, sigma, lam)
    check_rows(np.vstack([here.gradient, here.jacobian]), way, fourth_order(values, step))
    check_rows(H, way, fourth_order(gradient, step))
    assert np.abs(H - H.T).max() < 1e-12 * np.abs(H).max()
