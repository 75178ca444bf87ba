"""Newton's method on the equations of equilibrium, and continuation in the load factor.

Steps are bounded and have to contract; the branch of the arm without loads is followed up to the
full loads, in one step if that is safe. For one set of tensions or thousands: what a step costs
beside kernels and factorisations is paid once for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised, linearised, with_jacobians
from model.equilibrium.stability import stand
from model.errors import SingularError, SnapError
from model.paths import Array
from model.progress import tell
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
    """Places of strains (n,) and quaternions (m,) among the states, and units of the strains.

    Curvatures are counted in 1 / L.
    """

    stages: Places
    frames: Places
    scale: Array


def _measures(of: Layout, length: float) -> _Measures:
    curvatures = np.arange(of.form.strains) < 2 + of.form.law.torsion
    scale = np.tile(np.where(curvatures, 1 / length, 1.0), of.elements * of.form.stages)
    return _Measures(of.stages.ravel(), of.nodes[:, :4].ravel(), scale)


def step_size(system: System, change: Array, states: Array) -> float:
    """Return the size of a step, relative to strains and quaternions or to 1 / L and 1."""
    at = _measures(system.of, system.arm.length)
    moved = np.abs(change[at.stages]) / (at.scale + np.abs(states[at.stages]))
    return max(float(moved.max()), float(np.abs(change[at.frames]).max()))


# The least step in the load factor over what is reached; before the first step, over a millionth.
LEAST_STEP, FIRST = 1 / 8192, 1e-6
# The farthest that a frame may turn in one step [rad].
FOLLOWED = 1.2
SNAPS, BUCKLES = "it snaps or folds", "it buckles"


class Followed(NamedTuple):
    """The last equilibrium on a branch, the load factor there, and what happens beyond."""

    here: Linearised
    load: float
    why: str


def near(system: System, tensions: Array, states: Array) -> Solution:
    """Return the equilibrium under the full loads near states that may be of another mesh."""
    return newton(system, tensions, 1.0, states, NEAR)


def by_load_steps(
    system: System, tensions: Array, unloaded: Array, steps: Array
) -> list[Linearised | SnapError]:
    """Return the equilibria under the full loads that are connected with the unloaded arm's states.

    Of tensions (N, n_tendons) and states (N, n_states). A SnapError says where a branch ends or
    loses its stability before, or takes more than its `steps` (N,).
    """
    found = list[Linearised | SnapError]()
    x = [system.x(T, 0.0, states) for T, states in zip(tensions, unloaded, strict=True)]
    starts = linearised(system, np.array(x)) if x else []
    branches = [Followed(start, 0.0, "") for start in starts]
    for end in follow_on_many(branches, 1.0, LEAST_STEP, steps):
        found.append(end.here if end.load >= 1 else SnapError(end.load, end.why or SNAPS))
    return found


def follow(system: System, tensions: Array, unloaded: Array, most: float, least: float) -> Followed:
    """Follow the branch that begins at the unloaded arm's states, up to a load factor.

    See follow_on.
    """
    start = Linearised(system, system.x(tensions, 0.0, unloaded))
    return follow_on(Followed(start, 0.0, ""), most, least)


def follow_on(at: Followed, most: float, least: float) -> Followed:
    """Follow a branch on from an equilibrium; see follow_on_many."""
    return follow_on_many([at], most, least)[0]


def follow_on_many(
    branches: Sequence[Followed], most: float, least: float, steps: Array | float = np.inf
) -> list[Followed]:
    """Follow branches of one arm on from equilibria, up to a load factor.

    A step is halved where nothing is found that it leads to; the end is where it is down to `least`
    of the load factor that is reached, or where so many `steps`, for each, were tried.
    """
    at, step, tried = list(branches), np.full(len(branches), min(1.0, most)), 0
    stood, limit = list[bool | None]([None]) * len(at), np.broadcast_to(steps, len(at))
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
        system, given = at[going[0]].here.system, (np.array(tensions), np.array(loads))
        heres = newton_many(system, *given, np.array(guesses)).solutions
        for k, (i, here) in enumerate(zip(going, heres, strict=True)):
            if here is not None and not is_near(system, at[i].here.states, here.states):
                heres[k] = None
        linear = iter(with_jacobians([here for here in heres if here is not None]))
        heres = [here and next(linear) for here in heres]
        firm = iter(stand([here for here in heres if here is not None]))
        for i, load, here in zip(going, loads, heres, strict=True):
            stable = here is not None and next(firm)
            if here is not None and not stable and stood[i] is None:
                # What is unstable without loads, or where it begins, is not their doing.
                (stood[i],) = stand([branches[i].here])
            if here is None or (not stable and stood[i]):
                why = SNAPS if here is None else BUCKLES
                at[i], step[i] = at[i]._replace(why=why), (load - at[i].load) / 2
            else:
                at[i], step[i] = Followed(here, load, ""), 2 * step[i]


def is_near(system: System, before: Array, after: Array) -> bool:
    """Return whether no frame turns by more than is followed in one step."""
    places = system.of.nodes[:, :4]
    return bool(np.abs((before[places] * after[places]).sum(axis=1)).min() > np.cos(FOLLOWED / 2))
