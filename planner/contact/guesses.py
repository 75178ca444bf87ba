"""Where plans in contact begin: tensions of arms that press on what they hold, or lie near targets.

Places and wraps begin with optima of the program on a mesh that knows nothing of the contacts, from
the initial guesses of a free arm. Where forces are asked for begin arms that are bent towards what
they hold, harder and harder, or drawn, that free would reach into it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from model.equilibrium.forward import STAGES, Collocation
from model.errors import OctoplanError
from model.loads import is_loaded, without_friction
from model.paths import Array
from model.time_limit import check_time
from planner.contact.exchange import Exchange
from planner.contact.program import Program
from planner.initial_guess.bend_coordinates import bend_coordinates
from planner.initial_guess.guesses import initial_guesses
from planner.initial_guess.many_places import many_places
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of
from planner.solve.task import Task
from planner.targets.hold import Hold

# Products of forces and gaps that are allowed, one after the other; the mesh.
_RELAXED, _MESH = (1e-1, 1e-3), 3
# Bends towards targets, in natural tensions, and towards what is held, harder and harder.
_BENDS, _HARDER = (0.3, 1.0, 2.0), 0.25 * 1.5 ** np.arange(8)
# Arms that are drawn, and those that are tried, no deeper in what they hold, over their length.
_DRAWN, _TRIED, _DEEP = 3000, 8, 0.2


def guesses(task: Task, exchange: Exchange) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N], the likeliest first."""
    towards = _towards(task)
    if any(isinstance(target, Hold) for target in task.targets):
        yield from _pressing(task, exchange, towards)
        return
    yield from _relaxed(task)
    yield from (share * own for own in towards for share in _BENDS)


def _relaxed(task: Task) -> Iterator[Array]:
    """Yield the tensions of optima by complementarity, from the guesses of a free arm."""
    smooth = without_friction(task.scene)
    form = (STAGES, _MESH, stations_of(task.arm, task.targets), True, task.machine_code)
    free = Collocation(task.arm, smooth, *form)
    program = Program(free.system, task.targets, task.allowed)
    asked = task.arm, task.simple.scene, task.targets, task.allowed, task.machine_code
    for T in initial_guesses(*asked, is_loaded(task.simple.scene)):
        check_time()
        with suppress(OctoplanError):
            z = program.guess(T, free.without_loads(T))
            for eps in _RELAXED:
                point = program.solve(z, eps)
                if not point.met:
                    break
                z = point.z
            else:
                yield program.tensions(z)


def _pressing(task: Task, exchange: Exchange, towards: list[Array]) -> Iterator[Array]:
    """Yield tensions of arms that press on what they hold."""
    low, high = np.array(task.allowed.lower), np.array(task.allowed.upper)
    holds = [target for target in task.targets if isinstance(target, Hold)]
    yield from (
        _pressed(exchange, [np.clip(c * own, low, high) for c in _HARDER]) for own in towards
    )
    for hold in holds:
        yield from _reaching(task, hold)


def _pressed(exchange: Exchange, row: list[Array]) -> Array:
    """Return those of growing tensions at which the arm lacks least, up to where it snaps."""
    found, here = [(np.inf, row[0])], None
    with suppress(OctoplanError):
        for T in row:
            check_time()
            here = exchange.settled(T, here)
            found.append((exchange.lacking(here), T))
    return min(found, key=lambda own: own[0])[1]


def _reaching(task: Task, hold: Hold) -> list[Array]:
    """Return tensions of arms without loads that free would reach into what is held.

    First those that would be pressed apart from it along what balances the wrench, within the cone
    of friction; of these the least tensions first.
    """
    arm, body = task.arm, hold.obstacle
    tendons = frozenset(j for j in range(arm.n_tendons) if task.allowed.upper[j] > 0)
    bends = bend_coordinates(arm, tendons, task.allowed)
    tensions = bends.tensions(bends.draw(_DRAWN))
    points, radius = many_places(arm, task.simple.scene, tensions, task.machine_code)
    gap = body.distance(points.reshape(-1, 3)).reshape(points.shape[:2]) - radius
    gap[np.isnan(gap)] = np.inf
    deepest = gap.argmin(axis=1)
    depth = -gap[np.arange(_DRAWN), deepest]
    own = np.flatnonzero((depth > 0) & (depth < _DEEP * arm.length))
    force = np.array(hold.wrench[:3])
    against = body.gradient(points[own, deepest[own]]) @ force if own.size else np.zeros(0)
    against = against / max(float(np.linalg.norm(force)), 1e-300)
    effort = np.linalg.norm(tensions[own], axis=1)
    within = np.minimum(against, 1 / np.hypot(1.0, hold.friction)).round(1)
    return [tensions[i] for i in own[np.lexsort((effort, -within))][:_TRIED]]


def _towards(task: Task) -> list[Array]:
    """Return the natural tensions of the tendons on the sides of what targets are about."""
    arm, found = task.arm, list[Array]()
    natural = np.minimum(natural_tensions(arm), np.array(task.allowed.upper))
    frame = np.array(arm.base_frame)
    angles = np.array([phi for _, phi in arm.tendons])
    for target in task.targets:
        point = target.guess_towards(arm)
        if point is not None:
            n, b = (point - np.array(arm.base_position)) @ frame[:, 1:]
            along = (np.cos(angles) * n + np.sin(angles) * b) / max(np.hypot(n, b), 1e-12)
            found.append(natural * np.maximum(along, 0.0))
    return found
