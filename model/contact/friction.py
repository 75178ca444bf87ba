"""How an equilibrium with friction of contacts changes with tensions, by all of its load path.

Friction acts against how far the midline has slipped since the equilibrium before. So along a load
path whose steps have the equilibria x_k under T_k = T_0 + t_k (T - T_0),
r(x_k, T_k, u_{k-1}) = 0, and with D_k = dx_k / dT

    D_k = t_k dx/dT (T_k) - (dr/dx)^-1 dr/du_{k-1} (du/dx D_{k-1}),

from D_0 = 0 on. That normals rotate as a point moves along the arm is left out of its history.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from model.contact.gaps import along
from model.contact.touches import Touches
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.transcription.touch import BEFORE

# Equilibria on a load path, and the load factors at which they are: the first at 0.
Path = Sequence[tuple[Linearised, float]]


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
    of, s, n = system.of, system.mesh.s, system.of.n_tendons
    k, j = np.nonzero(touches.points)
    # Where nodes were, by the tensions and by how far points move along the arm.
    were = np.zeros((s.size, 3, n + k.size))
    nodes = before.system.of.nodes[:, 4:7]
    were[:, :, :n] = scipy.interpolate.make_interp_spline(before.mesh.s, earlier[nodes])(s)
    if k.size:
        now, then = (along(at.system, at.x, s[k], j)[1] for at in (point, before))
        were[k, :, n + np.arange(k.size)] = then - now
    change = np.zeros((of.equations.n_p, n + k.size))
    rows = change[of.equations.numbers_of("touch")]
    rows.reshape(of.elements, of.form.contacts, -1, n + k.size)[:, :, BEFORE] = were[1:, None]
    by = -point.solve(of.equations.along_numbers(point.x, system.p, change))
    by_history, by_shift, shifts = by[:, :n], by[:, n:], of.touches[k, j, 1]
    shifted = np.linalg.solve(np.eye(k.size) - by_shift[shifts], (by_step + by_history)[shifts])
    return np.asarray(by_history + by_shift @ shifted)
