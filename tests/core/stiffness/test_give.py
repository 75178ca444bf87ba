"""The tip's compliance inside a program: values, and first and second derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Arm, Scene
from octoplan.model.effects import Current, Extension, Shear, TipLoad
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.targets import MinimumStiffness, Softest, Stiffest, Target, TipPosition
from tests.core.stiffness.cases import IN_WATER, Array, pulling
from tests.differences import check_derivatives, whole

ARM, T = Arm.from_paper("table-4"), pulling("table-4", 3)
ONE_SECTION = Arm.from_paper("section-5.2")
ALONG, EA = (1.0, 2.0, 0.5), 5.0
MATRIX = ((0.2, 0.05, 0.0), (0.05, 0.3, 0.0), (0.0, 0.0, 0.1))


Case = tuple[Arm, tuple[Effect, ...], Target]
PROGRAMS: dict[str, Case] = {
    "no load": (ARM, (Extension(),), Stiffest(ALONG)),
    "no load, locked": (ARM, (), MinimumStiffness(MATRIX, 0.5, "length", EA)),
    "payload": (ARM, (Extension(), TipLoad((0.0, 0.0, -1e-3))), Stiffest(ALONG)),
    "in water, a matrix": (ARM, (Extension(), *IN_WATER), MinimumStiffness(MATRIX, 0.5)),
    "in water, locked": (
        ARM,
        (Extension(), *IN_WATER),
        MinimumStiffness(ALONG, 0.5, "length", EA),
    ),
    "current, locked": (
        ONE_SECTION,
        (Extension(), Current((0.02, 0.01, -0.05))),
        Softest(ALONG, hold="length", tendon_EA=EA),
    ),
    "follower": (ARM, (TipLoad((0.0, 1e-3, 0.0), follower=True),), Softest(ALONG)),
    "shear": (ARM, (Extension(), Shear()), Stiffest(ALONG)),
    "friction": (ONE_SECTION, (Extension(), Friction(0.1, (1, 1, -1, -1))), Stiffest(ALONG)),
    "friction of tendons that end": (ARM, (Friction(0.1),), Stiffest(ALONG)),
    "silicone in water": (
        ONE_SECTION,
        (*Scene.silicone().effects, *IN_WATER),
        MinimumStiffness(ALONG, 0.5),
    ),
}


def stated(
    arm: Arm, effects: tuple[Effect, ...], target: Target
) -> tuple[ProgramInstance, Array, Array]:
    """Return a small problem with a stiffness, its parameters, and unknowns at settled tensions."""
    targets, limits = (TipPosition((0.2, 0.05, 0.01)), target), TendonLimits.of(arm, 20.0)
    options = NlpOptions(refinement=1)
    problem = ProgramInstance(PlanningProblem(arm, targets, Scene(*effects), limits, options, 1e-6))
    p, rng = problem.parameters(), np.random.default_rng(5)
    return problem, p, problem.guess(rng.uniform(0.05, 0.3, arm.n_tendons))


@pytest.mark.quick("no load", "payload", "in water, a matrix", "in water, locked")
@pytest.mark.parametrize(("arm", "effects", "target"), PROGRAMS.values(), ids=PROGRAMS)
def test_derivatives_of_a_program_with_a_stiffness_are_differences_of_it(
    arm: Arm, effects: tuple[Effect, ...], target: Target
) -> None:
    problem, p, x = stated(arm, effects, target)
    off = 1e-3 * np.random.default_rng(6).normal(size=x.size)
    check_derivatives(whole(problem, p), x + off, 2e-5)
