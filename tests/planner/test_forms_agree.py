"""The condensed form and multiple shooting are two statements of one problem."""

from typing import Any

import numpy as np
import pytest

from model import Arm, Scene
from model.forward import schemes_of
from planner import Limits, Statement, build, plan
from planner.targets import BendingPlane, Fetch, TipPosition
from tests.planner.cases import PAPER, figure_15, moderate, paper_tip

ARM = Arm.from_paper("table-4")
TIP = TipPosition(paper_tip(ARM, moderate()))


@pytest.mark.parametrize("norm", ["2", "1", "inf"])
def test_both_forms_find_the_same_least_effort_for_a_tip(norm: str) -> None:
    plans = [
        plan(ARM, TIP, PAPER, 20.0, norm=norm, form=form)
        for form in ("condensed", "multiple-shooting")
    ]
    assert all(p.certificate.passed for p in plans)
    assert plans[0].effort == pytest.approx(plans[1].effort, rel=1e-6)


@pytest.mark.parametrize(
    "target",
    [BendingPlane(0.4, 1.0, 2), Fetch.reach((0.05, 0.05, 0.0), 0.6)],
    ids=["bending plane", "fetch"],
)
def test_both_forms_find_the_same_tensions(target: Any) -> None:
    plans = [plan(ARM, target, PAPER, 20.0, form=f) for f in ("condensed", "multiple-shooting")]
    assert np.abs(plans[0].tensions - plans[1].tensions).max() < 1e-6


def test_the_constraints_of_multiple_shooting_vanish_at_a_settled_shape() -> None:
    limits = Limits.of(ARM, 20.0)
    statement = Statement("multiple-shooting", scheme="rk6", refinement=8)
    problem = build(ARM, (TIP,), PAPER, statement)
    T, p = figure_15().ravel(), problem.parameters((TIP,), limits)
    g = problem.derivatives.slopes(problem.unknowns(T, limits, p), p)[1]
    names = np.concatenate([[rows.name] * rows.size for rows in problem.rows])
    assert np.abs(np.array(g).ravel()[names == "shooting"]).max() < 1e-12
    assert (names == "shooting").sum() == 3 * 9


@pytest.mark.parametrize("form", ["condensed", "multiple-shooting"])
@pytest.mark.parametrize("mode", ["exact", "nearest"])
@pytest.mark.parametrize(
    "scene",
    [PAPER, Scene(), Scene.as_printed(), Scene.silicone()],
    ids=["paper", "bare", "printed", "silicone"],
)
def test_derivatives_are_those_of_finite_differences(form: Any, mode: Any, scene: Scene) -> None:
    targets = (Fetch.reach((0.05, 0.05, 0.0), 0.6, 0.3),)
    limits = Limits.of(ARM, 20.0)
    scheme = "rk6" if form == "multiple-shooting" else schemes_of(scene)[0]
    problem = build(ARM, targets, scene, Statement(form, mode=mode, scheme=scheme, refinement=2))
    p = problem.parameters(targets, limits)
    x = problem.unknowns(moderate().ravel() + 0.1, limits, p)
    rng = np.random.default_rng(0)
    lam = rng.normal(size=problem.nlp["g"].numel())
    step = rng.normal(size=x.size) * 1e-6

    def slope(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gradient, g, jacobian = (np.array(v) for v in problem.derivatives.slopes(x, p))
        return gradient.ravel() + jacobian.T @ lam, g.ravel()

    jacobian = np.array(problem.derivatives.slopes(x, p)[2])
    hessian = np.array(problem.derivatives.curvature(x, p, 1.0, lam))
    (up, g_up), (down, g_down) = slope(x + step), slope(x - step)
    scale = np.abs(jacobian).max() * np.linalg.norm(step)
    assert np.abs((g_up - g_down) / 2 - jacobian @ step).max() < 1e-6 * scale
    scale = np.abs(hessian).max() * np.linalg.norm(step)
    assert np.abs((up - down) / 2 - hessian @ step).max() < 1e-5 * scale
    assert np.abs(hessian - hessian.T).max() < 1e-9 * np.abs(hessian).max()
