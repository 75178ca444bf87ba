"""The numbers that a settled shape predicts for a measurement, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from model.equilibrium.by_numbers import ByNumbers, along
from model.equilibrium.linearised import Index, Linearised
from model.paths import Array
from model.rotations import matrices
from model.transcription.layout import POSE
from model.winches import rest_lengths
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


def jacobian(
    by: ByNumbers, shape: Measured, sensors: Sensors, keys: Keys, rest_slopes: Array
) -> Array:
    """Return the derivatives (size, K) of what is predicted by unknowns of these keys (K,).

    `rest_slopes` (n_tendons, K) are those of the tendons' lengths at rest, which strokes ask for.
    """
    here = by.here
    rows = [_points_by(by, shape, sensors, keys)]
    if shape.tip is not None:
        rows.append(by.poses(np.array([here.system.mesh.steps]))[0, :3])
    if shape.frames:
        nodes, off = _turns(here, shape)
        turned = zip(off, by.poses(nodes)[:, 3:], strict=True)
        rows += [_inverse_left_jacobian(w) @ moved for w, moved in turned]
    if shape.lengths is not None:
        rows.append(by.lengths)
    if shape.strokes is not None:
        rows.append(rest_slopes - by.lengths)
    return np.vstack(rows)


def _points(here: Linearised, shape: Measured, sensors: Sensors) -> list[Array]:
    found = []
    if shape.seen:
        poses, _, levers = _markers(here, shape, sensors)
        found.append((poses[:, 4:] + levers - shape.places).ravel())
    if shape.tip is not None:
        found.append(here.states[here.system.of.nodes[-1, 4:POSE]] - shape.tip)
    return found


def _markers(here: Linearised, shape: Measured, sensors: Sensors) -> tuple[Array, Array, Array]:
    """Return poses (n, 7), frames, and offsets (n, 3) in the base frame, of markers seen."""
    kept = [i for i, _ in shape.seen]
    poses = here.states[here.system.of.nodes[_nodes(here, sensors.s[kept]), :POSE]]
    frames = matrices(poses[:, :4])
    return poses, frames, np.einsum("nij,nj->ni", frames, sensors.offsets[kept])


def _nodes(here: Linearised, s: Array) -> Index:
    """Return the nodes at arc lengths (n,)."""
    return np.asarray(np.abs(here.system.mesh.s[:, None] - s).argmin(axis=0))


def _points_by(by: ByNumbers, shape: Measured, sensors: Sensors, keys: Keys) -> Array:
    here, kept = by.here, [i for i, _ in shape.seen]
    if not kept:
        return np.zeros((0, len(keys)))
    nodes = _nodes(here, sensors.s[kept])
    _, frames, levers = _markers(here, shape, sensors)
    moved = by.poses(nodes)
    found = moved[:, :3] + np.cross(moved[:, 3:], levers[:, :, None], axis=1)
    for row, i in enumerate(kept):
        for k, own in enumerate(keys):
            if f"points[{i}].s_mm" in own:
                rate = along(here, nodes[row : row + 1])[0]
                found[row, :, k] += MM * (rate[:3] + np.cross(rate[3:], levers[row]))
            for axis in range(3):
                if f"points[{i}].offset_mm[{axis}]" in own:
                    found[row, :, k] += MM * frames[row, :, axis]
    return found.reshape(-1, len(keys))


def _frames(here: Linearised, shape: Measured) -> list[Array]:
    return [_turns(here, shape)[1].ravel()] if shape.frames else []


def _turns(here: Linearised, shape: Measured) -> tuple[Index, Array]:
    """Return the nodes of measured frames, and rotation vectors (n, 3) from them to the nodes'."""
    nodes = _nodes(here, np.array([own.s for own in shape.frames]))
    measured = np.array([own.matrix for own in shape.frames])
    found = matrices(here.states[here.system.of.nodes[nodes, :4]])
    return nodes, Rotation.from_matrix(found @ measured.transpose(0, 2, 1)).as_rotvec()


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
        found.append(rest_lengths(system.arm) - system.lengths(here.x) - shape.strokes)
    return found
