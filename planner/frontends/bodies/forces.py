"""Forces on an exported chain of links, and springs that balance the forces at the settled shape.

MuJoCo supports gravity, buoyancy (`gravcomp`), masses, and wrenches on sites: motors whose
`refsite` is in the world exert dead forces, motors without `refsite` follow the site. Other loads
are rejected, or omitted with an ExportWarning and a comment in the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    LineLoad,
    NeoHookean,
    PointLoad,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.paths import SAME, Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.units import warn

# Effects of the cross-section, which the springs represent.
_STATICS = (ExactTendons, Extension, NeoHookean, PrintedStatics, Shear)
_CARRIED = (Buoyancy, Current, LineLoad, PointLoad, PointMass, TipLoad, Weight)
# Points per link at which a load along the arm is integrated.
_LOAD_POINTS = 4


class ExportWarning(UserWarning):
    """An exported file lacks a load of the scene, or differs from the settled arm."""


def warn_of(sentences: Sequence[str]) -> None:
    """Issue an ExportWarning for each sentence."""
    for sentence in sentences:
        warn(sentence, ExportWarning)


def left_out_of_urdf(shape: Shape) -> tuple[str, ...]:
    """Return a sentence about loads, which URDF does not support; empty without loads."""
    names = _names(e for e in shape.scene.effects if not isinstance(e, (*_STATICS, PointMass)))
    if not names:
        return ()
    return (f"URDF has no loads: {names} left out; joint positions are those under all loads",)


def left_out_of_mjcf(shape: Shape) -> tuple[str, ...]:
    """Return sentences about loads that an MJCF model reproduces at the settled shape only.

    Raises InputError for a load that changes the equilibrium and is not supported by MJCF.
    """
    free = not shape.contacts
    known = (*_STATICS, *_CARRIED)
    others = [effect for effect in shape.scene.effects if not isinstance(effect, known)]
    contacts = [effect for effect in others if effect.has_complementarity]
    refused = [effect for effect in others if not (free and effect in contacts)]
    if refused:
        allowed = "a scene with loads that MJCF supports"
        if any(effect in contacts for effect in refused):
            allowed += "; replace contacts by a PointLoad with each force of shape.contacts"
        else:
            allowed += "; settle the arm without this effect"
        raise InputError("scene", Described(f"a scene with {_names(refused)}"), allowed)
    sentences = []
    if shape.scene.has(Current):
        sentences.append("Current is constant in MJCF: its forces are those on the settled shape")
    if contacts:
        sentences.append(f"{_names(contacts)} left out of MJCF: the settled shape touches nothing")
    return tuple(sentences)


def _names(effects: Iterable[Effect]) -> str:
    """Return the types of effects, once each, separated by commas."""
    return ", ".join(dict.fromkeys(type(effect).__name__ for effect in effects))


@dataclass(frozen=True, eq=False)
class Bodies:
    """The rigid bodies of a chain at the settled shape: N links and the tip's frame.

    Attributes
    ----------
    s : (N + 1,)
        Arc lengths of the origins [m].
    origins : (N + 1, 3)
        [m].
    frames : (N + 1, 3, 3)
        Orientations; the columns are the axes.
    """

    s: Array
    origins: Array
    frames: Array

    def body_at(self, s: float) -> int:
        """Return the index of the body at an arc length [m]; N is the tip."""
        tolerance = SAME * float(self.s[-1])
        return int(np.searchsorted(self.s, s + tolerance, side="right")) - 1

    def local(self, body: int, point: Array) -> Array:
        """Return a point (3,) [m] in the frame of a body."""
        return np.asarray(self.frames[body].T @ (point - self.origins[body]))

    def world(self, body: int, point: Array) -> Array:
        """Return the position (3,) [m] of a point in the frame of a body."""
        return np.asarray(self.origins[body] + self.frames[body] @ point)


@dataclass(frozen=True, eq=False)
class SiteForce:
    """A wrench on a body, exerted by a motor at a site.

    Attributes
    ----------
    name : str
    body : int
    place : (3,)
        Position in the frame of the body [m].
    wrench : (6,)
        Force [N] and moment [N m], in world axes, or in the axes of the body for a follower.
    follower : bool
    """

    name: str
    body: int
    place: Array
    wrench: Array
    follower: bool = False


@dataclass(frozen=True, eq=False)
class Mass:
    """A point mass on a body.

    Attributes
    ----------
    name : str
    body : int
    place : (3,)
        Position in the frame of the body [m].
    mass : float
        [kg].
    """

    name: str
    body: int
    place: Array
    mass: float


def site_forces(shape: Shape, bodies: Bodies) -> list[SiteForce]:
    """Return the wrenches of point loads, line loads, the tip load and the current."""
    tip = bodies.s.size - 1
    results: list[SiteForce] = []
    loads = [effect for effect in shape.scene.effects if isinstance(effect, PointLoad)]
    for i, load in enumerate(loads):
        body = bodies.body_at(load.s)
        place = bodies.local(body, shape.position(load.s))
        results.append(
            SiteForce(
                f"point_load_{i}", body, place, np.append(load.force, load.moment or np.zeros(3))
            )
        )
    lines = [effect for effect in shape.scene.effects if isinstance(effect, LineLoad)]
    for i, line in enumerate(lines):
        results += _line_forces(shape, bodies, line, f"line_load_{i}")
    end = shape.scene.find(TipLoad)
    if end is not None:
        wrench = np.append(end.force, end.moment)
        results.append(SiteForce("tip_load", tip, np.zeros(3), wrench, end.follower))
    if (current := shape.scene.find(Current)) is not None:
        results += _drag_forces(shape, bodies, current)
    return [each for each in results if each.wrench.any()]


def _line_forces(shape: Shape, bodies: Bodies, load: LineLoad, name: str) -> Iterator[SiteForce]:
    """Yield the resultant wrench of a line load on each link that it loads.

    Dead forces act at their centroid, so that the link may turn; followers turn with the link.
    """
    last = shape.arm.length if load.end is None else load.end
    for i, (start, end) in enumerate(zip(bodies.s[:-1], bodies.s[1:], strict=True)):
        begin, reach = max(start, load.begin), min(end, last)
        if reach <= begin:
            continue
        h = (reach - begin) / _LOAD_POINTS
        s = begin + h * (np.arange(_LOAD_POINTS) + 0.5)
        points = shape.position(s)
        place = points.mean(axis=0)
        axes = shape.frame(s) if load.follower else np.broadcast_to(np.eye(3), (s.size, 3, 3))
        f = h * axes @ np.array(load.force)
        moment = np.cross(points - place, f).sum(axis=0)
        moment += (h * axes @ np.array(load.moment)).sum(axis=0)
        force = f.sum(axis=0)
        if load.follower:
            force, moment = bodies.frames[i].T @ force, bodies.frames[i].T @ moment
        wrench = np.append(force, moment)
        yield SiteForce(f"{name}_{i}", i, bodies.local(i, place), wrench, load.follower)


def _drag_forces(shape: Shape, bodies: Bodies, current: Current) -> Iterator[SiteForce]:
    """Yield the resultant wrench of a current on each link, at the origin of the link."""
    ends = zip(bodies.s[:-1], bodies.s[1:], strict=True)
    velocity = np.array(current.velocity)
    for i, (start, end) in enumerate(ends):
        h = (end - start) / _LOAD_POINTS
        s = start + h * (np.arange(_LOAD_POINTS) + 0.5)
        t = shape.frame(s)[:, :, 0]
        across = velocity - (t @ velocity)[:, None] * t
        radius = shape.arm.radius.evaluate(s, shape.arm.length)[0]
        size = current.density * current.coefficient * radius * np.linalg.norm(across, axis=1)
        f = (size * (1 + shape.strain(s)[:, 3]) * h)[:, None] * across
        moment = np.cross(shape.position(s) - bodies.origins[i], f).sum(axis=0)
        yield SiteForce(f"current_{i}", i, np.zeros(3), np.append(f.sum(axis=0), moment))


def point_masses(shape: Shape, bodies: Bodies) -> list[Mass]:
    """Return the point masses of a scene, in the frames of the bodies."""
    masses = [effect for effect in shape.scene.effects if isinstance(effect, PointMass)]
    results = list[Mass]()
    for i, each in enumerate(masses):
        body = bodies.body_at(each.s)
        point = shape.position(each.s) + shape.frame(each.s) @ np.array(each.offset or (0, 0, 0))
        if each.mass:
            results.append(Mass(f"mass_{i}", body, bodies.local(body, point), each.mass))
    return results


def buoyancy_ratio(shape: Shape) -> float:
    """Return fluid density over body density, MuJoCo's `gravcomp`; 0 without Buoyancy."""
    fluid = shape.scene.find(Buoyancy)
    return fluid.density / shape.arm.material.density if fluid else 0.0


