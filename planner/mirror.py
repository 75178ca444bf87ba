"""Mirror images: other tensions that do the same on the other side of a plane of the arm.

A plane through the base's axis in which the tendons of each anchorage are mirrored maps tensions to
those of the mirrored tendons. Where arm, loads and targets are alike on both sides too, the mirror
image of a plan is a plan of the same effort. That is checked by the shapes themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.errors import OctoplanError
from model.paths import Array
from model.settle import settle
from model.shape import Shape
from planner.measure import measure
from planner.program.limits import Limits
from planner.program.terms import compliance_requests, stations_of
from planner.solve.task import Task
from planner.targets.base import Target

# Angles that are the same [rad], and tensions that are, over the largest.
_SAME_ANGLE, _SAME = 1e-9, 1e-6
# How well mirrored poses meet the targets, over the arm's length, before a shape is settled for it.
_LIKELY = 1e-3


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane through the base's axis that maps the tendons to each other.

    Attributes
    ----------
    angle : float
        Of the plane in the base's n and b, in [0, pi) [rad].
    tendons : (n_tendons,)
        The mirror image of each tendon.
    """

    angle: float
    tendons: Array

    def poses(self, arm: Arm, poses: Array) -> Array:
        """Return the mirror images of poses (K, 7), their frames right-handed like those.

        Frames are mirrored in the base's plane and in their own: reflections are half turns about
        the normals, but for their signs, which cancel.
        """
        origin, local = np.array(arm.base_position), [0.0, -np.sin(self.angle), np.cos(self.angle)]
        normal = np.array(arm.base_frame) @ local
        turned = _by_half_turn(normal, 1) @ _by_half_turn(np.array(local), -1)
        places = poses[:, 4:] - 2 * np.outer((poses[:, 4:] - origin) @ normal, normal)
        return np.hstack([poses[:, :4] @ turned.T, places])


def _by_half_turn(axis: Array, side: int) -> Array:
    """Return what multiplies quaternions by half a turn, from the left (1) or the right (-1)."""
    x, y, z = axis.tolist()
    crossed = side * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.block([[np.zeros((1, 1)), -axis[None]], [axis[:, None], crossed]])


@lru_cache(maxsize=32)
def mirrors(arm: Arm, limits: Limits) -> tuple[Mirror, ...]:
    """Return the planes that map the tendons to others of the same path and limits."""
    planes: list[Mirror] = []
    first, phi = arm.tendons[0]
    sums = {(phi + other) % (2 * np.pi) for i, other in arm.tendons if i == first}
    for double in sorted(sums):
        images = [_image(arm, limits, j, double) for j in range(arm.n_tendons)]
        if None not in images:
            planes.append(Mirror(double / 2, np.array(images)))
    return tuple(planes)


def _image(arm: Arm, limits: Limits, j: int, double: float) -> int | None:
    """Return the tendon that is the mirror image of tendon j, at twice the plane's angle less its.

    None where there is none.
    """
    section, phi = arm.tendons[j]
    tendons = arm.tendons_of(section + 1)
    anchorage = arm.sections[section]
    if anchorage.turn is not None:
        return None
    for k in tendons:
        apart = (double - phi - arm.tendons[k][1] + np.pi) % (2 * np.pi) - np.pi
        paths = [anchorage.offsets[i - tendons[0]] for i in (j, k)]
        bounds = [(limits.lower[i], limits.upper[i]) for i in (j, k)]
        if abs(apart) < _SAME_ANGLE and paths[0] == paths[1] and bounds[0] == bounds[1]:
            return k
    return None


def mirror_images(task: Task, shape: Shape) -> Iterator[tuple[Mirror, Array]]:
    """Yield mirrors, and the mirrored tensions (n_tendons,) of a shape that meet the targets too.

    As well as the shape does, to ten times the accuracy. None for targets of stiffness, with limits
    on strokes, and of tensions that are their own mirror image.
    """
    arm, targets, limits = task.arm, task.targets, task.limits
    T, stations = shape.tensions, np.array(stations_of(arm, targets))
    if compliance_requests(targets) or limits.strokes is not None or not T.any():
        return
    poses = shape.poses(stations)
    most = _off(arm, targets, poses) + 10 * task.accuracy
    for mirror in mirrors(arm, limits):
        other = T[mirror.tendons]
        likely = _off(arm, targets, mirror.poses(arm, poses)) <= max(most, _LIKELY)
        if not likely or np.abs(T - other).max() <= _SAME * T.max():
            continue
        try:
            settled = settle(arm, other, task.scene, task.accuracy, compile=shape.machine_code)
        except OctoplanError:
            continue
        if _off(arm, targets, settled.poses(stations)) <= most:
            yield mirror, other


def _off(arm: Arm, targets: tuple[Target, ...], poses: Array) -> float:
    """Return how far poses (K, 7) are from the targets, the largest residual."""
    equality, soft_residual, inequality = measure(arm, targets, poses, np.zeros(0))
    gaps = [np.abs(value) for part in (equality, soft_residual) for value in part.values()]
    gaps += [np.maximum(-value, 0.0) for value in inequality.values()]
    return max((float(gap.max(initial=0.0)) for gap in gaps), default=0.0)
