"""Write files of a settled arm for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from octoplan.model.effects import NeoHookean
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind, whole
from octoplan.model.support.errors import InputError, needed
from octoplan.planner.frontends.bodies.links import ros_messages, urdf
from octoplan.planner.frontends.bodies.mjcf import mjcf
from octoplan.planner.frontends.bodies.surface import surface
from octoplan.planner.frontends.io.files import atomic_write, path_of, to_json, write_together

MESHES = (".stl", ".glb", ".ply", ".obj")
What = Literal["mesh", "mjcf", "urdf"]
KINDS = get_args(What)


def save_mesh(shape: Shape, path: str | Path, along: int = 200, around: int = 32) -> Path:
    """Write the surface of a settled arm to a .stl, .glb (glTF), .ply or .obj file, in metres.

    The surface is closed; the file is written atomically.

    Parameters
    ----------
    along, around : int
        Rings along the arm, 2 to 10000, and points in each, 3 to 1000.

    Raises
    ------
    InputError
        For another suffix, a file that cannot be written, and numbers out of range.
    MissingExtraError
        If trimesh is not installed, which is in the extra `mesh`.
    """
    along = whole("along", along, 2, 10_000)
    around = whole("around", around, 3, 1000)
    path = path_of(path)
    with atomic_write(path, *MESHES) as part:
        part.write_bytes(_mesh(shape, path.suffix.lower(), along, around))
    return path


def export_shape(
    shape: Shape, to: str | Path, what: What, name: str = "arm", links: int = 30
) -> tuple[Path, ...]:
    """Write a settled arm for other programs into a folder; return the files.

    Parameters
    ----------
    shape : Shape
    to : path
        The folder.
    what : "mesh", "mjcf" or "urdf"
        NAME.stl and NAME.glb, see save_mesh; NAME.xml, see mjcf; or NAME.urdf and NAME.ros.json,
        see urdf and ros_messages.
    name : str
        Name of the files without suffix.
    links : int
        Number of links of a chain.

    Raises
    ------
    InputError
        For invalid arguments, and files that cannot be written; for MJCF of a scene with
        unsupported loads, see mjcf.
    MissingExtraError
        If trimesh is not installed, for a mesh.

    Warns
    -----
    ExportWarning
        For loads that a file lacks, see mjcf and urdf; a mesh has no loads.
    """
    if what == "mesh":
        kinds = ".stl", ".glb"
        contents = {f"{name}{suffix}": _mesh(shape, suffix, 200, 32) for suffix in kinds}
    elif what == "mjcf":
        contents = {f"{name}.xml": mjcf(shape, links, name).encode()}
    elif what == "urdf":
        contents = {f"{name}.urdf": urdf(shape, links, name).encode()}
        contents[f"{name}.ros.json"] = to_json(ros_messages(shape, links))
    else:
        raise InputError("what", what, ", ".join(KINDS))
    folder = path_of(to, "to")
    write_together(folder, contents)
    return tuple(folder / file for file in contents)


def _mesh(shape: Shape, suffix: str, along: int, around: int) -> bytes:
    kind("shape", shape, Shape, "a Shape, as settle returns it")
    trimesh = needed("trimesh", "mesh")
    s = np.linspace(0.0, shape.arm.length, along)
    swelling = None
    if shape.scene.has(NeoHookean):
        # A cross-section of constant volume grows as the arm is compressed.
        swelling = 1 / np.sqrt(1 + shape.strain(s)[:, 3])
    vertices, faces = surface(shape.arm, s, shape.poses(s), around, swelling)
    mesh: Any = trimesh.Trimesh(vertices, faces, process=False)
    content = mesh.export(file_type=suffix[1:])
    return content.encode() if isinstance(content, str) else bytes(content)
