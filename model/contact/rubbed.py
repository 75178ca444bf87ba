"""How an equilibrium that friction led to moves with the tensions at the end of its way.

Along the way x_k is the equilibrium under T_k = T_0 + t_k (T - T_0), and friction looks back to
where the arm was a step before: r(x_k, T_k, u_{k-1}) = 0. So with D_k = dx_k / dT

    D_k = t_k dx/dT (T_k) - (dr/dx)^-1 dr/du_{k-1} (du/dx D_{k-1}),

from D_0 = 0 on. That normals turn as a point moves along the arm is left out of its history.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from model.contact.between import between_nodes
from model.contact.history import History
from model.contact.touches import Touches
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.transcription.touch import BEFORE, FRICTION

# Equilibria on a way, and at which shares of it they are.
Way = Sequence[tuple[Linearised, float]]
# Steps of differences in where nodes were, and along the arm, over its length.
_STEP, _ALONG = 1e-7, 1e-4


@dataclass(frozen=True, eq=False)
class Led(Linearised):
    """An equilibrium that moves with the tensions as all of its way does.

    Attributes
    ----------
    moved : (n_states, n_tendons)
    """

    moved: Array = field(kw_only=True)

    @property
    def by_tensions(self) -> Array:
        """See Linearised.by_tensions."""
        return self.moved


def led(way: Way) -> Led:
    """Return the equilibrium at the end of a way."""
    before: Linearised | None = None
    moved: Array = np.empty(0)
    for here, share in way:
        after = share * here.by_tensions
        if before is not None:
            after = _carried(before, moved, here, after)
        before, moved = here, after
    assert before is not None
    return Led(before.system, before.x, moved=moved)


def _carried(before: Linearised, moved: Array, here: Linearised, after: Array) -> Array:
    """Return how states move (n_states, n_tendons) in all, `after` by the last step alone.

    As where the arm was before does. A point that moves along the arm looks back to another place
    of it, by the angle between the arm's tangents then and now.
    """
    system, touches = here.system, Touches.of(here.system)
    own = np.flatnonzero((touches.held | touches.inside).any(axis=1))
    if not own.size:
        return after
    s, places = system.mesh.s[own], before.system.of.nodes[:, 4:7]
    were = between_nodes(before.system.mesh.s, moved[places], s)
    by_before = _by_before(here, own.tolist())
    after = after + by_before @ were.reshape(3 * own.size, -1)
    point, j = np.nonzero(touches.point[own])
    rolled = _tangents(here, s[point]) - _tangents(before, s[point])
    by_shift = -np.einsum("nki,ki->nk", by_before.reshape(-1, own.size, 3)[:, point], rolled)
    shifts = system.of.touches[own[point], j, 1]
    found = np.linalg.solve(np.eye(point.size) - by_shift[shifts], after[shifts])
    return np.asarray(after + by_shift @ found)


def _tangents(here: Linearised, s: Array) -> Array:
    """Return the derivatives (k, 3) of the midline by arc length, on the base side of s (k,)."""
    places, step = History(here).places, _ALONG * here.system.arm.length
    return np.asarray((places(s) - places(s - step)) / step)


def _by_before(here: Linearised, nodes: list[int]) -> Array:
    """Return how states move (n_states, 3 k) with where some nodes were before."""
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
