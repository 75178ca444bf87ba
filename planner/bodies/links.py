"""A settled arm as a chain of rigid links: for MuJoCo as MJCF, for ROS as URDF and messages."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from model.checks import kind, within
from model.effects import Weight
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from planner.bodies.surface import offsets
from planner.io.records import POINTS
from planner.measure import strokes

MOST_LINKS = 1000
# Of the rest shape, over the arm's length.
_ACCURACY = 1e-9
# Damping over stiffness of joints [s]: what swings is still after some of that.
_DAMPING = 0.05
# Mass of the tip, which has no extent, over that of the last link.
_TIP = 1e-3
# Of URDF: the root, and no displacement or rotation.
BASE = "base_link"
_NOT = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Chain:
    """N links between N + 1 nodes, evenly spaced on the midline at rest, and the tip's frame.

    Link i has its origin at node i and its x axis along the chord to the next; the last link, N, is
    the tip's frame, without extent. Link i + 1 hangs on link i by a slide along that chord and
    three hinges at its own origin, about its axes x, y, z in turn; link 0 on the base by hinges.

    Attributes
    ----------
    s : (N + 1,)
        Arc lengths of the nodes [m].
    chords : (N,)
        Distances of the nodes at rest [m].
    rest : (N + 1, 3, 3)
        Orientation of each link in the one before, at rest; of link 0 in the base frame.
    angles : (N + 1, 3)
        Of the hinges in the settled arm [rad].
    slides : (N,)
        Of the slides in the settled arm [m].
    radii, masses : (N,)
        Of the links [m], [kg].
    hinge_stiffness : (N + 1, 3)
        About x, y, z: G J_t / h, E J / h, E J / h [N m/rad].
    slide_stiffness : (N,)
        E A / h [N/m].
    passed : (n_tendons,)
        How many nodes each tendon passes.
    """

    s: Array
    chords: Array
    rest: Array
    angles: Array
    slides: Array
    radii: Array
    masses: Array
    hinge_stiffness: Array
    slide_stiffness: Array
    passed: NDArray[np.int64]

    @property
    def joints(self) -> dict[str, float]:
        """Positions of all joints in the settled arm [m], [rad], by name, from the base on."""
        moved = np.column_stack([np.append(0.0, self.slides), self.angles])
        names = [f"{kind}_{i}" for i in range(self.s.size) for kind in ("slide", "x", "y", "z")]
        # Link 0 hangs on the base by hinges alone.
        return dict(zip(names[1:], moved.ravel().tolist()[1:], strict=True))


def chain_of(shape: Shape, links: int) -> Chain:
    """Return the chain of so many links that follows a shape; InputError for none or too many."""
    kind("shape", shape, Shape, "a Shape, as settle returns it")
    within("links", links, 1, MOST_LINKS)
    arm = shape.arm
    s = np.linspace(0.0, arm.length, links + 1)
    at_rest = settle(arm, np.zeros(arm.n_tendons), Scene(), _ACCURACY)
    rest, chords = _relative(at_rest, s)
    now, lengths = _relative(shape, s)
    turned = Rotation.from_matrix(np.swapaxes(rest, 1, 2) @ now).as_euler("XYZ")
    h, radius = np.diff(s), arm.radius.evaluate(s, arm.length)[0]
    middle = arm.radius.evaluate((s[:-1] + s[1:]) / 2, arm.length)[0]
    masses = arm.material.density * np.pi * middle**2 * h
    # A hinge stands for half a link on either side.
    spans = (np.append(0.0, h) + np.append(h, 0.0)) / 2
    EJ, GJ = (k * np.pi * radius**4 / 4 for k in (arm.material.E, 2 * arm.material.G))
    hinges = np.stack([GJ, EJ, EJ], axis=1) / spans[:, None]
    slides = arm.material.E * np.pi * middle**2 / h
    ends = np.array([arm.sections[i].at for i, _ in arm.tendons])
    passed = np.searchsorted(s, ends * (1 + 1e-12), side="right")
    return Chain(s, chords, rest, turned, lengths - chords, middle, masses, hinges, slides, passed)


def _relative(shape: Shape, s: Array) -> tuple[Array, Array]:
    """Return the orientation of each link in the one before, and the distances of the nodes."""
    middle = (s[:-1] + s[1:]) / 2
    chords = np.diff(shape.position(s), axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    # By the least rotations that turn the x axes t along the chords: quaternions are scaled.
    frames, along = shape.frame(middle), chords / lengths[:, None]
    t = frames[:, :, 0]
    cosines = np.sum(t * along, axis=1)
    least = Rotation.from_quat(np.column_stack([np.cross(t, along), 1 + cosines]))
    frames = least.as_matrix() @ frames
    world = np.array([np.array(shape.arm.base_frame), *frames, shape.tip_frame])
    return np.swapaxes(world[:-1], 1, 2) @ world[1:], lengths


def mjcf(shape: Shape, links: int = 30, name: str = "arm") -> str:
    """Return a chain of links that follows a settled arm as an MJCF model.

    Its joints are springs with the arm's stiffness, at rest where the arm is; spatial tendons run
    through sites at the nodes, pulled by actuators whose controls are tensions [N]. The keyframe
    `settled` holds joints and controls of the shape. Gravity is the scene's; other loads, contact,
    friction and how exact tendons and rubber differ from springs are left out.

    Parameters
    ----------
    links : int
        1 to 1000.

    Raises
    ------
    InputError
        For another number of links.
    """
    chain, arm = chain_of(shape, links), shape.arm
    root = ET.Element("mujoco", model=name)
    _inside(root, "compiler", angle="radian", autolimits="true")
    weight = shape.scene.find(Weight)
    gravity = weight.g if weight is not None else (0.0, 0.0, 0.0)
    _inside(root, "option", gravity=gravity, integrator="implicitfast", timestep=1e-3)
    world, frame = _inside(root, "worldbody"), np.array(arm.base_frame)
    place = {"pos": arm.base_position, "quat": _quaternion(frame)}
    _bodies(_inside(world, "body", name="base", **place), chain, shape)
    _tendons(root, chain, shape)
    settled = {"qpos": list(chain.joints.values()), "ctrl": shape.tensions[chain.passed > 1]}
    _inside(_inside(root, "keyframe"), "key", name="settled", **settled)
    return _written(root)


def _bodies(base: ET.Element, chain: Chain, shape: Shape) -> None:
    body, last, across = base, chain.s.size - 1, offsets(shape.arm, chain.s)
    for i in range(chain.s.size):
        place = (chain.chords[i - 1] if i else 0.0, 0.0, 0.0)
        name = "tip" if i == last else f"link_{i}"
        body = _inside(body, "body", name=name, pos=place, quat=_quaternion(chain.rest[i]))
        if i:
            axis = chain.rest[i].T[:, 0]
            _joint(body, f"slide_{i}", "slide", axis, chain.slide_stiffness[i - 1])
        for axis, letter, k in zip(np.eye(3), "xyz", chain.hinge_stiffness[i], strict=True):
            _joint(body, f"{letter}_{i}", "hinge", axis, k)
        if i == last:
            inertia = chain.masses[-1] * chain.radii[-1] ** 2
            mass = {"mass": _TIP * chain.masses[-1], "diaginertia": [_TIP * inertia] * 3}
            _inside(body, "inertial", pos=(0, 0, 0), **mass)
            _inside(body, "site", name="tip", size=1e-3)
        else:
            ends = (0, 0, 0, chain.chords[i], 0, 0)
            look = {"rgba": "0.85 0.55 0.45 1", "contype": "0", "conaffinity": "0"}
            solid = {"type": "cylinder", "fromto": ends, "size": chain.radii[i]}
            _inside(body, "geom", mass=chain.masses[i], **solid, **look)
        # Sites where tendons pass the node, across the midline at rest.
        for j in np.flatnonzero(i < chain.passed).tolist():
            site = f"{shape.arm.tendon_name(j)}_{i}"
            _inside(body, "site", name=site, pos=(0.0, *across[j, i]), size=5e-4)


def _joint(body: ET.Element, name: str, kind: str, axis: Array, stiffness: float) -> None:
    spring = {"stiffness": stiffness, "damping": _DAMPING * stiffness}
    _inside(body, "joint", name=name, type=kind, axis=axis, **spring)


def _tendons(root: ET.Element, chain: Chain, shape: Shape) -> None:
    tendons, motors = _inside(root, "tendon"), _inside(root, "actuator")
    for j in range(shape.arm.n_tendons):
        name, count = shape.arm.tendon_name(j), int(chain.passed[j])
        if count > 1:
            path = _inside(tendons, "spatial", name=name, width=5e-4, rgba="0.2 0.3 0.8 1")
            for i in range(count):
                _inside(path, "site", site=f"{name}_{i}")
            _inside(motors, "motor", name=name, tendon=name, gear=-1)


def _quaternion(frame: Array) -> Array:
    return np.asarray(Rotation.from_matrix(frame).as_quat(scalar_first=True))


def urdf(shape: Shape, links: int = 30, name: str = "arm") -> str:
    """Return a chain of links that follows a settled arm as URDF.

    Its root is `base_link`, at the arm's base; joints are named slide_i, x_i, y_i, z_i, and their
    positions in the settled shape are in `ros_messages`, for robot_state_publisher. Links are named
    after the joints that they hang on; link_z_i has the body, the others between a slide and three
    hinges have no extent. link_z_N, N the number of links, is the tip's frame.

    Raises InputError for a number of links that is not 1 to 1000.
    """
    chain = chain_of(shape, links)
    root = ET.Element("robot", name=name)
    parent = _inside(root, "link", name=BASE)
    for i in range(links + 1):
        if i:
            place, along = (chain.chords[i - 1], 0, 0), (1, 0, 0)
            parent = _jointed(root, parent, f"slide_{i}", "prismatic", along, xyz=place)
        turned = Rotation.from_matrix(chain.rest[i]).as_euler("xyz")
        for letter, axis, rpy in zip("xyz", np.eye(3), [turned, _NOT, _NOT], strict=True):
            parent = _jointed(root, parent, f"{letter}_{i}", "revolute", axis, rpy=rpy)
        if i < links:
            _solid(parent, chain, i)
    return _written(root)


def _jointed(
    root: ET.Element,
    parent: ET.Element,
    joint: str,
    kind: str,
    axis: Any,
    xyz: Any = _NOT,
    rpy: Any = _NOT,
) -> ET.Element:
    """Hang a link on another by a joint; return it."""
    child = f"link_{joint}"
    values = _inside(root, "joint", name=joint, type=kind)
    _inside(values, "parent", link=parent.get("name"))
    _inside(values, "child", link=child)
    _inside(values, "origin", xyz=xyz, rpy=rpy)
    _inside(values, "axis", xyz=axis)
    most = 1.0 if kind == "prismatic" else np.pi
    _inside(values, "limit", lower=-most, upper=most, effort=1000, velocity=1000)
    return _inside(root, "link", name=child)


def _solid(link: ET.Element, chain: Chain, i: int) -> None:
    """Give a link its body and mass."""
    length, radius, mass = (float(x[i]) for x in (chain.chords, chain.radii, chain.masses))
    # Cylinders stand along z; the link's own axis is x.
    place = {"xyz": (length / 2, 0, 0), "rpy": (0, np.pi / 2, 0)}
    for tag in ("visual", "collision"):
        values = _inside(link, tag)
        _inside(values, "origin", **place)
        _inside(_inside(values, "geometry"), "cylinder", radius=radius, length=length)
    values = _inside(link, "inertial")
    _inside(values, "origin", **place)
    _inside(values, "mass", value=mass)
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    off = {"ixy": 0, "ixz": 0, "iyz": 0}
    _inside(values, "inertia", ixx=across, iyy=across, izz=along, **off)


def ros_messages(shape: Shape, links: int = 30) -> dict[str, Any]:
    """Return a settled arm as ROS messages, as JSON has them (rosbridge, `ros2 topic pub`).

    `tendons` is a sensor_msgs/JointState of strokes [m] and tensions [N], `chain` one of the joints
    of `urdf`, `path` a nav_msgs/Path of the frames along the midline as the base sees them, their x
    axes along the arm.
    """
    joints, arm = chain_of(shape, links).joints, shape.arm
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


# Elements of XML


def _inside(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Return a new element inside another; numbers are written in full, lists with blanks."""
    return ET.SubElement(parent, tag, {key: _text(value) for key, value in attributes.items()})


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    return " ".join(f"{float(x):.15g}" for x in np.ravel(np.asarray(value, dtype=float)))


def _written(root: ET.Element) -> str:
    """Return a document as text, indented."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
