"""A settled arm for MuJoCo: links, hinges, tendons and a keyframe, as MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from model.effects import Weight
from model.paths import Array
from model.shape import Shape
from planner.bodies.chain import Chain, chain_of
from planner.bodies.markup import inside, written
from planner.bodies.surface import tendon_offset

# Damping over stiffness of joints [s]: what swings is still after some of that.
_DAMPING = 0.05
# Mass of the tip, which has no extent, over that of the last link.
_TIP = 1e-3


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
    inside(root, "compiler", angle="radian", autolimits="true")
    weight = shape.scene.find(Weight)
    gravity = weight.g if weight is not None else (0.0, 0.0, 0.0)
    inside(root, "option", gravity=gravity, integrator="implicitfast", timestep=1e-3)
    world, frame = inside(root, "worldbody"), np.array(arm.base_frame)
    place = {"pos": arm.base_position, "quat": _quaternion(frame)}
    _bodies(inside(world, "body", name="base", **place), chain, shape)
    _tendons(root, chain, shape)
    driven = [j for j in range(arm.n_tendons) if _count(chain, shape, j) > 1]
    # Positions of all joints in the model's order.
    joints = [*chain.angles[0], *np.column_stack([chain.slides, chain.angles[1:]]).ravel()]
    settled = {"qpos": joints, "ctrl": shape.tensions[driven]}
    inside(inside(root, "keyframe"), "key", name="settled", **settled)
    return written(root)


def _bodies(base: ET.Element, chain: Chain, shape: Shape) -> None:
    body, last = base, chain.s.size - 1
    for i in range(chain.s.size):
        place = (chain.chords[i - 1] if i else 0.0, 0.0, 0.0)
        name = "tip" if i == last else f"link_{i}"
        body = inside(body, "body", name=name, pos=place, quat=_quaternion(chain.rest[i]))
        if i:
            axis = chain.rest[i].T[:, 0]
            _joint(body, f"slide_{i}", "slide", axis, chain.slide_stiffness[i - 1])
        for axis, letter, k in zip(np.eye(3), "xyz", chain.hinge_stiffness[i], strict=True):
            _joint(body, f"{letter}_{i}", "hinge", axis, k)
        if i == last:
            inertia = chain.masses[-1] * chain.radii[-1] ** 2
            mass = {"mass": _TIP * chain.masses[-1], "diaginertia": [_TIP * inertia] * 3}
            inside(body, "inertial", pos=(0, 0, 0), **mass)
            inside(body, "site", name="tip", size=1e-3)
        else:
            ends = (0, 0, 0, chain.chords[i], 0, 0)
            look = {"rgba": "0.85 0.55 0.45 1", "contype": "0", "conaffinity": "0"}
            solid = {"type": "cylinder", "fromto": ends, "size": chain.radii[i]}
            inside(body, "geom", mass=chain.masses[i], **solid, **look)
        # Sites where tendons pass the node, across the midline at rest.
        for j in (j for j in range(shape.arm.n_tendons) if i < _count(chain, shape, j)):
            n, b = tendon_offset(shape.arm, j, chain.s[i : i + 1])[0]
            site = f"{shape.arm.tendon_name(j)}_{i}"
            inside(body, "site", name=site, pos=(0.0, n, b), size=5e-4)


def _joint(body: ET.Element, name: str, kind: str, axis: Array, stiffness: float) -> None:
    spring = {"stiffness": stiffness, "damping": _DAMPING * stiffness}
    inside(body, "joint", name=name, type=kind, axis=axis, **spring)


def _tendons(root: ET.Element, chain: Chain, shape: Shape) -> None:
    tendons, motors = inside(root, "tendon"), inside(root, "actuator")
    for j in range(shape.arm.n_tendons):
        name, count = shape.arm.tendon_name(j), _count(chain, shape, j)
        if count > 1:
            path = inside(tendons, "spatial", name=name, width=5e-4, rgba="0.2 0.3 0.8 1")
            for i in range(count):
                inside(path, "site", site=f"{name}_{i}")
            inside(motors, "motor", name=name, tendon=name, gear=-1)


def _count(chain: Chain, shape: Shape, j: int) -> int:
    """Return how many nodes a tendon passes."""
    at = shape.arm.sections[shape.arm.tendons[j][0]].at
    return int(np.sum(chain.s <= at * (1 + 1e-12)))


def _quaternion(frame: Array) -> Array:
    return np.asarray(Rotation.from_matrix(frame).as_quat(scalar_first=True))
