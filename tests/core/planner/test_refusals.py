"""Impossible plans, plots and drags are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.animation import FuncAnimation
from matplotlib.figure import Figure

from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension, Weight
from octoplan.planner import export, load_plan, plan, plan_many, trajectory
from octoplan.planner.frontends.live.handles import handle_of
from octoplan.planner.frontends.plots.ellipsoids import plot_ellipsoids
from octoplan.planner.frontends.plots.motion import plot_motion, save_motion
from octoplan.planner.frontends.plots.plan import plot_plan, plot_shape, plot_strains, save
from octoplan.planner.limits import Limits
from octoplan.planner.targets import (
    Backbone,
    Bend,
    BendingPlane,
    Fetch,
    Softest,
    Stiffest,
    TipPointing,
    TipPose,
    TipPosition,
)
from tests.core.planner.cases import changed
from tests.refusals import Refused, check_refusal

ARM, LONG, ONE_SECTION = map(Arm.from_paper, ("table-2", "table-4", "section-5.1"))
PAPER, AIR, TIP = Scene(Extension()), Scene(Extension(), Weight()), TipPosition((0.3, 0.1, 0.0))
PLAN = plan(LONG, TIP, PAPER, 20.0, starts=1)
SHAPE, SEVENTH = PLAN.shape, BendingPlane(2.0, 1.0, section=7)
PLANS: Refused = {
    "no arm": (lambda: plan("table-4", TIP, PAPER, 1.0), "arm", ""),
    "no scene": (lambda: plan(LONG, TIP, "silicone", 1.0), "scene", ""),
    "an effect for a scene": (lambda: plan(LONG, TIP, Extension(), 1.0), "scene", ""),
    "no scene for many": (lambda: plan_many(LONG, [TIP], "silicone", 1.0), "scene", ""),
    "no arm for many": (lambda: plan_many("table-4", [TIP], PAPER, 1.0), "arm", ""),
    "one target for many": (lambda: plan_many(LONG, TIP, PAPER, 1.0), "targets", "a sequence"),
    "a class of targets for many": (lambda: plan_many(LONG, TipPose, PAPER, 1.0), "targets", ""),
    "no scene for a motion": (
        lambda: trajectory(LONG, [TIP], "silicone", 1.0, rate_max=5.0),
        "scene",
        "",
    ),
    "maximum below zero": (lambda: plan(LONG, TIP, PAPER, -1.0), "tension_max", ""),
    "one maximum below zero": (
        lambda: plan(LONG, TIP, PAPER, [[1] * 4, [1, 1, -1, 1], [1] * 4]),
        "T_23",
        "",
    ),
    "maximum NaN": (lambda: plan(LONG, TIP, PAPER, np.nan), "tension_max", ""),
    "maximum a string": (lambda: plan(LONG, TIP, PAPER, "20 N"), "tension_max", ""),
    "maxima of the wrong size": (lambda: plan(LONG, TIP, PAPER, [1, 2, 3]), "tension_max", ""),
    "minimum above maximum": (
        lambda: plan(LONG, TIP, PAPER, 1.0, limits=Limits(tension_min=2.0)),
        "tension_min",
        "",
    ),
    "minimum infinite": (
        lambda: plan(LONG, TIP, PAPER, limits=Limits(tension_min=np.inf)),
        "tension_min",
        "",
    ),
    "minimum out of this world": (
        lambda: plan(LONG, TIP, PAPER, limits=Limits(tension_min=1e20)),
        "tension_min[0]",
        "",
    ),
    "maximum of yes": (lambda: plan(LONG, TIP, PAPER, True), "tension_max", ""),
    "ragged maxima": (lambda: plan(LONG, TIP, PAPER, [1, [2, 3], [4]]), "tension_max", ""),
    "maxima in rows of rows": (lambda: plan(LONG, TIP, PAPER, [[[1.0]]]), "tension_max", ""),
    "total below minima": (
        lambda: plan(
            LONG, TIP, PAPER, 5.0, limits=Limits(tension_min=1.0, total_pull=LONG.n_tendons - 1e-3)
        ),
        "total_pull",
        "",
    ),
    "point of two numbers": (lambda: TipPosition((1.0, 2.0)), "TipPosition.position", ""),
    "point of NaN": (lambda: TipPosition((np.nan, 0, 0)), "TipPosition.position", ""),
    "point a string": (lambda: TipPosition("here"), "TipPosition.position", ""),
    "point out of sight": (
        lambda: plan(LONG, TipPosition((0, 1e6, 0)), PAPER, 1.0),
        "TipPosition.position",
        "",
    ),
    "points out of sight": (
        lambda: plan(LONG, Backbone(((1e6, 0, 0),)), PAPER, 1.0),
        "Backbone.points",
        "",
    ),
    "mouth out of sight": (
        lambda: plan(LONG, Fetch.reach((0, 0, 1e6)), PAPER, 1.0),
        "FetchReach.mouth",
        "",
    ),
    "frame out of this world": (lambda: TipPose((0, 0, 0), 1e25 * np.eye(3)), "TipPose.frame", ""),
    "frame not orthonormal": (lambda: TipPose((0, 0, 0), np.ones((3, 3))), "TipPose.frame", ""),
    "frame left-handed": (lambda: TipPose((0, 0, 0), -np.eye(3)), "TipPose.frame", ""),
    "bend of zero": (lambda: BendingPlane(0.0, 0.0), "BendingPlane.bend", ""),
    "bend in degrees": (lambda: BendingPlane(0.0, 90.0), "BendingPlane.bend", ""),
    "section 4 of 3": (lambda: plan(LONG, BendingPlane(0, 1, 4), PAPER, 1.0), "section", ""),
    "section 0": (lambda: plan(LONG, BendingPlane(0, 1, 0), PAPER, 1.0), "section", ""),
    "points of the wrong size": (lambda: Backbone(((0, 0),)), "Backbone.points", ""),
    "no points": (lambda: Backbone(np.zeros((0, 3))), "Backbone.points", ""),
    "weights of the wrong size": (
        lambda: Backbone(((0, 0, 0),), None, (1, 2)),
        "Backbone.weights",
        "",
    ),
    "weights below zero": (lambda: Backbone(((0, 0, 0),), None, (-1,)), "Backbone.weights", ""),
    "points beyond the arm": (lambda: plan(LONG, Backbone(((0, 0, 0),), (0.5,))), "Backbone.s", ""),
    "points that fall together": (
        lambda: plan(LONG, Backbone(((0.1, 0, 0), (0.1, 0, 0)))),
        "Backbone.points",
        "",
    ),
    "points on the base alone": (lambda: plan(LONG, Backbone(((0, 0, 0),))), "points", "the base"),
    "a fetch by one section": (
        lambda: plan(ONE_SECTION, Fetch.reach((0, 0, 0)), PAPER, 1.0),
        "arm.sections",
        "",
    ),
    "a bend of a fetch beyond pi": (lambda: Fetch((4, 0), (1, 0), (1, 0)), "Fetch.proximal", ""),
    "least bend of pi": (lambda: Fetch.reach((0, 0, 0), np.pi), "FetchReach.bend", ""),
    "two tip positions": (
        lambda: plan(LONG, [TIP, TipPosition((0.2, 0.1, 0.0))], PAPER, 1.0),
        "targets[1]",
        "the only target that prescribes it",
    ),
    "planes by two sections": (
        lambda: plan(LONG, [BendingPlane(0, 1, 1), BendingPlane(1, 1, 2)], PAPER, 1.0),
        "targets[1]",
        "",
    ),
    "no target": (lambda: plan(LONG, [], PAPER, 1.0), "target", ""),
    "something else as a target": (lambda: plan(LONG, "up", PAPER, 1.0), "target", ""),
    "a kind of target": (lambda: plan(LONG, TipPosition, PAPER, 1.0), "target", ""),
    "an unknown norm": (
        lambda: plan(LONG, TIP, PAPER, 1.0, norm="3"),
        "norm",
        "",
    ),
    "no starts": (
        lambda: plan(LONG, TIP, PAPER, 1.0, starts=0),
        "starts",
        "",
    ),
    "an accuracy of 1": (lambda: plan(LONG, TIP, PAPER, 1.0, accuracy=1.0), "accuracy", ""),
    "as printed": (lambda: plan(LONG, TIP, Scene.as_printed(), 1.0), "scene", "settle takes it"),
    "a bend below 0": (lambda: BendingPlane(1.0, -1.0), "BendingPlane.bend", "up to pi"),
    "90 degrees of bend": (
        lambda: BendingPlane(1.0, 90.0),
        "BendingPlane.bend",
        "90 degrees are 1.5708",
    ),
    "60 degrees of a fetch": (
        lambda: Fetch(Bend(60.0, 0.0), Bend(1.0, 0.0), Bend(1.0, 0.0)),
        "Fetch.proximal",
        "60 degrees are 1.0472",
    ),
    "pointing in a plane": (lambda: TipPointing((0, 0), (1, 0, 0)), "TipPointing.position", ""),
    "pointing nowhere": (lambda: TipPointing((0, 0, 0), (0, 0, 0)), "TipPointing.direction", ""),
    "pointing to NaN": (
        lambda: TipPointing((0, 0, 0), (1, 0, np.nan)),
        "TipPointing.direction",
        "",
    ),
    "pointing for nothing": (
        lambda: TipPointing((0, 0, 0), (1, 0, 0), (1, 0)),
        "TipPointing.weights",
        "",
    ),
    "pointing by one weight": (
        lambda: TipPointing((0, 0, 0), (1, 0, 0), 3),
        "TipPointing.weights",
        "",
    ),
    "a pose against its place": (
        lambda: TipPose((0, 0, 0), np.eye(3), (-1, 1)),
        "TipPose.weights",
        "",
    ),
    **{
        f"a limit of {limit!r} s": (
            partial(plan, LONG, TIP, PAPER, 20.0, time_limit=limit),
            "time_limit",
            "",
        )
        for limit in (0, -1.0, float("nan"), float("inf"), "soon", True)
    },
    **{
        f"a margin of {margin}": (
            partial(plan, LONG, TIP, AIR, 20.0, stability_margin=margin),
            "stability_margin",
            "",
        )
        for margin in (-0.1, 1.5, np.nan, "much")
    },
    **{
        f"near {near!r:.9}": (partial(plan, LONG, TIP, PAPER, near=near), "near", "")
        for near in ("a plan", 1, np.zeros(12))
    },
    "near one of another arm": (lambda: plan(ARM, TIP, PAPER, near=PLAN), "near", ""),
    "near one of another scene": (lambda: plan(LONG, TIP, Scene(), near=PLAN), "near", ""),
    "a range of maxima": (lambda: plan(LONG, TIP, PAPER, range(3)), "tension_max", "12 numbers"),
    "stiffest and softest": (
        lambda: plan(LONG, [TIP, Stiffest((0, 0, 1)), Softest((0, 0, -1))], PAPER, 20.0),
        "targets[2]",
        "the only target that prescribes it",
    ),
    "a target of many": (
        lambda: plan_many(LONG, [TIP, "there"], PAPER),  # type: ignore[list-item]
        "targets[1]",
        "",
    ),
    "a section of many": (
        lambda: plan_many(LONG, [SEVENTH], PAPER, 20.0),
        "targets[0]: section",
        "",
    ),
    "errors skipped": (
        lambda: plan_many(LONG, [TIP], PAPER, 20.0, errors="skip"),  # type: ignore[arg-type]
        "errors",
        "",
    ),
    "whatever the target is": (
        lambda: plan_many(LONG, [TIP], PAPER, -1.0, errors="nan"),
        "tension_max",
        "",
    ),
    "a fetch dragged": (
        lambda: handle_of(LONG, (Fetch.reach((0.1, 0.0, -0.1)),)),
        "",
        "TipPosition, TipPose or BendingPlane",
    ),
}


def three_d() -> Any:
    return Figure().add_subplot(projection="3d")


def flat() -> Any:
    return Figure().add_subplot()


def film() -> FuncAnimation:
    """Return a rendered animation; matplotlib warns of animations that are never rendered."""
    motion = plot_motion([PLAN], ax := three_d(), frames=1)
    ax.figure.draw_without_rendering()
    return motion


FIGURES: Refused = {
    "a plan in flat axes": (lambda: plot_plan(PLAN, flat()), "", "3d"),
    "a plan in words": (lambda: plot_plan(PLAN, "axes"), "", "3d"),  # type: ignore[arg-type]
    "a shape in flat axes": (lambda: plot_shape(SHAPE, flat()), "", "3d"),
    "strains in space": (lambda: plot_strains(SHAPE, three_d()), "", "two-dimensional"),
    "a motion in flat axes": (lambda: plot_motion([PLAN], flat()), "", "3d"),
    "no motion": (lambda: plot_motion([]), "plans", "at least one Plan"),
    "a motion of shapes": (lambda: plot_motion([SHAPE]), "plans[0]", "a Plan"),  # type: ignore[list-item]
    "a figure of a shape as a plan": (lambda: plot_plan(SHAPE), "plan", "a Plan"),  # type: ignore[arg-type]
    "a figure of an arm as a shape": (lambda: plot_shape(ARM), "shape", "a Shape"),  # type: ignore[arg-type]
    "strains of an arm": (lambda: plot_strains(ARM), "shape", "a Shape"),  # type: ignore[arg-type]
    "ellipsoids of numbers": (lambda: plot_ellipsoids([1.0]), "result[0]", "a Stiffness"),  # type: ignore[list-item]
    "a plan from no file": (lambda: load_plan(None), "path", "the name of a file"),  # type: ignore[arg-type]
    "code into no folder": (lambda: export(ARM, PAPER, 3, SHAPE.tensions), "to", "file or folder"),  # type: ignore[arg-type]
    "a motion between scenes": (
        lambda: plot_motion([PLAN, changed(PLAN, scene=Scene())]),
        "plans[1]",
        "",
    ),
    "no frames": (lambda: plot_motion([PLAN], frames=0), "frames", ""),
    **{
        f"a film {name}": (
            lambda name=name: save_motion(film(), Path(name)),
            "path",
            "",
        )
        for name in ("arm.mp4", "nowhere/arm.gif")
    },
    **{
        f"a figure {name}": (partial(save, Figure(), Path(name)), "path", "")
        for name in ("arm.jpeg", "arm", "nowhere/arm.png")
    },
}
REFUSED = PLANS | FIGURES


@pytest.mark.filterwarnings("ignore:Animation was deleted")
@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_planned_or_drawn_is_refused_by_name(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)
