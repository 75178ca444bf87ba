"""What friction of contacts knows of the motion before, and what follows from it.

Friction acts against how far the midline has slipped since the equilibrium before. So along a load
path whose steps have the equilibria x_k under T_k = T_0 + t_k (T - T_0),
r(x_k, T_k, u_{k-1}) = 0, and with D_k = dx_k / dT

    D_k = t_k dx/dT (T_k) - (dr/dx)^-1 dr/du_{k-1} (du/dx D_{k-1}),

from D_0 = 0 on. That normals rotate as a point moves along the arm is left out of its history.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from model.contact.touches import Touches
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.transcription.system import System
from model.transcription.touch import BEFORE, FRICTION

# Equilibria on a load path, and the load factors at which they are: the first at 0.
Path = Sequence[tuple[Linearised, float]]
# Steps of differences in where nodes were, and along the arm, over its length.
_STEP, _ALONG = 1e-7, 1e-4


@dataclass(frozen=True, eq=False)
class History:
    """The equilibrium before, the distance from which friction acts against."""

    before: Linearised

    def positions(self, s: Array) -> Array:
        """Return where the midline was (n, 3) at arc lengths s (n,) [m]."""
        system, nodes = self.before.system, self.before.system.mesh.s
        near = np.minimum(np.searchsorted(nodes, s), nodes.size - 1)
        points, between = system.poses(self.before.states)[near, 4:], nodes[near] != s
        if between.any():
            points[between] = poses_and_strains(system, self.before.x, s[between])[0][:, 4:]
        return points

    def set_on(self, system: System) -> None:
        """Set where the nodes of a system were, which the kernels of friction read."""
        N, K = system.of.elements, system.of.form.contacts
        rows = system.p[system.of.equations.numbers_of("contact_friction")].reshape(N, K, FRICTION)
        rows[:, :, -BEFORE:] = self.positions(system.mesh.s[1:])[:, None]


def path_sensitivities(path: Path) -> Array:
    """Return dx/dT (n_states, n_tendons) at the end of a load path, by all of it."""
    (before, _), *steps = path
    sensitivity = np.zeros((before.system.of.n_states, before.system.of.n_tendons))
    for here, factor in steps:
        by_step = factor * here.by_tensions
        sensitivity = by_step + _by_history(before, sensitivity, here, by_step)
        before = here
    return sensitivity


def _by_history(before: Linearised, earlier: Array, here: Linearised, by_step: Array) -> Array:
    """Return what dx/dT (n_states, n_tendons) has by where the arm was before.

    With dx/dT `earlier` there, and `by_step` by the tensions alone. A point that moves along the
    arm looks back to another station of it, by the angle between the arm's tangents then and now.
    """
    system, touches = here.system, Touches.of(here.system)
    nodes = np.flatnonzero((touches.held | touches.inside).any(axis=1))
    if not nodes.size:
        return np.zeros_like(by_step)
    s, positions = system.mesh.s[nodes], before.system.of.nodes[:, 4:7]
    were = scipy.interpolate.make_interp_spline(before.system.mesh.s, earlier[positions])(s)
    by_before = _by_positions(here, nodes.tolist())
    by_history = by_before @ were.reshape(3 * nodes.size, -1)
    point, j = np.nonzero(touches.point[nodes])
    rolled = tangents(here, s[point]) - tangents(before, s[point])
    by_shift = -np.einsum("nki,ki->nk", by_before.reshape(-1, nodes.size, 3)[:, point], rolled)
    shifts = system.of.touches[nodes[point], j, 1]
    right = (by_step + by_history)[shifts]
    shifted = np.linalg.solve(np.eye(point.size) - by_shift[shifts], right)
    return np.asarray(by_history + by_shift @ shifted)


def tangents(here: Linearised, s: Array) -> Array:
    """Return the derivatives (k, 3) of the midline by arc length, on the base side of s (k,)."""
    positions, step = History(here).positions, _ALONG * here.system.arm.length
    return np.asarray((positions(s) - positions(s - step)) / step)


def _by_positions(here: Linearised, nodes: list[int]) -> Array:
    """Return dx/du (n_states, 3 k) by where some nodes were before."""
    step, columns = _STEP * here.system.arm.length, list[Array]()
    for node in nodes:
        for axis in range(3):
            ends = [_residual(here, node, axis, sign * step) for sign in (1, -1)]
            columns.append((ends[0] - ends[1]) / (2 * step))
    return -here.solve(np.asfortranarray(np.array(columns).T))


def _residual(here: Linearised, node: int, axis: int, step: float) -> Array:
    """Return the residual (n_states,) had a node been a step farther along an axis."""
    system, of = copy.copy(here.system), here.system.of
    system.p = here.system.p.copy()
    rows = system.p[of.equations.numbers_of("contact_friction")]
    rows.reshape(of.elements, -1, FRICTION)[node - 1, :, axis - BEFORE] += step
    return np.asarray(system.residual(here.x))
