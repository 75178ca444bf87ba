"""The command line: `octoplan plan SCENE.toml`, `octoplan settle SCENE.toml`, `octoplan effects`,
`octoplan export`.

Exit codes: 0 certified (or settled), 1 not reached or not certified, 2 bad input.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from model import InputError, OctoplanError, settle, switch_effects
from planner import export_command
from planner.plan import plan
from planner.report import (
    plan_dict,
    plan_text,
    shape_dict,
    shape_text,
    switch_table,
    switches_dict,
    to_json,
    write_whole,
)
from planner.scenefile import Question, load

OK, NOT_REACHED, BAD_INPUT = 0, 1, 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    args = _parser().parse_args(argv)
    command: Callable[[Question, argparse.Namespace], int] = args.command
    try:
        return command(load(args.scene), args)
    except InputError as reason:
        print(f"octoplan: {reason}", file=sys.stderr)
        return BAD_INPUT
    except OctoplanError as reason:
        print(f"octoplan: {reason}", file=sys.stderr)
        return NOT_REACHED
    except BrokenPipeError:
        sys.stderr.close()
        return NOT_REACHED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="octoplan",
        description="Which tendons to pull, and how hard, so that a soft arm takes a shape.",
        epilog="exit codes: 0 certified or settled, 1 not reached, 2 bad input",
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, command, text in (
        ("plan", _plan, "find the tensions of least effort for the scene's target"),
        ("settle", _settle, "find the shape under the scene's tensions"),
        ("effects", _effects, "tell which effects matter to the scene's shape, and what they cost"),
    ):
        sub = commands.add_parser(name, help=text, description=text)
        sub.add_argument("scene", type=Path, help="scene file (TOML)")
        sub.add_argument("--json", action="store_true", help="print JSON, in SI units")
        sub.add_argument(
            "--out", type=Path, metavar="DIR", help="also write result and figure there"
        )
        sub.add_argument(
            "--accuracy", type=float, help="tip error over arm length; else the scene's"
        )
        sub.set_defaults(command=command)
    export_command.add_to(commands)
    return parser


def _plan(question: Question, args: argparse.Namespace) -> int:
    if not question.targets:
        raise InputError("target", "none", "a [target] table, or [[targets]], in the scene file")
    if "tension_max" not in question.options:
        raise InputError("limits", "none", "a [limits] table with tension_max in the scene file")
    accuracy = _accuracy(question, args)
    arm, scene = question.arm, question.scene
    found = plan(arm, question.targets, scene, accuracy=accuracy, **question.options)
    values = plan_dict(found)
    if args.out:
        from planner.plot import plot_plan

        _write(args.out, "plan", to_json(values), lambda: plot_plan(found))
    _show(to_json(values).decode() if args.json else plan_text(found))
    return OK if found.certificate.passed else NOT_REACHED


def _settle(question: Question, args: argparse.Namespace) -> int:
    accuracy = _accuracy(question, args)
    shape = settle(question.arm, _tensions(question), question.scene, accuracy)
    values = shape_dict(shape)
    if args.out:
        from planner.plot import plot_shape

        _write(args.out, "shape", to_json(values), lambda: plot_shape(shape))
    _show(to_json(values).decode() if args.json else shape_text(shape))
    return OK


def _effects(question: Question, args: argparse.Namespace) -> int:
    accuracy = _accuracy(question, args)
    switches = switch_effects(question.arm, _tensions(question), question.scene, accuracy)
    values = switches_dict(switches)
    if args.out:
        from planner.plot_effects import plot_effects

        _write(args.out, "effects", to_json(values), lambda: plot_effects(switches, accuracy))
    _show(to_json(values).decode() if args.json else switch_table(switches, accuracy))
    return OK


def _accuracy(question: Question, args: argparse.Namespace) -> float:
    return question.accuracy if args.accuracy is None else float(args.accuracy)


def _tensions(question: Question) -> Any:
    if question.tensions is None:
        raise InputError("tensions", "none", "tensions = [[...], ...] in N in the scene file")
    return question.tensions


def _show(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _write(folder: Path, name: str, content: bytes, draw: Callable[[], Any]) -> None:
    """Write the result and its figure into a folder, each whole or not at all."""
    from planner.plot import save

    try:
        folder.mkdir(parents=True, exist_ok=True)
        save(draw(), folder / f"{name}.png")
        write_whole(folder / f"{name}.json", content)
    except OSError as reason:
        raise InputError("--out", str(folder), f"a folder to write to: {reason.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
