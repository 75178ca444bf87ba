"""octoplan effects: which effects matter to a scene's shape, and what they cost."""

from __future__ import annotations

from typing import Any

from planner.commands.answer import OK, Answer
from planner.commands.options import Accuracy, FileOptions, SceneFile, tensions_of
from planner.effect_ablation import Switch, switch_effects
from planner.io.records import effects_record
from planner.report import switch_table


def effects(
    scene: SceneFile, /, *, accuracy: Accuracy | None = None, options: FileOptions | None = None
) -> Answer:
    """Settle the scene with each effect switched in turn."""
    question = (options or FileOptions()).loaded(scene, accuracy)
    accuracy, tensions = question.accuracy, tensions_of(question, scene)
    switches = switch_effects(question.arm, tensions, question.scene, accuracy)
    return Answer(
        OK,
        lambda: switch_table(switches, accuracy),
        effects_record(switches, accuracy),
        "effects",
        lambda: _draw(switches, accuracy),
    )


def _draw(switches: tuple[Switch, ...], accuracy: float) -> Any:
    from planner.plots.results import plot_effects

    return plot_effects(switches, accuracy)
