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

import numpy as np
import scipy

from model.contact.gaps import along
from model.contact.touches import Touches, kernel_numbers
from model.equilibrium.linearised import Index, Linearised
from model.paths import Array
from model.transcription.touch import BEFORE

# Equilibria on a load path, and the load factors at which they are: the first at 0.
Path = Sequence[tuple[Linearised, float]]
# The step of differences in where nodes were, over the arm's length.
_STEP = 1e-7


def path_sensitivities(path: Path) -> Array:
    """Return dx/dT (n_states, n_tendons) at the end of a load path, by all of it."""
    (before, _), *steps = path
    sensitivity = np.zeros((before.system.of.n_states, before.system.of.n_tendons))
    for point, factor in steps:
        by_step = factor * point.by_tensions
        sensitivity = by_step + _by_history(before, sensitivity, point, by_step)
        before = point
    return sensitivity


def _by_history(before: Linearised, earlier: Array, point: Linearised, by_step: Array) -> Array:
    """Return what dx/dT (n_states, n_tendons) has by where the arm was before.

    With dx/dT `earlier` there, and `by_step` by the tensions alone. A point that moves along the
    arm looks back to another station of it, by the angle between the arm's tangents then and now.
    """
    system, touches = point.system, Touches.of(point.system)
    nodes = np.flatnonzero(touches.touching.any(axis=1))
    if not nodes.size:
        return np.zeros_like(by_step)
    s, places = system.mesh.s[nodes], before.system.of.nodes[:, 4:7]
    were = scipy.interpolate.make_interp_spline(before.system.mesh.s, earlier[places])(s)
    by_before = _by_positions(point, nodes)
    by_history = by_before @ were.reshape(3 * nodes.size, -1)
    k, j = np.nonzero(touches.points[nodes])
    now, then = (along(at.system, at.x, s[k], j)[2] for at in (point, before))
    by_shift = -np.einsum("nki,ki->nk", by_before.reshape(-1, nodes.size, 3)[:, k], now - then)
    shifts = system.of.touches[nodes[k], j, 1]
    shifted = np.linalg.solve(np.eye(k.size) - by_shift[shifts], (by_step + by_history)[shifts])
    return np.asarray(by_history + by_shift @ shifted)


def _by_positions(point: Linearised, nodes: Index) -> Array:
    """Return dx/du (n_states, 3 k) by where some nodes (k,) were before.

    By differences: of the equations those of friction at each node alone know where it was.
    """
    of, step = point.system.of, _STEP * point.system.arm.length
    rows = np.concatenate([of.friction_forces, of.tractions], axis=2)[nodes].reshape(nodes.size, -1)
    right = np.zeros((of.n_states, nodes.size, 3))
    for axis in range(3):
        for sign in (1, -1):
            changed = copy.copy(point.system)
            kernel_numbers(changed, "contact_friction")[:, :, axis - BEFORE] += sign * step
            slope = sign * changed.residual(point.x)[rows] / (2 * step)
            right[rows, np.arange(nodes.size)[:, None], axis] += slope
    return -point.solve(np.asfortranarray(right.reshape(of.n_states, -1)))
