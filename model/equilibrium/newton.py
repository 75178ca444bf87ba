"""Newton's method on the equations of equilibrium, and continuation in the load factor.

Steps are bounded and have to contract; the branch of the arm without loads is followed up to the
full loads, in one step if that is safe. For one set of tensions or thousands: what a step costs
beside kernels and factorisations is paid once for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised, linearised, with_jacobians
from model.equilibrium.stability import stand
from model.errors import SingularError
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

Solution = Linearised | None


def newton(
    system: System, tensions: Array, load: float, states: Array, farthest: float = TURN
) -> Solution:
    """Return the equilibrium near given states (n_states,) under tensions (n_tendons,).

    As `newton_many` does, of which it is the case of one set.
    """
    return newton_many(system, tensions[None], load, states[None], farthest)[0]


def newton_many(
    system: System,
    tensions: Array,
    load: float | Array,
    guesses: Array,
    farthest: float = TURN,
    kept: Sequence[Solution] | None = None,
    looser: float = 1.0,
) -> list[Solution]:
    """Return the equilibria near guesses (N, n_states) under tensions (N, n_tendons).

    None where steps are not small or do not contract: that keeps to the branch that a guess is on.

    Parameters
    ----------
    load : float or (N,)
        The load factor.
    farthest : float
        How far a step may rotate a frame, as a change of its quaternion.
    kept : sequence of Linearised
        The equations linearised nearby, for the first steps of each; None where there are none.
    looser : float
        How many times larger the last steps may be; the root of that for how far from where they
        were linearised the equations count as such.
    """
    N, of = len(guesses), system.of
    x, last, path = np.empty((N, of.n_x)), np.zeros(N), np.full(N, np.inf)
    x[:, : of.n_tendons], x[:, of.n_tendons], x[:, of.first :] = tensions, load, guesses
    here = [near and (near.near or near) for near in kept or [None] * N]
    solutions, alive, chord = list[Solution]([None]) * N, np.arange(N), np.full(N, True)
    far = np.array([CLOSE if near is None else np.inf for near in here])
    for _ in range(STEPS):
        if not alive.size:
            break
        check_time()
        stale = [i for i in alive.tolist() if here[i] is None]
        if stale:
            chord[stale], path[stale] = False, 0.0
            for i, fresh in zip(stale, linearised(system, x[stale]), strict=True):
                here[i] = fresh
        steps = _steps(system, x[alive], [here[i] for i in alive.tolist()])
        x[alive, of.first :] += steps
        rotation, size = step_sizes(system, steps, x[alive, of.first :])
        before, level = last[alive], looser * np.where(chord[alive], LEFT, SETTLED)
        first = before == 0
        last[alive], chord[alive], path[alive] = size, True, path[alive] + size
        contracts = first | ~(size > np.maximum(CONTRACTION * before, SMALL))
        contracts &= rotation <= farthest
        converged = contracts & ((size < level) | (size**2 < level * before))
        for i in alive[converged].tolist():
            near = here[i] if path[i] < AS_GOOD * math.sqrt(looser) else None
            solutions[i] = Linearised(system, x[i].copy(), near)
        going = contracts & ~converged
        for i in alive[going & (size > np.where(first, far[alive], KEPT * before))].tolist():
            here[i] = None
        alive = alive[going]
    return solutions


def _steps(system: System, x: Array, here: Sequence[Solution]) -> Array:
    """Return Newton steps of the states (N, n_states); nan where there are none.

    At unknowns x (N, n_x), by equations linearised there or nearby.
    """
    steps = np.full((len(x), system.of.n_states), np.nan)
    for row, residual, near in zip(steps, system.residuals(x), here, strict=True):
        if near is not None and math.isfinite(residual.sum()):
            with suppress(SingularError):
                row[:] = -near.solve(residual)
    return steps


def step_sizes(system: System, steps: Array, states: Array) -> tuple[Array, Array]:
    """Return how far steps (..., n_states) rotate a frame at most, as a change of its quaternion.

    And their sizes (...), of that and of strains relative to these, curvatures to 1 / L at least.
    """
    quaternions, strains, units = _measured(system.of, system.arm.length)
    rotation = np.abs(steps[..., quaternions]).max(axis=-1)
    changes = np.abs(steps[..., strains]) / (units + np.abs(states[..., strains]))
    return rotation, np.maximum(rotation, changes.max(axis=-1))


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

    here: Linearised
    load: float
    why: str


def follow_on(at: Followed, most: float, least: float) -> Followed:
    """Follow a branch on from an equilibrium; see follow_on_many."""
    return follow_on_many([at], most, least)[0]


def follow_on_many(
    branches: Sequence[Followed], most: float, least: float, steps: Array | float = np.inf
) -> list[Followed]:
    """Follow branches of one arm on from equilibria, up to a load factor.

    A step that leads to no equilibrium is halved; the end is where it is down to `least`
    of the load factor that is reached, or where so many `steps`, for each, were tried.
    """
    at, step, tried = list(branches), np.full(len(branches), min(1.0, most)), 0
    begins_stable = list[bool | None]([None]) * len(at)
    limit = np.broadcast_to(steps, len(at))
    while True:
        going, tensions, loads, guesses = list[int](), [], [], []
        for i, (last, load, _) in enumerate(at):
            if load < most and step[i] >= least * max(load, FIRST) and tried < limit[i]:
                going.append(i)
                tensions.append(last.tensions)
                loads.append(min(most, load + float(step[i])))
                guesses.append(last.states + (loads[-1] - load) * last.by_load)
        if not going:
            return at
        check_time()
        tried += 1
        tell("percent of the loads", round(100 * min(loads) / most), 100)
        system, arguments = at[going[0]].here.system, (np.array(tensions), np.array(loads))
        heres = newton_many(system, *arguments, np.array(guesses))
        for k, (i, here) in enumerate(zip(going, heres, strict=True)):
            if here is not None and not is_near(system, at[i].here.states, here.states):
                heres[k] = None
        fresh = iter(with_jacobians([here for here in heres if here is not None]))
        heres = [here and next(fresh) for here in heres]
        are_stable = iter(stand([here for here in heres if here is not None]))
        for i, load, here in zip(going, loads, heres, strict=True):
            stable = here is not None and next(are_stable)
            if here is not None and not stable and begins_stable[i] is None:
                # What is unstable without loads, or where it begins, is not their doing.
                (begins_stable[i],) = stand([branches[i].here])
            if here is None or (not stable and begins_stable[i]):
                why = SNAPS if here is None else BUCKLES
                at[i], step[i] = at[i]._replace(why=why), (load - at[i].load) / 2
            else:
                at[i], step[i] = Followed(here, load, ""), 2 * step[i]


def is_near(system: System, before: Array, after: Array) -> bool:
    """Return whether no frame rotates by more than is followed in one step."""
    places = system.of.nodes[:, :4]
    return bool(np.abs((before[places] * after[places]).sum(axis=1)).min() > np.cos(FOLLOWED / 2))
