"""Newton's method on the equations of equilibrium, and continuation in the load factor.

Steps are bounded and have to contract; the branch of the arm without loads is followed up to the
full loads, in one step if that is safe.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stands
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.kernel import Places
from model.transcription.layout import Layout
from model.transcription.system import System

STEPS = 14
# The size of the last step: larger where its factorisation is of the same point, as the next one
# would be its square.
SETTLED, LEFT = 1e-10, 1e-13
# A step counts as safe if it is so much smaller than the last; below SMALL rounding may be felt.
CONTRACTION, SMALL = 0.5, 1e-3
# The farthest that one step rotates a frame, as a change of its quaternion; from guesses by another
# mesh.
TURN, NEAR = 0.3, 0.02
# The factorisation is kept after a step so small, and as long as steps contract so fast: a residual
# costs a tenth of a factorised Jacobian.
CLOSE, KEPT = 0.02, 0.1
# An equilibrium as near to where the equations were linearised has their derivatives.
AS_GOOD = 1e-5


def newton(
    system: System,
    tensions: Array,
    load: float,
    states: Array,
    farthest: float = TURN,
    near: Linearised | None = None,
    looser: float = 1.0,
) -> Linearised | None:
    """Return the equilibrium near given states (n_states,) under tensions (n_tendons,).

    None where steps are not small or do not contract: that keeps to the branch of the states.

    Parameters
    ----------
    farthest : float
        How far one step may rotate a frame.
    near : Linearised
        The equations linearised nearby, whose factorisation is begun with.
    looser : float
        How many times larger the last steps may be; the root of that for how far from where they
        were linearised the equations count as such.
    """
    near = near and (near.near or near)
    x, before, path = system.x(tensions, load, states), 0.0, np.inf
    far = CLOSE if near is None else np.inf
    for _ in range(STEPS):
        check_time()
        point = Linearised(system, x, near)
        step = point.newton_step()
        if step is None:
            return None
        path = 0.0 if near is None else path
        level = looser * (SETTLED if near is None else LEFT)
        near = point.near or point
        x = system.x(tensions, load, point.states + step)
        rotation, size = step_sizes(system, step, x[system.of.first :])
        path += size
        if rotation > farthest or (before and size > max(CONTRACTION * before, SMALL)):
            return None
        if size < level or size**2 < level * before:
            is_close = path < AS_GOOD * math.sqrt(looser)
            return Linearised(system, x, near if is_close else None)
        if size > (KEPT * before if before else far):
            near = None
        before = size
    return None


def step_sizes(system: System, step: Array, states: Array) -> tuple[float, float]:
    """Return how far a step (n_states,) rotates a frame at most, as a change of its quaternion.

    And its size, of that and of strains relative to these, curvatures to 1 / L at least.
    """
    quaternions, strains, units = _measured(system.of, system.arm.length)
    rotation = float(np.abs(step[quaternions]).max())
    changes = np.abs(step[strains]) / (units + np.abs(states[strains]))
    return rotation, max(rotation, float(changes.max()))


@lru_cache(maxsize=32)
def _measured(of: Layout, length: float) -> tuple[Places, Places, Array]:
    """Return the places of quaternions and of strains among the states, and units of the latter."""
    curvatures = np.arange(of.form.strains) < 2 + of.form.law.torsion
    units = np.tile(np.where(curvatures, 1 / length, 1.0), len(of.stages))
    return of.nodes[:, :4].ravel(), of.stages.ravel(), units


# The least step in the load factor over what is reached; before the first step, over a millionth.
LEAST_STEP, FIRST = 1 / 8192, 1e-6
# The farthest that a frame may rotate in one step of the load factor [rad].
FOLLOWED = 1.2
SNAPS, BUCKLES = "it snaps or folds", "it buckles"


class Followed(NamedTuple):
    """The last equilibrium on a branch, the load factor there, and what happens beyond."""

    point: Linearised
    load: float
    why: str


def follow_on(
    start: Followed, most: float, least: float, steps: float = np.inf, looser: float = 1.0
) -> Followed:
    """Follow a branch on from an equilibrium, up to a load factor.

    A step that leads to no equilibrium is halved; the end is where it is down to `least`
    of the load factor that is reached, or where so many `steps` were tried. `looser` is newton's.
    """
    at, step, tried, system = start, min(1.0, most), 0, start.point.system
    begins_stable: bool | None = None
    while at.load < most and step >= least * max(at.load, FIRST) and tried < steps:
        check_time()
        tried += 1
        tell("percent of the loads", round(100 * at.load / most), 100)
        load = min(most, at.load + step)
        guess = at.point.states + (load - at.load) * at.point.by_load
        point = newton(system, at.point.tensions, load, guess, looser=looser)
        if point is not None and not is_near(system, at.point.states, point.states):
            point = None
        stable = point is not None and stands(point)
        if point is not None and not stable and begins_stable is None:
            # What is unstable without loads, or where it begins, is not their doing.
            begins_stable = stands(start.point)
        if point is None or (not stable and begins_stable):
            why = SNAPS if point is None else BUCKLES
            at, step = at._replace(why=why), (load - at.load) / 2
        else:
            at, step = Followed(point, load, ""), 2 * step
    return at


def is_near(system: System, before: Array, after: Array) -> bool:
    """Return whether no frame rotates by more than is followed in one step."""
    places = system.of.nodes[:, :4]
    return bool(np.abs((before[places] * after[places]).sum(axis=1)).min() > np.cos(FOLLOWED / 2))