class Resultants:
    """Sums of the forces on each body and all bodies between this one and the tip."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._force = np.zeros((bodies.s.size, 3))
        self._moment = np.zeros((bodies.s.size, 3))

    def add(self, body: int, point: Array, force: Array, moment: Array | None = None) -> None:
        """Add a force (3,) [N] at a point (3,) [m] of a body, and a moment (3,) [N m]."""
        self._force[body] += force
        self._moment[body] += np.cross(point, force)
        if moment is not None:
            self._moment[body] += moment

    def add_wrench(self, each: SiteForce) -> None:
        """Add the wrench of a site."""
        axes = self._bodies.frames[each.body] if each.follower else np.eye(3)
        force = axes @ each.wrench[:3]
        moment = axes @ each.wrench[3:]
        self.add(each.body, self._bodies.world(each.body, each.place), force, moment)

    def on_joints(self, axes: Array) -> Array:
        """Return the generalised forces (N + 1, 4) on slide and hinges of each body.

        `axes` (N + 1, 4, 3) are the axes of slide and hinges through the origin of the body.
        """
        force = np.cumsum(self._force[::-1], axis=0)[::-1]
        moment = np.cumsum(self._moment[::-1], axis=0)[::-1]
        moment = moment - np.cross(self._bodies.origins, force)
        slides = np.einsum("ik,ik->i", axes[:, 0], force)
        hinges = np.einsum("ijk,ik->ij", axes[:, 1:], moment)
        return np.column_stack([slides, hinges])


def joint_axes(base_frame: Array, bodies: Bodies, rest: Array, angles: Array) -> Array:
    """Return the axes (N + 1, 4, 3) of the slide and of hinges x, y, z of each body."""
    before = np.concatenate([base_frame[None], bodies.frames[:-1]])
    first = before @ rest
    x = np.zeros_like(angles)
    y = np.zeros_like(angles)
    x[:, 0] = angles[:, 0]
    y[:, 1] = angles[:, 1]
    second = first @ Rotation.from_rotvec(x).as_matrix()
    third = second @ Rotation.from_rotvec(y).as_matrix()
    return np.stack([before[:, :, 0], first[:, :, 0], second[:, :, 1], third[:, :, 2]], axis=1)
