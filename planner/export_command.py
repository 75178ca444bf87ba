"""The command `octoplan export SCENE.toml --to DIR`: the scene's forward map as C."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

from model import InputError
from planner.c_code import PRECISIONS
from planner.export import export
from planner.report import to_json
from planner.scenefile import Question


def add_to(commands: Any) -> None:
    """Add the command to the subparsers of a command line."""
    text = "write the map from tensions to shape, and the tip's Jacobian, as C for small machines"
    sub = commands.add_parser("export", help=text, description=text)
    sub.add_argument("scene", type=Path, help="scene file (TOML)")
    sub.add_argument("--to", type=Path, metavar="DIR", required=True, help="folder to write to")
    sub.add_argument("--precision", default="double", help=f"{' or '.join(PRECISIONS)} (double)")
    sub.add_argument("--json", action="store_true", help="print JSON, in SI units")
    sub.add_argument("--accuracy", type=float, help="tip error over arm length; else the scene's")
    sub.set_defaults(command=_export)


def _export(question: Question, args: argparse.Namespace) -> int:
    if question.tensions is None:
        raise InputError(
            "tensions",
            "none",
            "tensions = [[...], ...] in N in the scene file: those that bend "
            "the arm most, for which the mesh is chosen",
        )
    accuracy = question.accuracy if args.accuracy is None else args.accuracy
    name = c_name(args.scene)
    found = export(
        question.arm, question.scene, args.to, question.tensions, accuracy, args.precision, name
    )
    values = {
        "files": [str(file) for file in found.files],
        "nodes": found.shape.s.size,
        "error": found.shape.error,
        "static_bytes": found.static_bytes,
    }
    if args.json:
        text = to_json(values).decode()
    else:
        text = (
            f"{', '.join(file.name for file in found.files)} in {args.to}\n"
            f"  {values['nodes']} nodes, tip error {values['error']:.1e} of the length at the "
            f"scene's tensions, work arrays {values['static_bytes']} bytes\n"
            f"  check them: make -C {args.to} check"
        )
    sys.stdout.write(text + "\n")
    return 0


def c_name(scene: Path) -> str:
    """Return a name for C made from that of a scene file: fetch-3d.toml gives fetch_3d."""
    name = re.sub(r"\W", "_", scene.stem, flags=re.ASCII)
    return name if name[:1].isalpha() else f"arm_{name}"
