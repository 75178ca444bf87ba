"""Derivatives of programs in the tensions, against differences of shapes settled anew."""

from dataclasses import replace

import numpy as np
import pytest

from octoplan.model import Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule
from octoplan.planner.extensions.contact import Hold
from octoplan.planner.extensions.contact.optimum import steered
from octoplan.planner.extensions.contact.program import TensionProgram
from octoplan.planner.extensions.contact.search import FINE
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.targets import TipPosition
from tests.contact.cases import bar

ARM = bar(0.3, 0.006, 2e5)
ROD = Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02)
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD))
T = np.array([0.05, 0.6, 0.0, 0.02])
# Stability margin: more than half of the arm's stability, so that its derivatives matter.
LEAST = 0.9


@pytest.mark.quick("some")
@pytest.mark.parametrize("columns", [slice(1, None, 3), slice(None)], ids=["some", "all"])
def test_derivatives_of_targets_grip_and_stability_are_those_of_settled_shapes(
    columns: slice,
) -> None:
    tip = tuple(settle(ARM, T, SCENE).tip.tolist())
    targets = (TipPosition(tip), Hold(ROD, (0.01, 0.0, -0.05, 0.0, 1e-4, 0.0), 0.5))
    limits = TendonLimits((5.0,) * 4, (-1.0,) * 4, 9.0)
    problem = PlanningProblem(ARM, targets, SCENE, limits, NlpOptions(), 1e-6)
    program = TensionProgram(problem, FINE, LEAST)
    begin = program.settled(T)
    scaled, h = T / program.unit, 1e-4
    start = program.at(scaled, begin)
    f = start.tangential + 0.1
    assert f.size
    start = replace(start, tangential=f)

    def rows(step: np.ndarray) -> np.ndarray:
        """Return the numbers of all cones, and the contribution of the tangential forces."""
        at = program.at(scaled + step, begin, f)
        cones = at.cones
        x = np.zeros(cones[0][1].shape[1])
        x[T.size : T.size + f.size] = f
        return np.concatenate([rows @ x + numbers for _, rows, numbers in cones])

    differences = [(rows(step) - rows(-step)) / (2 * h) for step in h * np.eye(T.size)[columns]]
    expected = np.array(differences).T
    assert start.by_tensions[:, columns] == pytest.approx(expected, rel=1e-3, abs=2e-5)
    assert np.abs(start.by_tensions).max(axis=1).max() > 1e-3


def test_shapes_are_settled_within_the_limits_to_the_last_digit() -> None:
    """Load paths had tensions of -1e-14 N, which the plan's own shape refused."""
    tip = tuple(settle(ARM, T, SCENE).tip.tolist())
    limits = TendonLimits((5.0,) * 4, (0.0,) * 4)
    problem = PlanningProblem(ARM, (TipPosition(tip),), SCENE, limits, NlpOptions(), 1e-6)
    program = TensionProgram(problem, FINE)
    begin = program.settled(T)
    assert program.at(T / program.unit - 1e-13, begin).point.tensions.min() == 0.0


def test_a_penalty_rises_until_steps_take_most_violations_away() -> None:
    tip = tuple(settle(ARM, T * [1.0, 1.1, 1.0, 1.0], SCENE).tip.tolist())
    limits, exact, radius = (
        TendonLimits((5.0,) * 4, (0.0,) * 4),
        np.eye(T.size),
        np.full(T.size, 0.25),
    )
    problem = PlanningProblem(ARM, (TipPosition(tip),), SCENE, limits, NlpOptions(), 1e-6)
    program = TensionProgram(problem, FINE)
    start = program.at(T / program.unit, program.settled(T))
    step = steered(start, start, exact, radius, 1e-3)
    left = [start.step(exact, radius, each)[3] for each in (step.penalty / 10, step.penalty)]
    assert left[1] < start.violation / 10 < left[0]
    there = program.at(start.tensions + step.change, start.point)
    assert there.violation < start.violation
