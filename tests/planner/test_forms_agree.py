"""The condensed form and multiple shooting are two statements of one problem."""

from typing import Any

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Buoyancy, Extension, TipLoad, Weight
from planner import Limits, Statement, build, plan
from planner.program.problem import Problem
from planner.targets import BendingPlane, Fetch, TipPosition
from tests.planner.cases import PAPER, Array, moderate, paper_tip
from tests.planner.differences import check_derivatives, condensed, whole

ARM = Arm.from_paper("table-4")
TIP = TipPosition(paper_tip(ARM, moderate()))


@pytest.mark.quick("1")
@pytest.mark.parametrize("norm", ["2", "1", "inf"])
def test_both_forms_find_the_same_least_effort_for_a_tip(norm: str) -> None:
    plans = [
        plan(ARM, TIP, PAPER, 20.0, norm=norm, form=form)
        for form in ("condensed", "multiple-shooting")
    ]
    assert all(p.certificate.passed for p in plans)
    assert plans[0].effort == pytest.approx(plans[1].effort, rel=1e-6)


@pytest.mark.quick("fetch")
@pytest.mark.parametrize(
    "target",
    [BendingPlane(0.4, 1.0, 2), Fetch.reach((0.05, 0.05, 0.0), 0.6)],
    ids=["bending plane", "fetch"],
)
def test_both_forms_find_the_same_tensions(target: Any) -> None:
    plans = [plan(ARM, target, PAPER, 20.0, form=f) for f in ("condensed", "multiple-shooting")]
    assert np.abs(plans[0].tensions - plans[1].tensions).max() < 1e-6


@pytest.mark.quick("payload")
@pytest.mark.parametrize(
    "scene",
    [Scene(Extension(), TipLoad((0.0, 0.0, -1e-3))), Scene(Extension(), Weight(), Buoyancy())],
    ids=["payload", "in water"],
)
def test_both_forms_find_the_same_least_effort_under_loads(scene: Scene) -> None:
    target = TipPosition(tuple(settle(ARM, moderate(), scene, 1e-9).tip.tolist()))
    plans = [plan(ARM, target, scene, 20.0, form=f) for f in ("condensed", "multiple-shooting")]
    assert all(p.certificate.passed for p in plans)
    assert plans[0].statement.form == "condensed"
    assert plans[0].effort == pytest.approx(plans[1].effort, rel=1e-6)


WATER = Scene(Extension(), Weight(), Buoyancy())
SCENES = {"paper": PAPER, "bare": Scene(), "silicone": Scene.silicone(), "in water": WATER}
FETCH = (Fetch.reach((0.05, 0.05, 0.0), 0.6, 0.3),)
LIMITS = Limits.of(ARM, 20.0)
MODES = ("exact", "closest", "nearest")


def stated(scene: Scene, mode: Any) -> tuple[Problem, Array, Array]:
    """A small problem, its parameters, and its unknowns at settled tensions, none of them 0."""
    statement = Statement("multiple-shooting", mode=mode, scheme="gauss6", refinement=2)
    problem = build(ARM, FETCH, scene, statement)
    p = problem.parameters(FETCH, LIMITS)
    return problem, p, problem.unknowns(moderate().ravel() + 0.1, LIMITS, p)


@pytest.mark.parametrize("name", SCENES)
def test_the_equations_of_equilibrium_vanish_at_a_settled_shape_and_nowhere_near(name: str) -> None:
    problem, p, x = stated(SCENES[name], "exact")
    names = np.concatenate([[rows.name] * rows.size for rows in problem.rows])
    states = np.arange(x.size) > problem.n_free
    assert problem.rows[-1].name == "equilibrium"
    assert (names == "equilibrium").sum() == states.sum() > 100
    assert np.abs(problem.constraints(x, p)[names == "equilibrium"]).max() < 1e-12
    for places in (states, np.arange(x.size) < ARM.n_tendons):
        off = problem.constraints(x + 1e-3 * places, p)
        assert np.abs(off[names == "equilibrium"]).max() > 1e-5


@pytest.mark.quick("paper-nearest", "bare-exact", "silicone-closest", "in water-nearest")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", SCENES)
def test_derivatives_with_the_states_are_those_of_finite_differences(name: str, mode: Any) -> None:
    problem, p, x = stated(SCENES[name], mode)
    off = 1e-3 * np.random.default_rng(1).normal(size=x.size)
    check_derivatives(whole(problem, p), x + off, 1e-4)


@pytest.mark.quick(
    "paper-nearest", "bare-exact", "silicone-exact", "in water-closest", "printed-nearest"
)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", [*SCENES, "printed"])
def test_derivatives_by_tensions_alone_are_those_of_finite_differences(
    name: str, mode: Any
) -> None:
    scene = Scene.as_printed() if name == "printed" else SCENES[name]
    problem, p, x = stated(scene, mode)
    check_derivatives(condensed(problem, p), x[: problem.n_free], 1e-4)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", SCENES)
def test_both_forms_say_the_same_of_a_settled_shape(name: str, mode: Any) -> None:
    problem, p, x = stated(SCENES[name], mode)
    a, rng = x[: problem.n_free], np.random.default_rng(2)
    inner, outer = condensed(problem, p).first(a), whole(problem, p).first(x)
    # The arm is settled twice, each time to 1e-10.
    assert inner.f == pytest.approx(outer.f, rel=1e-10)
    assert np.abs(inner.g - outer.g[: inner.g.size]).max() < 1e-11
    # With multipliers of equilibrium no state matters: the Jacobian by tensions is left.
    lam = rng.normal(size=inner.g.size)
    _, lam_g = problem.condensed.multipliers(a, p, np.zeros(a.size), lam)
    jacobian = outer.gradient + outer.jacobian.T @ lam_g
    wanted = inner.gradient + inner.jacobian.T @ lam
    scale = np.abs(outer.jacobian.T) @ np.abs(lam_g)
    assert np.abs(jacobian[: a.size] - wanted).max() < 1e-9 * scale.max()
    assert np.all(np.abs(jacobian[a.size + 1 :]) < 1e-10 * scale.max())
