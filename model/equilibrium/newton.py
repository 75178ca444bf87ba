"""Newton's method on the equations of equilibrium, by bounded steps that have to contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.equilibrium.linearised import Linearised
from model.errors import SingularError
from model.paths import Array
from model.patience import check_time
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
    """
    last, of, here = 0.0, system.of, kept
    for _ in range(_STEPS):
        check_time()
        x = system.x(tensions, load, states)
        here, change = _step(system, x, here)
        if here is None or change is None:
            return None
        turn = float(np.abs(change[of.nodes[:, :4]]).max())
        if turn > farthest:
            if last or cuts == 0:
                return None
            states, cuts, here = states + change * (farthest / turn), cuts - 1, None
            continue
        states = states + change
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
    system: System, x: Array, kept: Linearised | None
) -> tuple[Linearised | None, Array | None]:
    """Return where the equations were linearised, and a Newton step; None where there is none."""
    here = kept or Linearised.at(system, x)
    residual = system.residual(x) if kept else here.residual
    if not np.all(np.isfinite(residual)) or not np.all(np.isfinite(here.nonzeros)):
        return None, None
    try:
        change = -here.solve(residual)
    except SingularError:
        return None, None
    return here, change if np.all(np.isfinite(change)) else None


def _size(system: System, change: Array, states: Array) -> float:
    """Return the size of a step, relative to strains and quaternions or to 1 / L and 1."""
    of, L = system.of, system.arm.length
    scale = np.where(np.arange(of.form.strains) < 2 + of.form.law.torsion, 1 / L, 1.0)
    moved, now = change[of.stages] / scale, states[of.stages] / scale
    turned = change[of.nodes[:, :4]]
    return max(float((np.abs(moved) / (1 + np.abs(now))).max()), float(np.abs(turned).max()))
