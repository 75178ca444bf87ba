"""Programs side by side are solved as one: against a closed form, and differences."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pytest

from planner.solve.ipopt import TOGETHER, WARM
from planner.solve.side_by_side import Part, SideBySide, joined
from tests.differences import fourth_order

WANTED = np.array([1.0, 4.0])


def _program() -> SideBySide:
    """Minimise sum (x_k - p_k)^2 + z^2 with x_k = z^2 and x_1 + x_2 bounded."""

    def state(at: SideBySide) -> tuple[Sequence[Part], Part]:
        *xs, z = at.unknowns
        *lams, _ = at.multipliers
        parts = []
        for x, p, lam in zip(xs, ca.vertsplit(at.p), lams, strict=True):
            gradient, J = ca.vertcat(2 * (x - p), 0), ca.horzcat(1, -2 * z)
            H = ca.diag(ca.vertcat(2 * at.sigma, -2 * lam))
            parts.append(Part((x - p) ** 2, gradient, x - z**2, J, H))
        both = ca.DM([[1, 1, 0]])
        return parts, Part(z**2, 2 * z, both @ at.x, ca.MX(both), 2 * at.sigma)

    return SideBySide([1, 1], [1, 1], 1, 1, 2, state)


@pytest.mark.parametrize("most", [100.0, 3.0])
def test_the_optimum_is_that_of_the_closed_form(most: float) -> None:
    """With t = z^2 the objective is sum (t - p_k)^2 + t, least at t = (2 sum p - 1) / 4."""
    program, no_bounds = _program(), (np.full(1, -np.inf), np.full(1, np.inf))
    each = [(*no_bounds, np.zeros(1), np.zeros(1))] * 2
    bounds = joined(each, no_bounds, (np.full(1, -np.inf), np.full(1, most)))
    cold = program.solve(TOGETHER, np.ones(3), WANTED, bounds)
    warm = program.solve(WARM, cold.x, WANTED, bounds, (cold.lam_x, cold.lam_g))
    t = min((2 * WANTED.sum() - 1) / 4, most / 2)
    assert warm.met
    assert warm.x == pytest.approx([t, t, np.sqrt(t)], abs=1e-8)
    assert warm.f == pytest.approx(float(np.square(t - WANTED).sum() + t))
    assert warm.iterations < cold.iterations
    assert [part.tolist() for part in program.split(np.arange(3.0))] == [[0.0], [1.0], [2.0]]


def test_derivatives_are_those_of_differences() -> None:
    """Of the objective, of the constraints and of the Lagrangian, the upper half of its Hessian."""
    program, x = _program(), np.array([0.3, -0.7, 1.1])
    lam, of = np.array([0.4, -1.3, 0.8]), program.derivatives

    def values(y: np.ndarray) -> np.ndarray:
        return np.vstack([np.array(v) for v in program.values(y, WANTED)]).ravel()

    def slope(y: np.ndarray) -> np.ndarray:
        gradient, J = (np.array(of[name](y, WANTED)[1]) for name in ("grad_f", "jac_g"))
        return np.asarray(gradient.ravel() + J.T @ lam)

    gradient, J = (np.array(of[name](x, WANTED)[1]) for name in ("grad_f", "jac_g"))
    H = np.array(of["hess_lag"](x, WANTED, 1.0, lam))
    for k, along in enumerate(np.eye(3)):
        by_k = fourth_order(lambda h, v=along: values(x + h * v), 1e-3)
        assert np.append(gradient[k], J[:, k]) == pytest.approx(by_k, abs=1e-9)
        curved = fourth_order(lambda h, v=along: slope(x + h * v), 1e-3)
        assert H[: k + 1, k] == pytest.approx(curved[: k + 1], abs=1e-9)
