"""Newton's method on the equations of equilibrium, by bounded steps that have to contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.equilibrium.hold import TENSIONS, Hold
from model.equilibrium.linearised import Linearised
from model.errors import SingularError
from model.paths import Array
from model.time_limit import check_time
from model.transcription.system import System

_STEPS = 14
_SETTLED = 1e-10
# A step counts as safe if it is so much smaller than the last; below _SMALL rounding may be felt.
_CONTRACTION, _SMALL = 0.25, 1e-3
# The farthest that one step turns a frame, as a change of its quaternion, and how many steps may be
# cut to that.
TURN, NEAR = 0.3, 0.02
# Steps that contract faster than this are taken with the factorisation of the step before.
_KEPT = 0.02


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

    That keeps to the branch that the states are on. The result is linearised a little before the
    last point, where the factorisation is as good.

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
    last, of, here = 0.0, system.of, kept
    for _ in range(_STEPS):
        check_time()
        x = system.x(tensions, load, states)
        step = _step(system, x, here, hold)
        if step is None:
            return None
        here, change, after = step
        turn = float(np.abs(change[of.nodes[:, :4]]).max())
        if turn > farthest:
            if last or cuts == 0:
                return None
            part = farthest / turn
            states, tensions = states + part * change, tensions + part * (after - tensions)
            cuts, here = cuts - 1, None
            continue
        states, tensions = states + change, after
        size = _size(system, change, states)
        if last and size > max(_CONTRACTION * last, _SMALL):
            return None
        if size < _SETTLED or size**2 < _SETTLED * last:
            return replace(here, x=system.x(tensions, load, states))
        if size > _KEPT * last or not last:
            here = None if kept is None or last else here
        last = size
    return None


def _step(
    system: System, x: Array, kept: Linearised | None, hold: Hold
) -> tuple[Linearised, Array, Array] | None:
    """Return where the equations were linearised, a Newton step, and the tensions after it.

    None where there is none.
    """
    here = kept or Linearised.at(system, x)
    residual = system.residual(x) if kept else here.residual
    if not np.all(np.isfinite(residual)) or not np.all(np.isfinite(here.nonzeros)):
        return None
    try:
        change = -here.solve(residual)
    except SingularError:
        return None
    if not np.all(np.isfinite(change)):
        return None
    now = x[: system.of.n_tendons]
    after = hold.tensions(here, change, now)
    if after is None:
        return None
    return here, change if after is now else change + here.by_tensions @ (after - now), after


def _size(system: System, change: Array, states: Array) -> float:
    """Return the size of a step, relative to strains and quaternions or to 1 / L and 1."""
    of, L = system.of, system.arm.length
    scale = np.where(np.arange(of.form.strains) < 2 + of.form.law.torsion, 1 / L, 1.0)
    moved, now = change[of.stages] / scale, states[of.stages] / scale
    turned = change[of.nodes[:, :4]]
    return max(float((np.abs(moved) / (1 + np.abs(now))).max()), float(np.abs(turned).max()))
