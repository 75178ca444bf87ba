"""octoplan effects: which effects matter to a scene's shape, and what they cost."""

from __future__ import annotations

import argparse
from typing import Any

from planner.commands.command import (
    OK,
    Answer,
    Command,
    add_scene_options,
    question,
    tensions_of,
)
from planner.effect_ablation import Switch, switch_effects
from planner.io.records import effects_record
from planner.report import switch_table


def run(args: argparse.Namespace) -> Answer:
    """Settle the scene with each effect switched in turn."""
    asked, accuracy = question(args)
    switches = switch_effects(asked.arm, tensions_of(asked, args.scene), asked.scene, accuracy)
    return Answer(
        OK,
        lambda: switch_table(switches, accuracy),
        effects_record(switches, accuracy),
        "effects",
        lambda: _draw(switches, accuracy),
    )


def _draw(switches: tuple[Switch, ...], accuracy: float) -> Any:
    from planner.plots.effects import plot_effects

    return plot_effects(switches, accuracy)


COMMAND = Command(
    "effects",
    "tell which effects matter to the scene's shape, and what they cost",
    add_scene_options,
    run,
)
