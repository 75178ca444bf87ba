"""Answers handed out: on stdout, and as files in a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

from planner.commands.command import FIGURES, Answer
from planner.commands.output import say
from planner.io.files import to_json, write_together


def deliver(answer: Answer, args: argparse.Namespace) -> None:
    """Write the files that --out asks for, then what --json or people are shown."""
    if getattr(args, "out", None):
        _write(args.out, answer, getattr(args, "figure", None) or FIGURES[0])
    shown = to_json(answer.record).decode() if getattr(args, "json", False) else answer.text()
    say(shown + "\n")


def _write(folder: Path, answer: Answer, kind: str) -> None:
    """Write data and figure into a folder: all of them, or on an error none."""
    from planner.plots.plan import drawn

    files = dict(answer.tables)
    files[f"{answer.name}.json"] = to_json(answer.record)
    if answer.draw is not None:
        files[f"{answer.name}.{kind}"] = drawn(answer.draw(), kind)
    write_together(folder, files)
