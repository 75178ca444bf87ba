"""A step of Newton's method after which forces do not pull, and no gap closes beyond 0.

The equations are linearised, with gaps as the equations of the nodes that touch and forces that
vanish as those of others. Where a force would pull, or a gap close beyond 0, what touches is found
from the linear complementarity problem of these: Newton's method for the nonlinear one (Josephy,
Univ. of Wisconsin MRC report 1965, 1979). The obstacles are convex, so that a node that stays
outside of the tangent plane stays outside of the obstacle: no step passes through.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.contact.gaps import Gaps
from model.contact.touches import Touches
from model.equilibrium.complementarity import complementary
from model.equilibrium.linearised import Linearised
from model.paths import Array

# Gaps up to this many times what a step closes may close with it.
_NEAR = 3.0
# Forces [N] and gaps [m] below this share of the largest are rounding.
_ROUNDING = 1e-13


def complementary_step(
    here: Linearised, touches: Touches, fixed: bool = False
) -> tuple[Array, Touches] | None:
    """Return a step of Newton's method and what touches after it; None where there is none.

    Of touches only points change, unless all are `fixed`.
    """
    change = here.newton_step()
    if change is None:
        return None
    if fixed:
        return change, touches
    return _exchanged(here, change, touches)


def _exchanged(here: Linearised, change: Array, touches: Touches) -> tuple[Array, Touches] | None:
    """Return a step whose forces and gaps are complementary, and what touches after it."""
    of, states = here.system.of, here.states
    gaps = Gaps.of(here.system, states)
    places = of.touches[1:, :, 0]
    force, closing = (states + change)[places], gaps.moved(change)
    gap = gaps.gap + closing
    held, free = touches.point[1:], ~(touches.point | touches.end | touches.inside)[1:]
    least = _ROUNDING * np.abs(force).max(initial=0.0), _ROUNDING * here.system.arm.length
    if not ((held & (force < -least[0])) | (free & (gap < -least[1]))).any():
        return change, touches
    near = free & (gap < _NEAR * np.abs(closing).max())
    which = np.nonzero(held | near)
    n, was = which[0].size, held[which]
    unit = np.zeros((of.n_states, n), order="F")
    unit[places[which], np.arange(n)] = 1.0
    moved = here.solve(unit)
    M = np.where(was[:, None], moved[places[which]], gaps.moved(moved)[which])
    q = np.where(was, force[which], gap[which])
    z = complementary(M, q, np.zeros(n, dtype=bool))
    if z is None:
        return None
    point = touches.point.copy()
    point[1:][which] ^= z > 0
    return change + moved @ z, replace(touches, point=point)
