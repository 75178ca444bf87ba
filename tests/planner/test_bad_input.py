"""Whatever is wrong with a question is told by field, before anything is computed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from model import Arm, InputError
from model.effects import Extension
from planner import plan, plan_many, trajectory
from planner.targets import Backbone, BendingPlane, Fetch, TipPose, TipPosition
from tests.planner.cases import PAPER

ARM = Arm.from_paper("table-4")
TIP = TipPosition((0.3, 0.1, 0.0))
ONE_SECTION = Arm.from_paper("section-5.1")

CASES: dict[str, tuple[Callable[[], Any], str]] = {
    "no arm": (lambda: plan("table-4", TIP, PAPER, 1.0), "arm"),  # type: ignore[arg-type]
    "no scene": (lambda: plan(ARM, TIP, "silicone", 1.0), "scene"),  # type: ignore[arg-type]
    "an effect for a scene": (lambda: plan(ARM, TIP, Extension(), 1.0), "scene"),  # type: ignore[arg-type]
    "no scene for many": (lambda: plan_many(ARM, [TIP], "silicone", 1.0), "scene"),  # type: ignore[arg-type]
    "no arm for many": (lambda: plan_many("table-4", [TIP], PAPER, 1.0), "arm"),  # type: ignore[arg-type]
    "no scene for a motion": (
        lambda: trajectory(ARM, [TIP], "silicone", 1.0, rate_max=5.0),  # type: ignore[arg-type]
        "scene",
    ),
    "maximum below zero": (lambda: plan(ARM, TIP, PAPER, -1.0), "tension_max"),
    "one maximum below zero": (
        lambda: plan(ARM, TIP, PAPER, [[1] * 4, [1, 1, -1, 1], [1] * 4]),
        "T_23",
    ),
    "maximum NaN": (lambda: plan(ARM, TIP, PAPER, np.nan), "tension_max"),
    "maximum a string": (lambda: plan(ARM, TIP, PAPER, "20 N"), "tension_max"),
    "maxima of the wrong size": (lambda: plan(ARM, TIP, PAPER, [1, 2, 3]), "tension_max"),
    "minimum above maximum": (lambda: plan(ARM, TIP, PAPER, 1.0, tension_min=2.0), "tension_min"),
    "minimum infinite": (lambda: plan(ARM, TIP, PAPER, tension_min=np.inf), "tension_min"),
    "minimum out of this world": (
        lambda: plan(ARM, TIP, PAPER, tension_min=1e20),
        "tension_min[0]",
    ),
    "maximum of yes": (lambda: plan(ARM, TIP, PAPER, True), "tension_max"),
    "ragged maxima": (lambda: plan(ARM, TIP, PAPER, [1, [2, 3], [4]]), "tension_max"),
    "maxima in rows of rows": (lambda: plan(ARM, TIP, PAPER, [[[1.0]]]), "tension_max"),
    "total below minima": (
        lambda: plan(ARM, TIP, PAPER, 5.0, tension_min=1.0, total_pull=3.0),
        "total_pull",
    ),
    "point of two numbers": (lambda: TipPosition((1.0, 2.0)), "TipPosition.position"),
    "point of NaN": (lambda: TipPosition((np.nan, 0, 0)), "TipPosition.position"),
    "point a string": (lambda: TipPosition("here"), "TipPosition.position"),
    "point out of sight": (
        lambda: plan(ARM, TipPosition((0, 1e6, 0)), PAPER, 1.0),
        "TipPosition.position",
    ),
    "points out of sight": (
        lambda: plan(ARM, Backbone(((1e6, 0, 0),)), PAPER, 1.0),
        "Backbone.points",
    ),
    "mouth out of sight": (
        lambda: plan(ARM, Fetch.reach((0, 0, 1e6)), PAPER, 1.0),
        "Fetch.reach mouth",
    ),
    "frame out of this world": (lambda: TipPose((0, 0, 0), 1e25 * np.eye(3)), "TipPose.frame"),
    "frame not orthonormal": (lambda: TipPose((0, 0, 0), np.ones((3, 3))), "TipPose.frame"),
    "frame left-handed": (lambda: TipPose((0, 0, 0), -np.eye(3)), "TipPose.frame"),
    "bend of zero": (lambda: BendingPlane(0.0, 0.0), "BendingPlane.bend"),
    "bend in degrees": (lambda: BendingPlane(0.0, 90.0), "BendingPlane.bend"),
    "section 4 of 3": (lambda: plan(ARM, BendingPlane(0, 1, 4), PAPER, 1.0), "section"),
    "section 0": (lambda: plan(ARM, BendingPlane(0, 1, 0), PAPER, 1.0), "section"),
    "points of the wrong size": (lambda: Backbone(((0, 0),)), "Backbone.points"),
    "no points": (lambda: Backbone(np.zeros((0, 3))), "Backbone.points"),
    "weights of the wrong size": (lambda: Backbone(((0, 0, 0),), None, (1, 2)), "Backbone.weights"),
    "weights below zero": (lambda: Backbone(((0, 0, 0),), None, (-1,)), "Backbone.weights"),
    "points beyond the arm": (lambda: plan(ARM, Backbone(((0, 0, 0),), (0.5,))), "Backbone.s"),
    "points that fall together": (
        lambda: plan(ARM, Backbone(((0.1, 0, 0), (0.1, 0, 0)))),
        "Backbone.points",
    ),
    "a fetch by one section": (
        lambda: plan(ONE_SECTION, Fetch.reach((0, 0, 0)), PAPER, 1.0),
        "arm.sections",
    ),
    "a bend of a fetch beyond pi": (lambda: Fetch((4, 0), (1, 0), (1, 0)), "Fetch.proximal"),
    "least bend of pi": (lambda: Fetch.reach((0, 0, 0), np.pi), "Fetch.reach bend"),
    "two tip positions": (
        lambda: plan(ARM, [TIP, TipPosition((0.2, 0.1, 0.0))], PAPER, 1.0),
        "tip position",
    ),
    "planes by two sections": (
        lambda: plan(ARM, [BendingPlane(0, 1, 1), BendingPlane(1, 1, 2)], PAPER, 1.0),
        "bending plane",
    ),
    "no target": (lambda: plan(ARM, [], PAPER, 1.0), "target"),
    "something else as a target": (lambda: plan(ARM, "up", PAPER, 1.0), "target"),
    "an unknown form": (lambda: plan(ARM, TIP, PAPER, 1.0, form="single"), "form"),
    "an unknown norm": (lambda: plan(ARM, TIP, PAPER, 1.0, norm="3"), "norm"),
    "no starts": (lambda: plan(ARM, TIP, PAPER, 1.0, starts=0), "starts"),
    "an accuracy of 1": (lambda: plan(ARM, TIP, PAPER, 1.0, accuracy=1.0), "accuracy"),
}


@pytest.mark.parametrize("name", CASES)
def test_an_input_that_is_not_allowed_is_named(name: str) -> None:
    call, field = CASES[name]
    with pytest.raises(InputError) as caught:
        call()
    assert field in caught.value.field
    assert caught.value.allowed
