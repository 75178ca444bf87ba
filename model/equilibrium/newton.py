"""Newton's method on the equations of equilibrium, by bounded steps that have to contract.

For one set of tensions or thousands: what a step costs beside kernels and factorisations is paid
once for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised
from model.errors import SingularError
from model.paths import Array
from model.time_limit import check_time
from model.transcription.kernel import Places
from model.transcription.layout import Layout
from model.transcription.system import System

STEPS = 14
# Steps are done with that leave so much of strains and quaternions: of the step itself if its
# factorisation is its own, as the next one would be its square.
SETTLED, LEFT = 1e-10, 1e-13
# A step counts as safe if it is so much smaller than the last; below SMALL rounding may be felt.
CONTRACTION, SMALL = 0.5, 1e-3
# The farthest that one step turns a frame, as a change of its quaternion; from guesses by another
# mesh.
TURN, NEAR = 0.3, 0.02
# The factorisation is kept after a step so small, and as long as steps contract so fast: a residual
# costs a tenth of a factorised Jacobian.
CLOSE, KEPT = 0.02, 0.1
# Where an equilibrium is so near to where it was linearised, that does for its derivatives.
AS_GOOD = 1e-5

Solution = Linearised | None


class Solutions(NamedTuple):
    """What Newton's method comes to from N guesses.

    Attributes
    ----------
    solutions : list of Linearised
        The equilibria; None where steps are not small or do not shrink.
    last : list of Linearised
        The equations as they were linearised last, on the way there.
    turned : (N,)
        How far the first step would turn a frame, as a change of its quaternion; inf if there is
        none.
    """

    solutions: list[Solution]
    last: list[Solution]
    turned: Array


def newton(
    system: System,
    tensions: Array,
    load: float,
    states: Array,
    farthest: float = TURN,
    kept: Linearised | None = None,
) -> Solution:
    """Return the equilibrium near given states (n_states,) under tensions (n_tendons,).

    As `newton_many` does, of which it is the case of one set.
    """
    given = tensions[None], load, states[None], farthest, [kept]
    return newton_many(system, *given).solutions[0]


def newton_many(
    system: System,
    tensions: Array,
    load: float | Array,
    guesses: Array,
    farthest: float = TURN,
    kept: Sequence[Solution] | None = None,
    looser: float | Array = 1.0,
) -> Solutions:
    """Return the equilibria near guesses (N, n_states) under tensions (N, n_tendons).

    None where steps are not small or do not shrink: that keeps to the branch that a guess is on.

    Parameters
    ----------
    load : float or (N,)
        The load factor.
    farthest : float
        How far a step may turn a frame; one that is farther leads nowhere.
    kept : sequence of Linearised
        The equations linearised nearby, for the first steps of each; None where there are none.
    looser : float or (N,)
        How many times larger the steps are that are done with; the root of that for how far from
        where they were linearised the equations count as such.
    """
    N, of = len(guesses), system.of
    at, x = _measures(of, system.arm.length), np.empty((N, of.n_x))
    x[:, : of.n_tendons], x[:, of.n_tendons], x[:, of.first :] = tensions, load, guesses
    slack = np.broadcast_to(looser, N).tolist()
    here: list[Solution] = [own and (own.near or own) for own in kept or [None] * N]
    last_used, solutions = list(here), list[Solution]([None]) * N
    begun, chord = np.array([own is not None for own in here]), np.full(N, True)
    last, moved, turned = np.zeros(N), np.full(N, np.inf), np.full(N, np.inf)
    alive = list(range(N))
    for _ in range(STEPS):
        if not alive:
            break
        check_time()
        fresh = [i for i in alive if here[i] is None]
        if fresh:
            chord[fresh], moved[fresh] = False, 0.0
            for i, nonzeros in zip(fresh, system.jacobians(x[fresh]), strict=True):
                here[i] = last_used[i] = Linearised(system, x[i].copy(), jacobian=nonzeros)
        states = _steps(system, x[alive], [here[i] for i in alive])
        x[alive, of.first :] += states
        turns = np.abs(states[:, at.frames]).max(axis=1)
        now = np.abs(x[alive, of.first :][:, at.stages])
        changes = np.abs(states[:, at.stages]) / (at.scale + now)
        sizes, going = np.maximum(turns, changes.max(axis=1)).tolist(), []
        for i, turn, size in zip(alive, turns.tolist(), sizes, strict=True):
            before, by_chord = float(last[i]), bool(chord[i])
            if not before and math.isfinite(turn):
                turned[i] = turn
            if not turn <= farthest:
                continue
            last[i], chord[i], moved[i] = size, True, moved[i] + size
            if before and size > max(CONTRACTION * before, SMALL):
                continue
            settled = (LEFT if by_chord else SETTLED) * slack[i]
            if size < settled or size**2 < settled * before:
                near = here[i] if moved[i] < AS_GOOD * math.sqrt(slack[i]) else None
                solutions[i] = Linearised(system, x[i].copy(), near)
                continue
            if size > (KEPT * before if before else CLOSE) and (before or not begun[i]):
                here[i] = None
            going.append(i)
        alive = going
    return Solutions(solutions, last_used, turned)


def _steps(system: System, x: Array, here: Sequence[Solution]) -> Array:
    """Return Newton steps of the states (N, n_states); nan where there are none.

    At unknowns x (N, n_x), by equations linearised there or nearby.
    """
    found = np.full((len(x), system.of.n_states), np.nan)
    for row, residual, own in zip(found, system.residuals(x), here, strict=True):
        if own is not None and math.isfinite(residual.sum()):
            with suppress(SingularError):
                row[:] = -own.solve(residual)
    return found


class _Measures(NamedTuple):
    """Places of strains (n,) and quaternions (m,) among the states; what strains are counted in."""

    stages: Places
    frames: Places
    scale: Array


@lru_cache(maxsize=64)
def _measures(of: Layout, length: float) -> _Measures:
    scale = np.tile(strain_scale(of, length), of.elements * of.form.stages)
    return _Measures(of.stages.ravel(), of.nodes[:, :4].ravel(), scale)


def step_size(system: System, change: Array, states: Array) -> float:
    """Return the size of a step, relative to strains and quaternions or to 1 / L and 1."""
    at = _measures(system.of, system.arm.length)
    moved = np.abs(change[at.stages]) / (at.scale + np.abs(states[at.stages]))
    return max(float(moved.max()), float(np.abs(change[at.frames]).max()))


@lru_cache(maxsize=64)
def strain_scale(of: Layout, length: float) -> Array:
    """Return what strains (strains,) are counted in: curvatures in 1 / L."""
    return np.where(np.arange(of.form.strains) < 2 + of.form.law.torsion, 1 / length, 1.0)
