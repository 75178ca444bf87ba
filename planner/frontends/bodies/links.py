"""A settled arm as a chain of rigid links, and as URDF and messages for ROS."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model.arm import Arm
from octoplan.model.effects import NeoHookean
from octoplan.model.mesh import volume
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind, whole
from octoplan.model.tendons import strokes
from octoplan.planner.frontends.bodies.forces import Bodies, left_out_of_urdf, point_masses, warn_of
from octoplan.planner.frontends.bodies.xml import child_of, remark, to_text
from octoplan.planner.frontends.io.records import POINTS

MOST_LINKS = 1000
# Accuracy of the shape at rest, over the arm length.
_ACCURACY = 1e-9
# Name of the root link of URDF.
BASE = "base_link"
# No displacement or rotation.
_NOT = (0.0, 0.0, 0.0)
_NO_PRODUCTS = {"ixy": 0, "ixz": 0, "iyz": 0}


@dataclass(frozen=True, eq=False)
class Chain:
    """N links between N + 1 nodes, evenly spaced on the midline at rest, and the frame of the tip.

    Link i has the origin at node i and the x axis along the chord to the next node; the last link,
    N, is the frame of the tip, without extent. A slide along the chord and three hinges at the
    origin of link i + 1, about axes x, y, z in this order, connect links i and i + 1; hinges only
    connect link 0 to the base.

    Attributes
    ----------
    s : (N + 1,)
        Arc lengths of the nodes [m].
    chords : (N,)
        Distances between nodes at rest [m].
    rest : (N + 1, 3, 3)
        Orientation of each link in the one before, at rest; of link 0 in the base frame.
    angles : (N + 1, 3)
        Hinge angles of the settled arm [rad].
    slides : (N,)
        Slide positions of the settled arm [m].
    radii, masses : (N,)
        Radii [m] and masses [kg] of the links.
    inertias : (N, 3)
        Moments of inertia of the links about x, y, z through their middles [kg m2].
    hinge_stiffness : (N + 1, 3)
        About x, y, z: G J_t / h, E J / h, E J / h [N m/rad], at the settled stretch if neo-Hookean.
    slide_stiffness : (N,)
        E A / h [N/m], at the settled stretch if neo-Hookean.
    bodies : Bodies
        Links and tip at the settled shape.
    """

    s: Array
    chords: Array
    rest: Array
    angles: Array
    slides: Array
    radii: Array
    masses: Array
    inertias: Array
    hinge_stiffness: Array
    slide_stiffness: Array
    bodies: Bodies

    @property
    def moved(self) -> Array:
        """Positions (N + 1, 4) of slide [m] and hinges [rad] of each body in the settled arm."""
        return np.column_stack([np.append(0.0, self.slides), self.angles])

    @property
    def stiffness(self) -> Array:
        """Stiffness (N + 1, 4) of slide and hinges of each body; inf for the slide of link 0."""
        return np.column_stack([np.append(np.inf, self.slide_stiffness), self.hinge_stiffness])

    @property
    def joints(self) -> dict[str, float]:
        """Positions of all joints in the settled arm [m], [rad], by name, from base to tip."""
        names = [f"{kind}_{i}" for i in range(self.s.size) for kind in ("slide", "x", "y", "z")]
        # Link 0 has no slide.
        return dict(zip(names[1:], self.moved.ravel().tolist()[1:], strict=True))


def build_chain(shape: Shape, links: int) -> Chain:
    """Return the chain of a number of links that follows a shape; raise InputError if invalid."""
    kind("shape", shape, Shape, "a Shape, as settle returns it")
    links = whole("links", links, 1, MOST_LINKS)
    arm = shape.arm
    s = np.linspace(0.0, arm.length, links + 1)
    at_rest = settle(arm, np.zeros(arm.n_tendons), Scene(), _ACCURACY)
    rest, chords, _ = _relative(at_rest, s)
    now, lengths, frames = _relative(shape, s)
    turned = Rotation.from_matrix(np.swapaxes(rest, 1, 2) @ now).as_euler("XYZ")
    h = np.diff(s)
    middle = (s[:-1] + s[1:]) / 2
    middle_radius = arm.radius.evaluate(middle, arm.length)[0]
    masses = -arm.material.density * np.diff(volume(arm, s))
    inertias = masses[:, None] * _inertia_per_mass(arm, middle, chords)
    # A hinge replaces the compliance of half a link on either side.
    spans = (np.append(0.0, h) + np.append(h, 0.0)) / 2
    _, EJn, EJb, GI = arm.section_stiffness(s)[0]
    hinges = np.stack([GI, EJn, EJb], axis=1)
    EA = arm.section_stiffness(middle)[0, 0]
    if shape.scene.has(NeoHookean):
        stretch = 1 + shape.strain(s)[:, 3]
        middle_stretch = 1 + shape.strain(middle)[:, 3]
        bending = (1 + 2 / stretch**3) / (3 * stretch)
        hinges = hinges * np.column_stack([1 / stretch, bending, bending])
        EA = EA * (1 + 2 / middle_stretch**3) / 3
    hinges = hinges / spans[:, None]
    return Chain(
        s,
        chords,
        rest,
        turned,
        lengths - chords,
        middle_radius,
        masses,
        inertias,
        hinges,
        EA / h,
        Bodies(s, shape.position(s), frames),
    )


def _inertia_per_mass(arm: Arm, s: Array, lengths: Array) -> Array:
    """Return moments of inertia over the mass (N, 3) about x, y, z of prismatic links [m2].

    Squared radii of gyration are J / A = E J / E A, and those of a circle for bodies that are given
    by their stiffness.
    """
    EA, EJn, EJb, _ = arm.section_stiffness(s)[0]
    circle = arm.radius.evaluate(s, arm.length)[0] ** 2 / 4
    is_known = arm.profile.is_of_material
    about_n, about_b = (EJn / EA, EJb / EA) if is_known else (circle, circle)
    along = lengths**2 / 12
    return np.stack([about_n + about_b, about_n + along, about_b + along], axis=1)


def _relative(shape: Shape, s: Array) -> tuple[Array, Array, Array]:
    """Return orientations relative to the link before, distances of nodes, and frames."""
    middle = (s[:-1] + s[1:]) / 2
    chords = np.diff(shape.position(s), axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    # Rotate the frames by the smallest rotation from t to the chord; SciPy normalises quaternions.
    frames = shape.frame(middle)
    along = chords / lengths[:, None]
    t = frames[:, :, 0]
    cosines = np.sum(t * along, axis=1)
    least = Rotation.from_quat(np.column_stack([np.cross(t, along), 1 + cosines]))
    frames = least.as_matrix() @ frames
    world = np.array([np.array(shape.arm.base_frame), *frames, shape.tip_frame])
    return np.swapaxes(world[:-1], 1, 2) @ world[1:], lengths, world[1:]


def urdf(shape: Shape, links: int = 30, name: str = "arm") -> str:
    """Return a settled arm as a chain of links in URDF.

    The root is `base_link`, at the base of the arm. Joints are named slide_i, x_i, y_i, z_i;
    `ros_messages` has the positions in the settled shape, for robot_state_publisher. Each link
    has the name of its joint: link_z_i has a body, the links between a slide and three hinges have
    no extent, and link_z_N, with N the number of links, is the frame of the tip. A PointMass is a
    link mass_i. URDF has no loads: an ExportWarning and a comment name the loads of the scene.

    Raises InputError if the number of links is not 1 to 1000.
    """
    chain = build_chain(shape, links)
    remarks = left_out_of_urdf(shape)
    warn_of(remarks)
    root = ET.Element("robot", name=kind("name", name, str))
    remark(root, *remarks)
    bodies = list[ET.Element]()
    parent = child_of(root, "link", name=BASE)
    for i in range(links + 1):
        if i:
            place = (chain.chords[i - 1], 0, 0)
            along = (1, 0, 0)
            parent = _add_link(root, parent, f"slide_{i}", "prismatic", along, xyz=place)
        turned = Rotation.from_matrix(chain.rest[i]).as_euler("xyz")
        for letter, axis, rpy in zip("xyz", np.eye(3), [turned, _NOT, _NOT], strict=True):
            parent = _add_link(root, parent, f"{letter}_{i}", "revolute", axis, rpy=rpy)
        bodies.append(parent)
        if i < links:
            _add_body(parent, chain, i)
    for each in point_masses(shape, chain.bodies):
        child = _add_link(root, bodies[each.body], each.name, "fixed", (1, 0, 0), xyz=each.place)
        inertial = child_of(child, "inertial")
        child_of(inertial, "mass", value=each.mass)
        child_of(inertial, "inertia", **dict.fromkeys(("ixx", "iyy", "izz"), 0), **_NO_PRODUCTS)
    return to_text(root)


def _add_link(
    root: ET.Element,
    parent: ET.Element,
    joint: str,
    kind: str,
    axis: Any,
    xyz: Any = _NOT,
    rpy: Any = _NOT,
) -> ET.Element:
    """Connect a new link to another one by a joint; return the new link."""
    child = f"link_{joint}"
    values = child_of(root, "joint", name=joint, type=kind)
    child_of(values, "parent", link=parent.get("name"))
    child_of(values, "child", link=child)
    child_of(values, "origin", xyz=xyz, rpy=rpy)
    child_of(values, "axis", xyz=axis)
    if kind != "fixed":
        most = 1.0 if kind == "prismatic" else np.pi
        child_of(values, "limit", lower=-most, upper=most, effort=1000, velocity=1000)
    return child_of(root, "link", name=child)


def _add_body(link: ET.Element, chain: Chain, i: int) -> None:
    """Add body and mass to a link."""
    length, radius, mass = (float(x[i]) for x in (chain.chords, chain.radii, chain.masses))
    # Cylinders have axis z; the axis of the link is x.
    place = {"xyz": (length / 2, 0, 0), "rpy": (0, np.pi / 2, 0)}
    for tag in ("visual", "collision"):
        values = child_of(link, tag)
        child_of(values, "origin", **place)
        child_of(child_of(values, "geometry"), "cylinder", radius=radius, length=length)
    values = child_of(link, "inertial")
    child_of(values, "origin", **place)
    child_of(values, "mass", value=mass)
    about_x, about_y, about_z = (float(each) for each in chain.inertias[i])
    # The frame of the cylinder has its x axis along -z of the link.
    child_of(values, "inertia", ixx=about_z, iyy=about_y, izz=about_x, **_NO_PRODUCTS)


def ros_messages(shape: Shape, links: int = 30) -> dict[str, Any]:
    """Return a settled arm as ROS messages in JSON (rosbridge, `ros2 topic pub`).

    `tendons` is a sensor_msgs/JointState of strokes [m] and tensions [N], `chain` one of the joints
    of `urdf`, `path` a nav_msgs/Path of frames along the midline in the base frame, with x axes
    along the arm.
    """
    joints = build_chain(shape, links).joints
    arm = shape.arm
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": BASE}
    # Frames along the midline, in the base frame.
    base = np.array(arm.base_frame)
    s = np.linspace(0.0, arm.length, POINTS)
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
