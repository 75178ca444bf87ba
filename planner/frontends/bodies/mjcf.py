"""A settled arm as a MuJoCo model (MJCF): a chain of links with springs, tendons and loads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model.effects import NeoHookean, Weight
from octoplan.model.paths import SAME, Array
from octoplan.model.shape import Shape
from octoplan.model.support.checks import SMALLEST, kind
from octoplan.planner.frontends.bodies.forces import (
    Mass,
    Resultants,
    SiteForce,
    buoyancy_ratio,
    joint_axes,
    left_out_of_mjcf,
    point_masses,
    site_forces,
    warn_of,
)
from octoplan.planner.frontends.bodies.links import Chain, build_chain
from octoplan.planner.frontends.bodies.surface import offsets
from octoplan.planner.frontends.bodies.xml import child_of, remark, to_text

# Damping over stiffness of joints [s]: the time constant of oscillations.
_DAMPING = 0.05
# Mass of the tip, which has no extent, over the mass of the last link.
_TIP = 1e-3
# Rotation between links [rad] up to which no simulated keyframe was unstable.
_MAX_TURN = 2 * np.pi / 3
# Site whose axes define the direction of dead loads.
WORLD = "world"
# Attributes of geoms that collide with nothing.
_UNTOUCHED = {"contype": "0", "conaffinity": "0"}


@dataclass(frozen=True, eq=False)
class TendonSite:
    """A point of a tendon: name, body (-1: the base), and position in the body frame (3,) [m]."""

    name: str
    body: int
    place: Array


def tendon_sites(shape: Shape, chain: Chain) -> list[list[TendonSite]]:
    """Return the path of each tendon: points at the base, at nodes, and at the anchorage.

    Offsets from the midline are those of the settled cross-section.
    """
    arm = shape.arm
    bodies = chain.bodies
    ends = np.array([arm.sections[i].at for i, _ in arm.tendons])
    at_nodes = _settled_offsets(shape, chain.s)
    at_ends = _settled_offsets(shape, ends)
    paths = list[list[TendonSite]]()
    for j, end in enumerate(ends.tolist()):
        name = arm.tendon_name(j)
        guides = arm.guides[j]
        if guides is not None:
            paths.append(_guide_sites(shape, chain, j, guides))
            continue
        last = bodies.body_at(end)
        places = [np.append(0.0, at_nodes[j, i]) for i in range(last + 1)]
        path = [TendonSite(f"{name}_{i}", i or -1, place) for i, place in enumerate(places)]
        if end - chain.s[last] > SAME * arm.length:
            point = shape.position(end) + shape.frame(end)[:, 1:] @ at_ends[j, j]
            path.append(TendonSite(f"{name}_{last + 1}", last, bodies.local(last, point)))
        paths.append(path)
    return paths


def _guide_sites(
    shape: Shape, chain: Chain, tendon: int, guides: tuple[float, ...]
) -> list[TendonSite]:
    """Return the path of a tendon that runs straight between guides."""
    s = np.array(guides)
    across = offsets(shape.arm, s)[tendon]
    points = shape.position(s) + (shape.frame(s)[:, :, 1:] @ across[:, :, None])[:, :, 0]
    name = shape.arm.tendon_name(tendon)
    path = [TendonSite(f"{name}_0", -1, np.append(0.0, across[0]))]
    for i, (place, point) in enumerate(zip(guides[1:], points[1:], strict=True), 1):
        body = chain.bodies.body_at(place)
        path.append(TendonSite(f"{name}_{i}", body or -1, chain.bodies.local(body, point)))
    return path


def _settled_offsets(shape: Shape, s: Array) -> Array:
    """Return offsets Y (n_tendons, N, 2) [m] at arc lengths s (N,), scaled with the swelling."""
    across = offsets(shape.arm, s)
    if not shape.scene.has(NeoHookean):
        return across
    return np.asarray(across / np.sqrt(1 + shape.strain(s)[:, 3])[:, None])


def mjcf(shape: Shape, links: int = 30, name: str = "arm") -> str:
    """Return a settled arm as a chain of links in MJCF, the format of MuJoCo.

    Joints are springs with the stiffness of the arm. Spatial tendons pass through sites at the
    nodes; actuator controls are tensions [N]. Weight becomes MuJoCo's gravity,
    Buoyancy its `gravcomp`, and a PointMass a sphere. Each other load becomes a motor at a site;
    control 1 is the full load, 0 none. A follower load rotates with the site. A Current exerts the
    constant forces of the settled shape.

    The keyframe `settled` has the joint positions and controls of the shape and is in equilibrium:
    the rest position of each spring is chosen to balance tendons and loads. The springs thus also
    correct the discretisation, the nonlinearity of rubber and the tendon tangent of the paper. An
    arm without Extension is compressed by tensions nevertheless; sections do not slide under Shear.

    Parameters
    ----------
    links : int
        1 to 1000.

    Raises
    ------
    InputError
        For another number of links; for a scene with Friction, or an arm in contact with an
        obstacle or with itself.

    Warns
    -----
    ExportWarning
        For a current; for obstacles without contact, which are omitted; for links that rotate by
        more than 120 deg, which may be unstable.
    """
    chain = build_chain(shape, links)
    arm = shape.arm
    remarks = left_out_of_mjcf(shape)
    if Rotation.from_euler("XYZ", chain.angles).magnitude().max() > _MAX_TURN:
        remarks += ("links turn by more than 120 deg and may be unstable; raise `links`",)
    warn_of(remarks)
    wrenches = site_forces(shape, chain.bodies)
    masses = point_masses(shape, chain.bodies)
    paths = tendon_sites(shape, chain)
    root = ET.Element("mujoco", model=kind("name", name, str))
    remark(root, "Springs are balanced at the keyframe `settled`.", *remarks)
    child_of(root, "compiler", angle="radian", autolimits="true")
    weight = shape.scene.find(Weight)
    gravity = np.array(weight.g if weight is not None else (0.0, 0.0, 0.0))
    child_of(root, "option", gravity=gravity, integrator="implicitfast", timestep=1e-3)
    world = child_of(root, "worldbody")
    frame = np.array(arm.base_frame)
    child_of(world, "site", name=WORLD, pos=(0, 0, 0), size=1e-4)
    place = {"pos": arm.base_position, "quat": _quaternion(frame)}
    base = child_of(world, "body", name="base", **place)
    bodies = _bodies(base, chain, buoyancy_ratio(shape))
    _springs(bodies, chain, _rest_positions(shape, chain, gravity, paths, wrenches, masses))
    for site in (site for path in paths for site in path):
        body = base if site.body < 0 else bodies[site.body]
        child_of(body, "site", name=site.name, pos=site.place, size=5e-4)
    for mass in masses:
        _sphere(bodies[mass.body], mass, arm.material.density)
    _actuators(root, shape, paths, wrenches, bodies)
    controls = [*shape.tensions, *(1.0 for _ in wrenches)]
    settled = {"qpos": list(chain.joints.values()), "ctrl": controls}
    child_of(child_of(root, "keyframe"), "key", name="settled", **settled)
    return to_text(root)


def _rest_positions(
    shape: Shape,
    chain: Chain,
    gravity: Array,
    paths: list[list[TendonSite]],
    wrenches: list[SiteForce],
    masses: list[Mass],
) -> Array:
    """Return the rest positions (N + 1, 4) of the springs of slides and hinges.

    The springs balance all other forces at the settled shape: K (q - q_rest) = Q.
    """
    bodies = chain.bodies
    base = np.array(shape.arm.base_frame)
    total = Resultants(bodies)
    last = chain.s.size - 1
    net_gravity = (1 - buoyancy_ratio(shape)) * gravity
    for i, mass in enumerate(chain.masses):
        center = bodies.world(i, np.array([chain.chords[i] / 2, 0.0, 0.0]))
        total.add(i, center, mass * net_gravity)
    total.add(last, bodies.origins[last], _TIP * chain.masses[-1] * net_gravity)
    for each in masses:
        total.add(each.body, bodies.world(each.body, each.place), each.mass * gravity)
    for wrench in wrenches:
        total.add_wrench(wrench)
    for path, tension in zip(paths, shape.tensions, strict=True):
        places = [
            bodies.world(site.body, site.place)
            if site.body >= 0
            else shape.arm.base_position + base @ site.place
            for site in path
        ]
        for k, (one, other) in enumerate(pairwise(places)):
            pull = tension * (other - one) / max(float(np.linalg.norm(other - one)), SMALLEST)
            if path[k].body >= 0:
                total.add(path[k].body, one, pull)
            total.add(path[k + 1].body, other, -pull)
    axes = joint_axes(base, bodies, chain.rest, chain.angles)
    return np.asarray(chain.moved - total.on_joints(axes) / chain.stiffness)


def _bodies(base: ET.Element, chain: Chain, gravcomp: float) -> list[ET.Element]:
    """Add links and tip to the base; return them."""
    body = base
    last = chain.s.size - 1
    bodies: list[ET.Element] = []
    floats = {"gravcomp": gravcomp} if gravcomp else {}
    for i in range(chain.s.size):
        place = (chain.chords[i - 1] if i else 0.0, 0.0, 0.0)
        name = "tip" if i == last else f"link_{i}"
        body = child_of(
            body, "body", name=name, pos=place, quat=_quaternion(chain.rest[i]), **floats
        )
        bodies.append(body)
        if i == last:
            inertia = chain.masses[-1] * chain.radii[-1] ** 2
            mass = {"mass": _TIP * chain.masses[-1], "diaginertia": [_TIP * inertia] * 3}
            child_of(body, "inertial", pos=(0, 0, 0), **mass)
            child_of(body, "site", name="tip", size=1e-3)
        else:
            ends = (0, 0, 0, chain.chords[i], 0, 0)
            solid = {"type": "cylinder", "fromto": ends, "size": chain.radii[i]}
            look = {"rgba": "0.85 0.55 0.45 1"}
            inertia = {"mass": chain.masses[i], "diaginertia": chain.inertias[i]}
            child_of(body, "inertial", pos=(chain.chords[i] / 2, 0, 0), **inertia)
            child_of(body, "geom", **solid, **look, **_UNTOUCHED)
    return bodies


def _springs(bodies: list[ET.Element], chain: Chain, rest: Array) -> None:
    """Add joints to bodies, with springs of given rest positions (N + 1, 4)."""
    for i, body in enumerate(bodies):
        along = chain.rest[i].T[:, 0]
        axes = zip(("slide", "x", "y", "z"), [along, *np.eye(3)], strict=True)
        for k, (letter, axis) in enumerate(axes):
            if i == k == 0:
                # Link 0 has no slide.
                continue
            stiffness = chain.stiffness[i, k]
            spring = {"stiffness": stiffness, "damping": _DAMPING * stiffness}
            kind = "slide" if k == 0 else "hinge"
            name = f"{letter}_{i}"
            child_of(body, "joint", name=name, type=kind, axis=axis, springref=rest[i, k], **spring)


def _sphere(body: ET.Element, each: Mass, density: float) -> None:
    """Add a point mass to a body, as a sphere with the density of the arm and no buoyancy."""
    own = child_of(body, "body", name=each.name, pos=each.place)
    size = (3 * each.mass / (4 * np.pi * density)) ** (1 / 3)
    look = {"rgba": "0.5 0.5 0.5 1"}
    child_of(own, "geom", type="sphere", size=size, mass=each.mass, **look, **_UNTOUCHED)


def _actuators(
    root: ET.Element,
    shape: Shape,
    paths: list[list[TendonSite]],
    wrenches: list[SiteForce],
    bodies: list[ET.Element],
) -> None:
    """Add tendons with motors, then a motor for each wrench."""
    tendons = child_of(root, "tendon")
    motors = child_of(root, "actuator")
    for name, sites in zip(shape.arm.tendon_names, paths, strict=True):
        path = child_of(tendons, "spatial", name=name, width=5e-4, rgba="0.2 0.3 0.8 1")
        for site in sites:
            child_of(path, "site", site=site.name)
        child_of(motors, "motor", name=name, tendon=name, gear=-1)
    for wrench in wrenches:
        child_of(bodies[wrench.body], "site", name=wrench.name, pos=wrench.place, size=1e-3)
        axes = {} if wrench.follower else {"refsite": WORLD}
        child_of(motors, "motor", name=wrench.name, site=wrench.name, gear=wrench.wrench, **axes)


def _quaternion(frame: Array) -> Array:
    return np.asarray(Rotation.from_matrix(frame).as_quat(scalar_first=True))
