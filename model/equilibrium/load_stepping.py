"""The equilibrium under the full loads: at once where that is safe, else by steps in the loads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from model.equilibrium.hold import TENSIONS, Hold
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import NEAR, newton
from model.errors import SnapError
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System

# The least step in the load factor over what is reached; before the first step, over a millionth.
LEAST_STEP, FIRST = 1 / 8192, 1e-6
# The farthest that a frame may turn in one step [rad].
FOLLOWED = 0.6
# Steps from the unloaded arm that may be shortened before loads are applied in steps.
CUTS = 2
SNAPS, BUCKLES = "it snaps or folds", "it buckles"


class Followed(NamedTuple):
    """The last equilibrium on a branch, the load factor there, and what happens beyond."""

    here: Linearised
    load: float
    why: str


def near(
    system: System, tensions: Array, states: Array, hold: Hold = TENSIONS
) -> Linearised | None:
    """Return the equilibrium under the full loads near states that may be of another mesh."""
    return newton(system, tensions, 1.0, states, NEAR, hold=hold)


def at_once(
    system: System, tensions: Array, unloaded: Array, hold: Hold = TENSIONS
) -> Linearised | None:
    """Return the equilibrium under the full loads by Newton steps from the unloaded arm's states.

    Where lengths are held, `tensions` are those of the unloaded arm. None where they lead nowhere,
    or to an equilibrium that does not stand though the unloaded arm does.
    """
    here = newton(system, tensions, 1.0, unloaded, cuts=CUTS, hold=hold)
    if here is None or hold.stands(here):
        return here
    return None if _stands_unloaded(system, tensions, unloaded, hold) else here


def by_load_steps(
    system: System,
    tensions: Array,
    unloaded: Array,
    hold: Hold = TENSIONS,
    steps: float = np.inf,
) -> Linearised:
    """Return the equilibrium under the full loads that is connected with the unloaded arm's states.

    Where lengths are held, `tensions` are those of the unloaded arm.
    Raises SnapError where that branch ends or loses its stability before, or takes more `steps`.
    """
    found = follow(system, tensions, unloaded, 1.0, LEAST_STEP, hold, steps)
    if found.load < 1:
        raise SnapError(found.load, found.why)
    return found.here


def follow(
    system: System,
    tensions: Array,
    unloaded: Array,
    most: float,
    least: float,
    hold: Hold = TENSIONS,
    steps: float = np.inf,
) -> Followed:
    """Follow the branch that begins at the unloaded arm's states, up to a load factor.

    A step is halved where nothing is found that it leads to; the end is where it is down to `least`
    of the load factor that is reached, or where so many steps were tried.
    """
    start = newton(system, tensions, 0.0, unloaded, hold=hold)
    if start is None:
        raise SnapError(0.0, SNAPS)
    return follow_on(Followed(start, 0.0, ""), most, least, hold, steps)


def follow_on(
    at: Followed, most: float, least: float, hold: Hold = TENSIONS, steps: float = np.inf
) -> Followed:
    """Follow a branch on from an equilibrium, up to a load factor; see follow."""
    system, step, stood = at.here.system, min(1.0, most), hold.stands(at.here)
    while at.load < most and step >= least * max(at.load, FIRST) and steps > 0:
        check_time()
        steps -= 1
        tell("percent of the loads", round(100 * at.load / most), 100)
        load = min(most, at.load + step)
        found, why = _next(system, at, load, stood, hold)
        if found is None:
            at, step = at._replace(why=why), (load - at.load) / 2
        else:
            at, step = Followed(found, load, ""), 2 * step
    return at


def _next(
    system: System, at: Followed, load: float, stood: bool, hold: Hold
) -> tuple[Linearised | None, str]:
    """Return the equilibrium that a step in the load leads to, or why there is none.

    It has to stand if the unloaded arm `stood`: what is unstable without loads is not their doing.
    """
    before, pulls = at.here, hold.by_load(at.here)
    by_load = before.by_load + before.by_tensions @ pulls if pulls.any() else before.by_load
    tensions = np.maximum(before.tensions + (load - at.load) * pulls, 0.0)
    predicted = before.states + (load - at.load) * by_load
    here = newton(system, tensions, load, predicted, hold=hold)
    if here is None or not is_near(system, before.states, here.states):
        return None, SNAPS
    return (here, "") if not stood or hold.stands(here) else (None, BUCKLES)


def _stands_unloaded(system: System, tensions: Array, unloaded: Array, hold: Hold) -> bool:
    """Return whether the arm stands without its loads: cross-sections may be at no minimum."""
    start = newton(system, tensions, 0.0, unloaded, hold=hold)
    return start is None or hold.stands(start)


def is_near(system: System, before: Array, after: Array) -> bool:
    """Return whether no frame turns by more than is followed in one step."""
    places = system.of.nodes[:, :4]
    return bool(np.abs((before[places] * after[places]).sum(axis=1)).min() > np.cos(FOLLOWED / 2))
