"""The equilibrium under the full loads: from the arm without them, in one step if that is safe.

For one set of tensions or thousands, whose branches are followed side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Linearised, linearised, with_jacobians
from model.equilibrium.newton import NEAR, Solution, newton, newton_many
from model.equilibrium.stability import stand
from model.errors import SnapError
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System

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
