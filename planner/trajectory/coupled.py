"""Waypoints of a motion as one program: least effort or time, coupled by rates.

With tensions a_k (scaled) at the waypoints, durations d_m from target to target, of which each
waypoint on the way has its share s_k, and the constraints g_k of each waypoint alone, its targets
and inequalities with the states eliminated,

    minimise    sum effort(a_k) + w sum d_m
    subject to  g_k(a_k) within bounds            |a_k - a_(k-1)| <= rate s_k d_m
                |l(a_k) - l(a_(k-1))| <= stroke rate s_k d_m      d_m >= what is given

by sequential quadratic programming with a trust region: Hessians are exact by waypoint, so that
matrices are block-diagonal and tridiagonal, and the work grows with the number of waypoints.
Source: Nocedal, Wright, "Numerical Optimization" (2006), 18.3, 18.5 (l1 merit function).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model.paths import Array
from model.time_limit import check_time
from planner.program.reduced import Reduced
from planner.trajectory.coupling import Coupling, Here, merit
from planner.trajectory.quadratic import step
from planner.trajectory.restoration import EXACT, Stop, restored

# What constraints are met to, over their scale, where that is to be made better.
_ROUGH = 1e-8
_SMALL, _TRUST, _LEAST_TRUST = 1e-7, 0.25, 1e-7
# What a step has to gain, over what is made least.
_GAIN = 1e-4


@dataclass(frozen=True, eq=False)
class Way:
    """Scaled tensions (N, n), durations (N,) [s], multipliers of the waypoints' constraints."""

    a: Array
    durations: Array
    lam: list[Array]
    missed: float


def solved(
    stops: list[Stop],
    rough: list[Stop],
    coupling: Coupling,
    a: Array,
    steps: int,
    lam: list[Array] | None = None,
    rather: float = 1.0,
) -> Way:
    """Return the best way near scaled tensions a (N, n), after so many steps at most.

    Hessians are those of `rough` stops, the same on a mesh as coarse or coarser; `lam` are
    multipliers to begin with. With `rather` above 1 gains and constraints are as much less exact.
    """
    known = lam or [np.zeros(stop.bounds[2].size) for stop in stops]
    here, trust = _restored(stops, coupling, a, rather, [None] * len(stops)), _TRUST
    least = merit(stops, coupling, here)
    for _ in range(steps):
        check_time()
        move, new, gain = step(stops, rough, coupling, here, known, trust)
        if move is None or gain < rather * _GAIN * abs(least):
            break
        there = _restored(stops, coupling, here.a + move, rather, here.first)
        found, size = merit(stops, coupling, there), float(np.abs(move).max())
        if not found <= least + 1e-12 * (1 + abs(least)):
            trust = size / 4
            if trust < _LEAST_TRUST:
                break
            continue
        gain = least - found
        here, least, known = there, found, new
        trust = min(2 * trust, 1.0) if size > 0.9 * trust else trust
        if size < _SMALL or gain < rather * _GAIN * abs(least):
            break
    durations = coupling.durations(here)[coupling.group] * coupling.shares
    lacks = (np.abs(s.lack(at.g)).max(initial=0.0) for s, at in zip(stops, here.first, strict=True))
    return Way(here.a, durations, known, float(max(lacks)))


def _restored(
    stops: list[Stop],
    coupling: Coupling,
    a: Array,
    rather: float,
    near: Sequence[Reduced | None],
) -> Here:
    """Return where a motion stands whose waypoints are moved back to their constraints."""
    enough = EXACT if rather == 1.0 else _ROUGH
    each = zip(stops, a, near, strict=True)
    found = [restored(stop, own, enough=enough, near=known) for stop, own, known in each]
    first = [at for _, at in found]
    return Here.at(stops, coupling, np.array([own for own, _ in found]), first)
