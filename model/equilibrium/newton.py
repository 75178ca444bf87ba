"""Newton's method on the equations of equilibrium, by bounded steps that have to contract."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from model.equilibrium.hold import TENSIONS, Hold
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.time_limit import check_time
from model.transcription.layout import Layout
from model.transcription.system import System

STEPS = 14
# Steps are done with that leave so much of strains and quaternions: of the step itself if its
# factorisation is its own, as the next one would be its square.
SETTLED, LEFT = 1e-10, 1e-13
# A step counts as safe if it is so much smaller than the last; below SMALL rounding may be felt.
CONTRACTION, SMALL = 0.25, 1e-3
# The farthest that one step turns a frame, as a change of its quaternion, and how many steps may be
# cut to that.
TURN, NEAR = 0.3, 0.02
# The factorisation is kept after a step so small, and as long as steps contract so fast: a residual
# costs a tenth of a factorised Jacobian.
CLOSE, KEPT = 0.02, 0.1
# Where an equilibrium is so near to where it was linearised, that does for its derivatives.
AS_GOOD = 1e-5


def newton(
    system: System,
    tensions: Array,
    load: float,
    states: Array,
    farthest: float = TURN,
    cuts: int = 0,
    kept: Linearised | None = None,
    hold: Hold = TENSIONS,
) -> Linearised | None:
    """Return the equilibrium near given states, None where steps are not small or do not shrink.

    That keeps to the branch that the states are on.

    Parameters
    ----------
    farthest : float
        How far a step may turn a frame.
    cuts : int
        How many steps may be shortened to that; others that are farther lead nowhere.
    kept : Linearised
        The equations linearised nearby, for the first steps.
    hold : Hold
        What is held; where lengths are, the tensions are those to begin with.
    """
    last, of, here, moved = 0.0, system.of, kept, np.inf
    for _ in range(STEPS):
        check_time()
        x = system.x(tensions, load, states)
        step = _step(system, x, here, hold)
        if step is None:
            return None
        settled, moved = (LEFT, moved) if here else (SETTLED, 0.0)
        here, change, after = step
        here = here.near or here
        turn = float(np.abs(change[of.nodes[:, :4]]).max())
        if turn > farthest:
            if last or cuts == 0:
                return None
            part = farthest / turn
            states, tensions = states + part * change, tensions + part * (after - tensions)
            cuts, here = cuts - 1, None
            continue
        states, tensions = states + change, after
        size = step_size(system, change, states)
        if last and size > max(CONTRACTION * last, SMALL):
            return None
        moved += size
        creeps = CONTRACTION * last < size < hold.creep and last > 0
        if size < settled or size**2 < settled * last or creeps:
            x = system.x(tensions, load, states)
            return Linearised(system, x, here if moved < AS_GOOD else None)
        if size > (KEPT * last if last else CLOSE) and (last or kept is None):
            here = None
        last = size
    return None


def _step(
    system: System, x: Array, kept: Linearised | None, hold: Hold
) -> tuple[Linearised, Array, Array] | None:
    """Return the equations linearised, a Newton step, and the tensions after it.

    None where there is none.
    """
    here = Linearised(system, x, kept)
    change = here.newton_step()
    if change is None:
        return None
    now = x[: system.of.n_tendons]
    after = hold.tensions(here, change, now)
    if after is None:
        return None
    return here, change if after is now else change + here.by_tensions @ (after - now), after


def step_size(system: System, change: Array, states: Array) -> float:
    """Return the size of a step, relative to strains and quaternions or to 1 / L and 1."""
    of = system.of
    scale = strain_scale(of, system.arm.length)
    moved, now = change[of.stages] / scale, states[of.stages] / scale
    turned = change[of.nodes[:, :4]]
    return max(float((np.abs(moved) / (1 + np.abs(now))).max()), float(np.abs(turned).max()))


@lru_cache(maxsize=64)
def strain_scale(of: Layout, length: float) -> Array:
    """Return what strains (strains,) are counted in: curvatures in 1 / L."""
    return np.where(np.arange(of.form.strains) < 2 + of.form.law.torsion, 1 / length, 1.0)
