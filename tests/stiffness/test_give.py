"""The tip's compliance inside a program: values, and first and second derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Current, Effect, Extension, Friction, Shear, TipLoad
from planner import Limits, Statement, stiffness
from planner.program.problem import Problem
from planner.targets import MinimumStiffness, Softest, Stiffest, Target, TipPosition
from tests.differences import check_derivatives, whole
from tests.stiffness.cases import IN_WATER, STATICS, Array, pulling, with_effects

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
    "silicone in water": (
        ONE_SECTION,
        (*Scene.silicone().effects, *IN_WATER),
        MinimumStiffness(ALONG, 0.5),
    ),
}


def stated(arm: Arm, effects: tuple[Effect, ...], target: Target) -> tuple[Problem, Array, Array]:
    """A small problem with a stiffness, its parameters, and its unknowns at settled tensions."""
    targets, limits = (TipPosition((0.2, 0.05, 0.01)), target), Limits.of(arm, 20.0)
    statement = Statement(refinement=1)
    problem = Problem(arm, Scene(*effects), targets, limits, statement)
    p, rng = problem.parameters(), np.random.default_rng(5)
    return problem, p, problem.guess(rng.uniform(0.05, 0.3, arm.n_tendons))


@pytest.mark.quick("no load", "payload", "in water, a matrix", "in water, locked")
@pytest.mark.parametrize(("arm", "effects", "target"), PROGRAMS.values(), ids=PROGRAMS)
def test_derivatives_of_a_program_with_a_stiffness_are_differences_of_it(
    arm: Arm, effects: tuple[Effect, ...], target: Target
) -> None:
    problem, p, x = stated(arm, effects, target)
    off = 1e-3 * np.random.default_rng(6).normal(size=x.size)
    check_derivatives(whole(problem, p), x + off, 1e-4)


SEEN = {
    "bare": STATICS["bare"],
    "paper": STATICS["paper"],
    "exact": STATICS["exact"],
    "silicone": STATICS["silicone"],
    "paper, in water": with_effects(STATICS["paper"], *IN_WATER),
    "silicone, payload": with_effects(STATICS["silicone"], TipLoad((0.0, 0.0, -1e-3))),
}


@pytest.mark.quick("bare-tension", "paper, in water-length", "silicone, payload-tension")
@pytest.mark.parametrize("hold", ["tension", "length"])
@pytest.mark.parametrize("name", SEEN)
def test_what_a_program_sees_is_what_stiffness_says(name: str, hold: Any) -> None:
    scene, EA_held = SEEN[name], EA if hold == "length" else None
    k = stiffness(ARM, T, scene, hold, accuracy=1e-9, tendon_EA=EA_held)
    d = np.array(ALONG) / np.linalg.norm(ALONG)
    wanted = float(1 / (d @ k.compliance[:3, :3] @ d))
    limits, statement = Limits.of(ARM, 20.0), Statement(refinement=8)
    for share in (1.0, 0.8):
        targets = (MinimumStiffness(ALONG, share * wanted, hold, EA_held),)
        problem = Problem(ARM, scene, targets, limits, statement)
        g = problem.constraints(problem.settled(T), problem.parameters())
        assert problem.rows[1].name == "inequality" and problem.rows[0].size == 0
        assert g[0] == pytest.approx(1 - share, abs=1e-7)


@pytest.mark.quick("tension")
@pytest.mark.parametrize("hold", ["tension", "length"])
def test_a_program_sees_all_directions_of_a_matrix(hold: Any) -> None:
    scene, EA_held = with_effects(STATICS["paper"], *IN_WATER), EA if hold == "length" else None
    k = stiffness(ARM, T, scene, hold, accuracy=1e-9, tendon_EA=EA_held)
    target = MinimumStiffness(MATRIX, 0.5, hold, EA_held)
    statement, limits = Statement(refinement=8), Limits.of(ARM, 20.0)
    problem = Problem(ARM, scene, (target,), limits, statement)
    values, vectors = np.linalg.eigh(np.array(MATRIX))
    root = vectors @ np.diag(np.sqrt(0.5 * values)) @ vectors.T
    spare = np.eye(3) - root @ k.compliance[:3, :3] @ root
    wanted = [*np.diag(spare), np.linalg.det(spare)]
    found = problem.constraints(problem.settled(T), problem.parameters())[:7][[0, 1, 2, 6]]
    assert found == pytest.approx(wanted, rel=1e-6)
