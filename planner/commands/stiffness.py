"""octoplan stiffness: how the shape under a scene's tensions answers to a small force."""

from __future__ import annotations

from typing import Any

from model.stiffness import Stiffness
from model.stiffness import stiffness as find
from planner.commands.answer import OK, Answer
from planner.commands.options import SceneFile, SceneOptions, held
from planner.io.records import stiffness_record
from planner.notebook import force_to_show


def stiffness(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find the compliance that the scene's [stiffness] table asks for."""
    options = options or SceneOptions()
    question = options.asked(scene)
    given = {**question.stiffness, "compile": question.compile, **held(question, scene)}
    k = find(question.arm, scene=question.scene, accuracy=question.accuracy, **given)
    return Answer(OK, lambda: repr(k), stiffness_record(k), "stiffness", lambda: _draw(k))


def _draw(k: Stiffness) -> Any:
    from planner.plots.results import plot_ellipsoids

    return plot_ellipsoids([k], force_to_show(k))
