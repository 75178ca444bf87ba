"""Where the search for plans in contact begins: tensions from which steps lead to optima.

Arms that meet the targets without contact, arms bent towards what targets are about by more and
more, and arms that press on what they hold.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import OutOfTime, check_time, time_limit
from planner.avoidance.around import Around
from planner.avoidance.asked import Surroundings
from planner.contact.pressing import likely_pressing
from planner.contact.program import Program, lacking
from planner.contact.settled_terms import SettledTerms
from planner.contact.wrapping import beside_contacts, share_left
from planner.program.limits import natural_tensions
from planner.solve.search import Search
from planner.solve.task import Task
from planner.targets.hold import Hold
from planner.targets.wrap import Wrap

# First guesses of the free arm, and bends towards a target by so many times the natural tensions.
_FREE, _BENDS = 3, (0.3, 1.0, 2.0)
# Bends that may press on what is held, harder and harder; how many are begun with.
_HARDER, _PRESSED = tuple((0.25 * 1.5 ** np.arange(12)).tolist()), 6


def starts(task: Task, program: Program) -> list[Array]:
    """Return tensions (n_tendons,) to begin with, the likeliest first."""
    found, towards = list[Array](), _towards(task)
    if any(isinstance(target, Hold) for target in task.targets):
        found += _pressing(task, program, towards)
    if not all(isinstance(target, Hold) for target in task.targets):
        with suppress(OctoplanError):
            found += _free(task)
    return found + [share * own for own in towards for share in _BENDS]


def _free(task: Task) -> list[Array]:
    """Return the tensions of arms that meet the targets without contact, the cheapest first."""
    statement = task.statement.but(margin=0.0, modes=0)
    free, bodies = beside_contacts(replace(task, statement=statement, starts=_FREE), Surroundings())
    if any(isinstance(target, Wrap) for target in task.targets):
        return [np.ravel(Around(free, bodies).run(share_left())[0].tensions)]
    search = Search(free)
    best = np.ravel(search.run(share_left()).tensions)
    others = sorted(search.met, key=lambda own: own[1].f)[1:]
    return [best, *(free.tensions(solution) for _, solution in others)]


def _pressing(task: Task, program: Program, directions: list[Array]) -> list[Array]:
    """Return the tensions that press on what is held so that least is lacking.

    Each direction is followed from rest, harder and harder, up to where the arm jumps: beyond it
    has slipped off. Others are those of free arms that would reach into what is held. As many as
    a share of the time limit is enough for.
    """
    found = list[tuple[float, Array]]()

    def tried(T: Array, near: SettledTerms | None) -> SettledTerms | None:
        check_time()
        try:
            there = program.evaluate(T, near, None)
        except OctoplanError:
            return None
        found.append((lacking(there), T))
        return there

    with suppress(OutOfTime), time_limit(share_left()):
        for own in directions:
            near: SettledTerms | None = None
            for share in _HARDER:
                near = tried(np.clip(share * own, program.lower, program.upper), near)
                if near is None:
                    break
        for target in task.targets:
            if isinstance(target, Hold):
                for T in likely_pressing(task, target):
                    tried(T, None)
    check_time()
    return [T for _, T in sorted(found, key=lambda one: one[0])[:_PRESSED]]


def _towards(task: Task) -> list[Array]:
    """Return the natural tensions of the tendons on the sides of what targets are about."""
    arm, found = task.arm, list[Array]()
    natural = np.minimum(natural_tensions(arm), np.array(task.allowed.upper))
    frame = np.array(arm.base_frame)
    for target in task.targets:
        point = target.guess_towards(arm)
        if point is None:
            continue
        n, b = (point - np.array(arm.base_position)) @ frame[:, 1:]
        angles = np.array([phi for _, phi in arm.tendons])
        along = (np.cos(angles) * n + np.sin(angles) * b) / max(np.hypot(n, b), 1e-12)
        found.append(natural * np.maximum(along, 0.0))
    return found
