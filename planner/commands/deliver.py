"""Answers handed out: on stdout, and as files in a folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from model import InputError
from planner.commands.command import Answer
from planner.files import to_json, write_whole


def deliver(answer: Answer, args: argparse.Namespace) -> None:
    """Write the files that --out asks for, then what --json or people are shown."""
    if getattr(args, "out", None):
        _write(args.out, answer, args.figure)
    shown = to_json(answer.record).decode() if getattr(args, "json", False) else answer.text()
    sys.stdout.write(shown + "\n")
    sys.stdout.flush()


def _write(folder: Path, answer: Answer, kind: str) -> None:
    """Write data and figure into a folder, each whole or not at all."""
    from planner.plots.plan import save

    try:
        folder.mkdir(parents=True, exist_ok=True)
        if answer.draw is not None:
            save(answer.draw(), folder / f"{answer.name}.{kind}")
        for suffix, content in answer.tables.items():
            write_whole(folder / f"{answer.name}{suffix}", content)
        write_whole(folder / f"{answer.name}.json", to_json(answer.record))
    except OSError as reason:
        told = (reason.strerror or str(reason)).lower()
        raise InputError("--out", str(folder), f"a folder to write to: {told}") from None
