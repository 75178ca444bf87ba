"""The numbers that settled shapes predict for what was measured, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy

from model.equilibrium.by_numbers import ByNumbers, along, displaced
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


class Rows:
    """What shapes on one arm predict: places of the markers of all at once, the rest one by one.

    Attributes
    ----------
    heres : list of Linearised
        Their equilibria, on one mesh.
    shapes : list of Measured
    """

    def __init__(
        self, heres: Sequence[Linearised], shapes: Sequence[Measured], sensors: Sequence[Sensors]
    ) -> None:
        self.heres, self.shapes = list(heres), list(shapes)
        mesh_s, points, s, offsets = heres[0].system.mesh.s, list[int](), list[float](), []
        for shape, own in zip(shapes, sensors, strict=True):
            kept = [i for i, _ in shape.seen]
            points += kept
            s += own.s[kept].tolist()
            offsets.append(own.offsets[kept])
            if shape.tip is not None:
                points.append(-1)
                s.append(float(mesh_s[-1]))
                offsets.append(np.zeros((1, 3)))
        # Of each marker, then the tip: its number, node and offset; tips have no number.
        self._points = np.array(points, dtype=np.int64)
        self._nodes = np.asarray(np.abs(mesh_s - np.array(s)[:, None]).argmin(axis=1))
        self._offsets = np.vstack([np.zeros((0, 3)), *offsets])
        counts = [len(shape.seen) + (shape.tip is not None) for shape in shapes]
        ends = np.cumsum([0, *counts])
        self._own = [slice(a, b) for a, b in pairwise(ends.tolist())]

    @cached_property
    def _poses(self) -> Array:
        """Of the markers' nodes (P, 7)."""
        places = self._places
        rows = [here.states[places[own]] for here, own in zip(self.heres, self._own, strict=True)]
        return np.vstack([np.zeros((0, POSE)), *rows])

    @cached_property
    def _places(self) -> Index:
        return np.asarray(self.heres[0].system.of.nodes[self._nodes, :POSE])

    @cached_property
    def _frames(self) -> Array:
        return matrices(self._poses[:, :4])

    @cached_property
    def _levers(self) -> Array:
        """Offsets of the markers in the base frame (P, 3) [m]."""
        return np.asarray(np.einsum("pij,pj->pi", self._frames, self._offsets))

    def residuals(self) -> list[Array]:
        """Return what is predicted less what was measured of each shape (size,), [m] and [rad]."""
        places, found = self._poses[:, 4:] + self._levers, []
        for here, shape, own in zip(self.heres, self.shapes, self._own, strict=True):
            goals = shape.places if shape.tip is None else np.vstack([shape.places, shape.tip])
            rows = [(places[own] - goals).ravel()]
            if shape.frames:
                rows.append(_turns(here, shape)[1].ravel())
            found.append(np.concatenate([*rows, *_runs(here, shape)]))
        return found

    def jacobians(self, by: Sequence[ByNumbers], keys: Keys, rest_jacobian: Array) -> list[Array]:
        """Return the derivatives (size, K) of what is predicted by unknowns of these keys (K,).

        `rest_jacobian` (n_tendons, K) are those of the tendons' lengths at rest, which strokes ask
        for.
        """
        moved, found = self._displacements(by, keys), []
        for one, shape, own in zip(by, self.shapes, self._own, strict=True):
            rows = [moved[own].reshape(-1, len(keys))]
            if shape.frames:
                nodes, off = _turns(one.here, shape)
                turned = zip(off, one.poses(nodes)[:, 3:], strict=True)
                rows += [_inverse_left_jacobian(w) @ change for w, change in turned]
            if shape.lengths is not None:
                rows.append(one.lengths)
            if shape.strokes is not None:
                rows.append(rest_jacobian - one.lengths)
            found.append(np.vstack(rows))
        return found

    def _displacements(self, by: Sequence[ByNumbers], keys: Keys) -> Array:
        """Return how the markers move with the unknowns (P, 3, K) [m per unit]."""
        rows = [one.states[self._places[own]] for one, own in zip(by, self._own, strict=True)]
        moved = displaced(self._poses, np.vstack([np.zeros((0, POSE, len(keys))), *rows]))
        shifts = by[0].jacobian.s[self._nodes]
        slid = [(k, i) for k, own in enumerate(keys) for i in _numbered(own, "s_mm")]
        if slid or shifts.any():
            rates = self._along()
            moved -= rates[:, :, None] * shifts[:, None, :]
            for k, i in slid:
                moved[:, :, k] += MM * rates * (self._points == i)[:, None]
        found = moved[:, :3] + _cross(moved[:, 3:], self._levers)
        for axis in range(3):
            for k, own in enumerate(keys):
                for i in _numbered(own, f"offset_mm[{axis}]"):
                    here = self._points == i
                    found[here, :, k] += MM * self._frames[here, :, axis]
        return found

    def _along(self) -> Array:
        """Return how poses move along the arm at the markers (P, 6)."""
        rows = [
            along(here, self._nodes[own])
            for here, own in zip(self.heres, self._own, strict=True)
            if own.stop > own.start
        ]
        return np.vstack([np.zeros((0, 6)), *rows])


def _numbered(keys: tuple[str, ...], what: str) -> list[int]:
    """Return the numbers of the points whose quantity is among the keys."""
    ending = f"].{what}"
    return [
        int(key[7 : -len(ending)]) for key in keys if key[:7] == "points[" and key.endswith(ending)
    ]


def _cross(turned: Array, levers: Array) -> Array:
    """Return rotations (P, 3, K) times levers (P, 3): displacements (P, 3, K)."""
    x, y, z = levers.T
    zero = np.zeros_like(x)
    across = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    return np.asarray(across @ turned)


def _turns(here: Linearised, shape: Measured) -> tuple[Index, Array]:
    """Return the nodes of measured frames, and rotation vectors (n, 3) from them to the nodes'."""
    s = np.array([own.s for own in shape.frames])
    nodes = np.asarray(np.abs(here.system.mesh.s[:, None] - s).argmin(axis=0))
    measured = np.array([own.matrix for own in shape.frames])
    found = matrices(here.states[here.system.of.nodes[nodes, :4]])
    off = scipy.spatial.transform.Rotation.from_matrix(found @ measured.transpose(0, 2, 1))
    return nodes, off.as_rotvec()


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
