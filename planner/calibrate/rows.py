"""The numbers that a settled shape predicts for a measurement, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from model.equilibrium.by_numbers import ByNumbers, along
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.rotations import matrices
from model.transcription.system import System
from planner.calibrate.measured import Measured

MM = 1e-3
# Keys by unknown, none where it belongs to another session.
Keys = Sequence[tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Sensors:
    """Where the markers of a shape are on the arm.

    Attributes
    ----------
    s : (P,)
        Arc lengths of the points [m].
    offsets : (P, 3)
        In the local frame (t, n, b) [m].
    """

    s: Array
    offsets: Array


def residuals(here: Linearised, shape: Measured, sensors: Sensors) -> Array:
    """Return what is predicted less what was measured (size,), [m] and [rad]."""
    return np.concatenate(
        [*_points(here, shape, sensors), *_frames(here, shape), *_runs(here, shape)]
    )


def jacobian(by: ByNumbers, shape: Measured, sensors: Sensors, keys: Keys) -> Array:
    """Return the derivatives (size, K) of what is predicted by unknowns of these keys (K,)."""
    here = by.here
    rows: list[Array] = []
    for i, _ in shape.seen:
        rows.append(_point_by(by, i, sensors, keys))
    if shape.tip is not None:
        rows.append(by.pose(here.system.mesh.steps)[:3])
    for frame in shape.frames:
        node = here.system.mesh.node(frame.s)
        off = _turn(here, node, frame.matrix)
        rows.append(_inverse_left_jacobian(off) @ by.pose(node)[3:])
    if shape.lengths is not None:
        rows.append(by.lengths)
    if shape.strokes is not None:
        rows.append(replace(by, here=at_rest(here.system)).direct_lengths - by.lengths)
    return np.vstack(rows)


def _points(here: Linearised, shape: Measured, sensors: Sensors) -> list[Array]:
    poses, mesh = here.system.poses(here.states), here.system.mesh
    found = []
    for i, point in shape.seen:
        pose = poses[mesh.node(sensors.s[i])]
        found.append(pose[4:] + matrices(pose[:4]) @ sensors.offsets[i] - point.place)
    if shape.tip is not None:
        found.append(poses[-1, 4:] - shape.tip)
    return found


def _point_by(by: ByNumbers, i: int, sensors: Sensors, keys: Keys) -> Array:
    here = by.here
    node = here.system.mesh.node(sensors.s[i])
    R = matrices(here.system.poses(here.states)[node, :4])
    lever = R @ sensors.offsets[i]
    moved = by.pose(node)
    found = moved[:3] + np.cross(moved[3:].T, lever).T
    for k, own in enumerate(keys):
        if f"points[{i}].s_mm" in own:
            rate = along(here, node)
            found[:, k] += MM * (rate[:3] + np.cross(rate[3:], lever))
        for axis in range(3):
            if f"points[{i}].offset_mm[{axis}]" in own:
                found[:, k] += MM * R[:, axis]
    return np.asarray(found)


def _frames(here: Linearised, shape: Measured) -> list[Array]:
    return [_turn(here, here.system.mesh.node(f.s), f.matrix) for f in shape.frames]


def _turn(here: Linearised, node: int, measured: object) -> Array:
    """Return the rotation vector (3,) from a measured frame to that of a node, base frame."""
    R = matrices(here.system.poses(here.states)[node, :4])
    return np.asarray(Rotation.from_matrix(R @ np.array(measured).T).as_rotvec())


def _inverse_left_jacobian(w: Array) -> Array:
    """Return how a rotation vector changes with a small rotation put before it (3, 3).

    Source: Chirikjian, "Stochastic Models, Information Theory, and Lie Groups" 2 (2012), 10.6.
    """
    angle = float(np.linalg.norm(w))
    x, y, z = w
    W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-4:
        return np.asarray(np.eye(3) - W / 2 + W @ W / 12)
    factor = 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
    return np.asarray(np.eye(3) - W / 2 + factor * W @ W)


def _runs(here: Linearised, shape: Measured) -> list[Array]:
    found, system = [], here.system
    if shape.lengths is not None:
        found.append(system.lengths(here.x) - shape.lengths)
    if shape.strokes is not None:
        rest = at_rest(system)
        found.append(system.lengths(rest.x) - system.lengths(here.x) - shape.strokes)
    return found


def at_rest(system: System) -> Linearised:
    """Return the arm straight and without tensions, where strokes are counted from."""
    law, N = system.of.form.law, system.s.size
    v = np.zeros((N, system.of.form.strains))
    if law.extension:
        v[:, 2 + law.torsion] = law.along_at_rest
    none = np.zeros(system.of.n_tendons)
    return Linearised.at(system, system.x(none, 0.0, system.start(none, v)))
