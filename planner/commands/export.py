"""octoplan export: the scene's forward map or its inverse as C; its arm for other programs."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from model import settle
from planner.bodies.files import KINDS, export_shape
from planner.c_code.export import TAKEN, Exported, export, export_plan
from planner.c_code.source import PRECISIONS
from planner.commands.command import (
    OK,
    Answer,
    Command,
    accuracy,
    add_time_limit,
    held_of,
    loaded,
    tensions_of,
)
from planner.commands.plan import check_asked
from planner.io.records import export_record
from planner.io.scene_file import Question
from planner.plan import plan

# Of the plan that an inverse begins from, where its code is to be less accurate.
_PLANNED = 1e-6


def add(parser: argparse.ArgumentParser) -> None:
    """Add the scene, the folder, what is written, and the precision."""
    parser.add_argument("scene", type=Path, metavar="SCENE.toml", help="scene file")
    parser.add_argument("--to", type=Path, metavar="DIR", required=True, help="folder to write to")
    parser.add_argument(
        "--what",
        choices=("map", "plan", *KINDS),
        default="map",
        help="as C: tensions to shape (map), a moving tip target to tensions besides (plan); the "
        "settled arm as STL and glTF (mesh), for MuJoCo (mjcf), as URDF and ROS messages (urdf)",
    )
    parser.add_argument(
        "--links", type=int, default=30, metavar="N", help="of the chain of mjcf and urdf (30)"
    )
    parser.add_argument("--precision", default="double", help=f"{' or '.join(PRECISIONS)} (double)")
    parser.add_argument("--json", action="store_true", help="print JSON, in SI units")
    add_time_limit(parser)
    parser.add_argument(
        "--accuracy",
        type=accuracy,
        metavar="X",
        help="tip error over arm length; else the scene's",
    )


def run(args: argparse.Namespace) -> Answer:
    """Write the scene's map or inverse, or its settled arm for other programs."""
    asked = loaded(args)
    wanted = asked.accuracy if args.accuracy is None else args.accuracy
    if args.what in KINDS:
        return _bodies(asked, wanted, args)
    write = _map if args.what == "map" else _inverse
    found = write(asked, wanted, args)
    return Answer(
        OK,
        lambda: _text(found, args.to),
        export_record(found.files, found.shape, found.static_bytes),
        c_name(args.scene),
    )


def _bodies(asked: Question, wanted: float, args: argparse.Namespace) -> Answer:
    """Write the arm as it settles under the scene's tensions, by its lengths, or by its plan."""
    if asked.tensions is None and not asked.winches and asked.targets:
        check_asked(asked, args.scene)
        options = {**asked.options, "time_limit": args.time_limit, "compile": asked.compile}
        shape = plan(asked.arm, asked.targets, asked.scene, accuracy=wanted, **options).shape
    else:
        held = held_of(asked, args.scene)
        options = {"accuracy": wanted, "compile": asked.compile, **held}
        shape = settle(asked.arm, scene=asked.scene, **options)
    name = c_name(args.scene)
    files = export_shape(shape, args.to, args.what, name, args.links)
    record = export_record(files, shape)
    told = f"{', '.join(file.name for file in files)} in {args.to}"
    return Answer(OK, lambda: told, record, name)


def _map(asked: Question, wanted: float, args: argparse.Namespace) -> Exported:
    tensions, name = tensions_of(asked, args.scene), c_name(args.scene)
    return export(asked.arm, asked.scene, args.to, tensions, wanted, args.precision, name)


def _inverse(asked: Question, wanted: float, args: argparse.Namespace) -> Exported:
    check_asked(asked, args.scene)
    options = {**asked.options, "time_limit": args.time_limit, "compile": asked.compile}
    planned = min(wanted, _PLANNED)
    found = plan(asked.arm, asked.targets, asked.scene, accuracy=planned, **options)
    return export_plan(found, args.to, wanted, args.precision, c_name(args.scene))


def _text(found: Exported, to: Path) -> str:
    return (
        f"{', '.join(file.name for file in found.files)} in {to}\n"
        f"  {found.shape.s.size} nodes, tip error {found.shape.error:.1e} of the length at the "
        f"tensions of the scene or its plan, work arrays {found.static_bytes} bytes\n"
        f"  check them: make -C {to} check"
    )


def c_name(scene: Path) -> str:
    """Return a name for C made from that of a scene file: fetch-3d.toml gives fetch_3d."""
    name = re.sub(r"[\W_]+", "_", scene.stem, flags=re.ASCII).strip("_")
    return name if name[:1].isalpha() and name.lower() not in TAKEN else f"arm_{name}".strip("_")


COMMAND = Command(
    "export",
    "write the map from tensions to shape or its inverse as C, or the settled arm as mesh or links",
    add,
    run,
)
