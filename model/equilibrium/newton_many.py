"""Newton's method for many equilibria of one arm at once: the steps of `newton`, side by side.

What a step costs beside the kernels and the factorisation is paid once for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import (
    AS_GOOD,
    CLOSE,
    CONTRACTION,
    KEPT,
    LEFT,
    SETTLED,
    SMALL,
    STEPS,
    TURN,
    strain_scale,
)
from model.errors import SingularError
from model.paths import Array
from model.time_limit import check_time
from model.transcription.system import System


class Many(NamedTuple):
    """What Newton's method comes to from N guesses.

    Attributes
    ----------
    found : list of Linearised
        The equilibria; None where steps are not small or do not shrink.
    kept : list of Linearised
        The equations as they were linearised last, on the way there.
    turned : (N,)
        How far the first step would turn a frame, as a change of its quaternion; inf if there is
        none.
    """

    found: list[Linearised | None]
    kept: list[Linearised | None]
    turned: Array


def newton_many(
    system: System,
    tensions: Array,
    guesses: Array,
    farthest: float = TURN,
    kept: Sequence[Linearised | None] | None = None,
) -> Many:
    """Return the equilibria near guesses (N, n_states) under tensions (N, n_tendons).

    As `newton` does at the full loads.

    Parameters
    ----------
    farthest : float
        How far a step may turn a frame.
    kept : sequence of Linearised
        The equations linearised nearby, for the first steps of each; None where there are none.
    """
    N, of = len(guesses), system.of
    x = np.hstack([tensions, np.ones((N, 1)), guesses])
    found: list[Linearised | None] = [None] * N
    here = list[Linearised | None](kept or [None] * N)
    used = list(here)
    begun = np.array([own is not None for own in here])
    last, first = np.zeros(N), np.full(N, np.inf)
    moved, alive = np.where(begun, np.inf, 0.0), np.arange(N)
    scale = np.tile(strain_scale(of, system.arm.length), of.elements * of.form.stages)
    stages, frames = of.stages.ravel(), of.nodes[:, :4].ravel()
    for _ in range(STEPS):
        check_time()
        own = np.array([here[i] is not None for i in alive.tolist()])
        change = np.array([_change(system, x[i], here, i) for i in alive.tolist()])
        for i in alive.tolist():
            used[i] = here[i]
        moved[alive[~own]] = 0.0
        turn = np.abs(change[:, frames]).max(axis=1)
        fresh = last[alive] == 0
        first[alive[fresh]] = np.where(np.isfinite(turn[fresh]), turn[fresh], np.inf)
        safe = turn <= farthest  # False of what is no number
        alive, own, change, turn = alive[safe], own[safe], change[safe], turn[safe]
        if not alive.size:
            break
        x[alive, of.first :] += change
        now = x[alive, of.first :][:, stages]
        sizes = (np.abs(change[:, stages]) / (scale + np.abs(now))).max(axis=1)
        size, before = np.maximum(sizes, turn), last[alive]
        moved[alive] += size
        settled = np.where(own, LEFT, SETTLED)
        done = (size < settled) | (size**2 < settled * before)
        lost = ~done & (before > 0) & (size > np.maximum(CONTRACTION * before, SMALL))
        for i in alive[done].tolist():
            found[i] = Linearised(system, x[i], here[i] if moved[i] < AS_GOOD else None)
        slow = np.where(before > 0, size > KEPT * before, (size > CLOSE) & ~begun[alive])
        for i in alive[slow].tolist():
            here[i] = None
        last[alive] = size
        alive = alive[~done & ~lost]
        if not alive.size:
            break
    return Many(found, used, first)


def _change(system: System, x: Array, here: list[Linearised | None], i: int) -> Array:
    """Return a Newton step (n_states,) by what is kept, or linearised and kept; nan if none."""
    at = Linearised(system, x.copy(), here[i])
    here[i] = at.near or at
    try:
        return -at.solve(at.residual)
    except SingularError:
        return np.full(system.of.n_states, np.nan)
