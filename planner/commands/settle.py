"""octoplan settle: the shape under a scene's tensions, or by its tendons' lengths."""

from __future__ import annotations

from typing import Any

from model import Shape
from model import settle as find
from planner.commands.answer import OK, Answer
from planner.commands.options import SceneFile, SceneOptions, held
from planner.io.csv_files import shape_csv
from planner.io.records import shape_record
from planner.report import settled_text


def settle(scene: SceneFile, /, *, options: SceneOptions | None = None) -> Answer:
    """Find the shape under the scene's tensions or lengths."""
    options = options or SceneOptions()
    question = options.asked(scene)
    given = {"accuracy": question.accuracy, "compile": question.compile, **held(question, scene)}
    shape = find(question.arm, scene=question.scene, **given)
    return Answer(
        OK,
        lambda: settled_text(shape),
        shape_record(shape),
        "shape",
        lambda: _draw(shape),
        {"shape.csv": lambda: shape_csv(shape)},
    )


def _draw(shape: Shape) -> Any:
    from planner.plots.plan import plot_shape

    return plot_shape(shape)
