"""Newton's method for many equilibria of one arm at once: the steps of `newton`, side by side.

What a step costs beside the kernels and the factorisation is paid once for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised, linearised
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
    looser: float | Array = 1.0,
) -> Many:
    """Return the equilibria near guesses (N, n_states) under tensions (N, n_tendons).

    As `newton` does at the full loads.

    Parameters
    ----------
    farthest : float
        How far a step may turn a frame.
    kept : sequence of Linearised
        The equations linearised nearby, for the first steps of each; None where there are none.
    looser : float or (N,)
        How many times larger than of `newton` the steps are that are done with; the root of that
        for how far from where they were linearised the equations count as such.
    """
    N, of = len(guesses), system.of
    x = np.hstack([tensions, np.ones((N, 1)), guesses])
    found: list[Linearised | None] = [None] * N
    here = [own and (own.near or own) for own in kept or [None] * N]
    used = list(here)
    begun = np.array([own is not None for own in here])
    last, first, slack = np.zeros(N), np.full(N, np.inf), np.broadcast_to(looser, N)
    moved, alive = np.where(begun, np.inf, 0.0), np.arange(N)
    as_good = AS_GOOD * np.sqrt(slack)
    scale = np.tile(strain_scale(of, system.arm.length), of.elements * of.form.stages)
    stages, frames = of.stages.ravel(), of.nodes[:, :4].ravel()
    for _ in range(STEPS):
        check_time()
        own = np.array([here[i] is not None for i in alive.tolist()])
        _linearise(system, x, here, alive[~own].tolist())
        change = _changes(system.residuals(x[alive]), [here[i] for i in alive.tolist()])
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
        settled = np.where(own, LEFT, SETTLED) * slack[alive]
        done = (size < settled) | (size**2 < settled * before)
        lost = ~done & (before > 0) & (size > np.maximum(CONTRACTION * before, SMALL))
        for i in alive[done].tolist():
            found[i] = Linearised(system, x[i], here[i] if moved[i] < as_good[i] else None)
        slow = np.where(before > 0, size > KEPT * before, (size > CLOSE) & ~begun[alive])
        for i in alive[slow].tolist():
            here[i] = None
        last[alive] = size
        alive = alive[~done & ~lost]
        if not alive.size:
            break
    return Many(found, used, first)


def _linearise(system: System, x: Array, here: list[Linearised | None], which: list[int]) -> None:
    """Linearise some of the equations where they are."""
    for i, own in zip(which, linearised(system, x[which]), strict=True):
        here[i] = own


def _changes(residuals: Array, here: Sequence[Linearised | None]) -> Array:
    """Return a Newton step (n_states,) for each of residuals (N, n_states); nan if none."""
    found = np.full_like(residuals, np.nan)
    for row, residual, own in zip(found, residuals, here, strict=True):
        if own is None:
            continue
        with suppress(SingularError):
            row[:] = -own.solve(residual)
    return found
