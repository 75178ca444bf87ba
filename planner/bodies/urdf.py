"""A settled arm for ROS: links and joints as URDF, and its messages as JSON."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from model.shape import Shape
from planner.bodies.chain import Chain, chain_of
from planner.bodies.markup import inside, written
from planner.io.records import POINTS
from planner.measure import strokes

BASE = "base_link"
_NOT = (0.0, 0.0, 0.0)


def urdf(shape: Shape, links: int = 30, name: str = "arm") -> str:
    """Return a chain of links that follows a settled arm as URDF.

    Its root is `base_link`, at the arm's base; joints are named slide_i, x_i, y_i, z_i, and their
    positions in the settled shape are in `ros_messages`, for robot_state_publisher. Links are named
    after the joints that they hang on; link_z_i has the body, the others between a slide and three
    hinges have no extent. link_z_N, N the number of links, is the tip's frame.

    Raises InputError for a number of links that is not 1 to 1000.
    """
    chain = chain_of(shape, links)
    root, parent = ET.Element("robot", name=name), BASE
    inside(root, "link", name=BASE)
    for i in range(links + 1):
        if i:
            place, along = (chain.chords[i - 1], 0, 0), (1, 0, 0)
            parent = _jointed(root, parent, f"slide_{i}", "prismatic", along, xyz=place)
        turned = Rotation.from_matrix(chain.rest[i]).as_euler("xyz")
        for letter, axis, rpy in zip("xyz", np.eye(3), [turned, _NOT, _NOT], strict=True):
            parent = _jointed(root, parent, f"{letter}_{i}", "revolute", axis, rpy=rpy)
        if i < links:
            _solid(root, parent, chain, i)
    return written(root)


def _jointed(
    root: ET.Element,
    parent: str,
    joint: str,
    kind: str,
    axis: Any,
    xyz: Any = _NOT,
    rpy: Any = _NOT,
) -> str:
    """Hang a link on another by a joint; return its name."""
    child = f"link_{joint}"
    values = inside(root, "joint", name=joint, type=kind)
    inside(values, "parent", link=parent)
    inside(values, "child", link=child)
    inside(values, "origin", xyz=xyz, rpy=rpy)
    inside(values, "axis", xyz=axis)
    most = 1.0 if kind == "prismatic" else np.pi
    inside(values, "limit", lower=-most, upper=most, effort=1000, velocity=1000)
    inside(root, "link", name=child)
    return child


def _solid(root: ET.Element, name: str, chain: Chain, i: int) -> None:
    """Give a link its body and mass."""
    link = next(each for each in root if each.tag == "link" and each.get("name") == name)
    length, radius, mass = (float(x[i]) for x in (chain.chords, chain.radii, chain.masses))
    # Cylinders stand along z; the link's own axis is x.
    place = {"xyz": (length / 2, 0, 0), "rpy": (0, np.pi / 2, 0)}
    for tag in ("visual", "collision"):
        values = inside(link, tag)
        inside(values, "origin", **place)
        inside(inside(values, "geometry"), "cylinder", radius=radius, length=length)
    values = inside(link, "inertial")
    inside(values, "origin", **place)
    inside(values, "mass", value=mass)
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    off = {"ixy": 0, "ixz": 0, "iyz": 0}
    inside(values, "inertia", ixx=across, iyy=across, izz=along, **off)


def ros_messages(shape: Shape, links: int = 30) -> dict[str, Any]:
    """Return a settled arm as ROS messages, as JSON has them (rosbridge, `ros2 topic pub`).

    `tendons` is a sensor_msgs/JointState of strokes [m] and tensions [N], `chain` one of the joints
    of `urdf`, `path` a nav_msgs/Path of the frames along the midline as the base sees them, their x
    axes along the arm.
    """
    arm, chain = shape.arm, chain_of(shape, links)
    joints: dict[str, float] = {}
    for i in range(chain.s.size):
        if i:
            joints[f"slide_{i}"] = float(chain.slides[i - 1])
        angles = zip("xyz", chain.angles[i], strict=True)
        joints |= {f"{letter}_{i}": float(angle) for letter, angle in angles}
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": BASE}
    # The frames along the midline, as the base sees them.
    base, s = np.array(arm.base_frame), np.linspace(0.0, arm.length, POINTS)
    places = (shape.position(s) - np.array(arm.base_position)) @ base
    turned = Rotation.from_matrix(base.T @ shape.frame(s)).as_quat()
    poses = [
        {
            "position": dict(zip("xyz", place, strict=True)),
            "orientation": dict(zip("xyzw", quaternion, strict=True)),
        }
        for place, quaternion in zip(places.tolist(), turned.tolist(), strict=True)
    ]
    return {
        "tendons": {
            "header": header,
            "name": arm.tendon_names,
            "position": strokes(shape).tolist(),
            "velocity": [],
            "effort": shape.tensions.tolist(),
        },
        "chain": {
            "header": header,
            "name": list(joints),
            "position": list(joints.values()),
            "velocity": [],
            "effort": [],
        },
        "path": {
            "header": header,
            "poses": [{"header": header, "pose": pose} for pose in poses],
        },
    }
