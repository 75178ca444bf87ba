"""How an arm comes into contact: tensions and loads grow together from none, obstacles there.

From the straight arm at rest, with forces at the nodes that are complementary to the gaps, the
equilibrium is followed by Newton's method while tensions and loads grow in proportion. Where that
ends the arm snaps: then it is the least energy with gaps >= 0 at the nodes that is followed. Where
frames turn far in however short a step the minimum was lost, and the arm has snapped to the next
one. At the end nodes are exchanged for others where the gap is least (Hettich and Kortanek, SIAM
Review 35, 1993), until places can be refined; see model.contact.sharp. With friction, which looks
back over each step, places are refined in each; over a snap the arm slides without.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from model.contact.friction import History, Path
from model.contact.gaps import least_gaps
from model.contact.newton import newton
from model.contact.sharp import Request, Settled, angle_between, sharpened, stable, turned
from model.contact.touches import Mask, Place, Places, Touches, forces, mesh_with, point
from model.equilibrium.forward import carried_strains
from model.equilibrium.linearised import Linearised
from model.errors import SnapError, UnsettledContactError
from model.least_energy import LeastEnergy, Minimum
from model.loads import contacts, without_friction
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System
from model.winches import Winches, rest_lengths, slackened

# First, least and longest step in the load factor; with friction: where a point rolls, that is not
# to count as slip.
_STEPS, _WITH_FRICTION = (1 / 4, 1 / 64, 1.0), (1 / 8, 1 / 128, 1 / 8)
# The farthest that a frame may turn in a step [rad], and from forces at nodes to refined places.
_TURN, _CLOSE = 1.0, 0.6
# How often nodes are exchanged; forces that are those of an interior point, over the largest, and
# over what bends the arm.
_EXCHANGES, _NONE, _NOTHING = 8, 1e-5, 1e-6
# At how many positions on its way in a step each node is checked.
_SAMPLES = 9
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Continuation:
    """Where an arm came to, and how.

    Attributes
    ----------
    settled : Settled
    snaps : tuple of float
        The load factors at which the arm jumped to another equilibrium.
    path : tuple
        With friction the equilibria on the way with their load factors, the one before first.
    """

    settled: Settled
    snaps: tuple[float, ...] = ()
    path: Path = ()

    @property
    def before(self) -> Linearised | None:
        """With friction the equilibrium before the last step."""
        return self.path[-2][0] if self.path else None


def follow(
    request: Request, tensions: Array, load: float, start: Settled, jumps: bool = True
) -> Continuation:
    """Return where an equilibrium under `tensions` and a load factor comes to.

    While tensions go to the request's in a straight line, and loads to the full. Raises
    UnsettledContactError where nothing is found; unless it may jump, SnapError where it would.
    """

    def at(factor: float) -> Request:
        between = tensions + factor * (request.tensions - tensions)
        return replace(request, tensions=between, load=load + factor * (request.load - load))

    if request.history is not None:
        return _with_friction(at, start, jumps)
    end = _by_newton(at, start)
    return Continuation(end) if end is not None else _by_energy(at, tensions, start, jumps)


def by_lengths(request: Request, winches: Winches) -> Settled | None:
    """Return the equilibrium whose tendons winches hold, by steps of strokes and loads from rest.

    Tensions are those of the least energy with forces at nodes. None where there is none.
    """
    program, rest = LeastEnergy(request.base), rest_lengths(request.base.arm)
    longest = np.maximum(rest, winches.lengths)

    def solve(factor: float, near: Minimum) -> Minimum | None:
        part = replace(winches, lengths=longest + factor * (winches.lengths - longest))
        return program.least(near, factor * winches.tensions, factor, part)

    path = _stepped(solve, program.at_rest(), _STEPS)
    if path is None:
        return None
    end, _ = path[-1]
    left = winches.lacks(program.lengths(end), end.tensions)
    pulled = slackened(end.tensions, left, winches, request.base.arm)
    request = replace(request, tensions=pulled)
    return _exchanged(request, program, replace(end, tensions=pulled))


def close(one: Linearised, other: Linearised) -> bool:
    """Return whether no frame turns far between two equilibria, be they on two meshes."""
    return turned(one, other) < _CLOSE


def _stepped(
    solve: Callable[[float, T], T | None],
    start: T,
    steps: tuple[float, float, float],
    over: Callable[[float, float, T], T] | None = None,
) -> list[tuple[T, float]] | None:
    """Return solutions and load factors from a start at 0 to 1, each from the one before.

    Steps, of which the first, the least and the longest are given, are cut where `solve` returns
    None; where they are the least `over` leads from one load factor to the next, None without it.
    """
    path, (step, least, longest) = [(start, 0.0)], steps
    while path[-1][1] < 1:
        check_time()
        near, at = path[-1]
        tell("percent of tensions and loads", round(100 * at), 100)
        factor = min(1.0, at + step)
        there = solve(factor, near)
        if there is None and step > least:
            step /= 4
            continue
        if there is None:
            if over is None:
                return None
            there, step = over(at, factor, near), least
        path, step = [*path, (there, factor)], min(2 * step, longest)
    return path


def _by_newton(at: Callable[[float], Request], start: Settled) -> Settled | None:
    """Return the equilibrium at the end, followed with forces at nodes; None where it snaps."""
    begin, request, old = at(0.0), at(1.0), start.here
    system = request.base
    strains = carried_strains(old.system, old.system.strains(old.states), system)
    states = system.start(begin.tensions, strains, begin.load)

    def solve(factor: float, near: Linearised) -> Linearised | None:
        load = at(factor).tensions, at(factor).load
        after = newton(near.system, *load, near.states, complementary=True)
        if after is None or _passes(system, near.states, after.states):
            return None
        before, now = (system.poses(here.states)[:, :4] for here in (near, after))
        return after if angle_between(before, now) < _TURN else None

    path = _stepped(solve, Linearised(system, system.x(begin.tensions, begin.load, states)), _STEPS)
    if path is None:
        return None
    end, _ = path[-1]
    force = forces(system, end.states)[1:]
    return _refined(request, end, _read_off(system, force, Touches.of(end.system).point[1:]))


def _passes(system: System, before: Array, after: Array) -> bool:
    """Return whether nodes go through an obstacle in a step, by half the arm's radius or more."""
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    start, end = (system.poses(states)[1:, 4:] for states in (before, after))
    between = np.linspace(start, end, _SAMPLES).reshape(-1, 3)
    radius = np.tile(system.arm.outer_radius(system.mesh.s[1:])[0], _SAMPLES)
    return bool((distances(bodies, between)[0].min(axis=1) < radius / 2).any())


def _refined(request: Request, rough: Linearised, places: Places) -> Settled | None:
    """Return the stable equilibrium at refined places near one with forces at nodes, if any."""
    solution = sharpened(request, rough, places)
    if solution is None or not close(rough, solution.here):
        return None
    return stable(request, solution)


def _by_energy(
    at: Callable[[float], Request], tensions: Array, start: Settled, jumps: bool = True
) -> Continuation:
    """Return the equilibrium at the end by least energies, and where the arm snaps.

    Raises UnsettledContactError where there is none; SnapError where it would jump and may not.
    """
    request, old, snaps = at(1.0), start.here, list[float]()
    program = LeastEnergy(request.base)
    strains = carried_strains(old.system, old.system.strains(old.states), program.system)

    def least(factor: float, near: Minimum) -> Minimum | None:
        return program.least(near, at(factor).tensions, at(factor).load)

    def solve(factor: float, near: Minimum) -> Minimum | None:
        there = least(factor, near)
        frames = [program.nodes(each)[:, :4] for each in (near, there or near)]
        return there if angle_between(*frames) < _TURN else None

    def over(before: float, factor: float, near: Minimum) -> Minimum:
        there = least(factor, near)
        if there is None:
            raise UnsettledContactError(factor, "no least energy is found")
        if not jumps:
            raise SnapError(before, "it jumps")
        snaps.append(factor)
        return there

    path = _stepped(solve, program.near(tensions, strains), _STEPS, over)
    assert path is not None
    return Continuation(_exchanged(request, program, path[-1][0]), tuple(snaps))


def _exchanged(request: Request, program: LeastEnergy, here: Minimum) -> Settled:
    """Return the equilibrium at refined places, near one with forces at nodes.

    Nodes that touch go to where the gap is least, others to where it is below 0 in between.
    """
    for _ in range(_EXCHANGES):
        check_time()
        most = max(_NONE * here.forces.max(), _NOTHING * program.force_unit)
        system, active = program.system, here.forces > most
        touches = Touches.none(system.mesh.steps, active.shape[1])
        touches.point[1:] = active
        touching = touches.on(system)
        states = program.states(here, request.load)
        rough = Linearised(touching, touching.x(here.tensions, request.load, states))
        solution = _refined(request, rough, _read_off(system, here.forces, active))
        if solution is not None:
            return solution
        mesh = mesh_with(request.base, request.fixed, _nodes(touching, rough, active))
        assert mesh is not None
        program, before = LeastEnergy(request.on(mesh)), program
        strains = carried_strains(before.system, before.strains(here), program.system)
        near = program.near(here.tensions, strains)
        after = program.least(near, request.tensions, request.load)
        if after is None:
            break
        here = after
    raise UnsettledContactError(1.0, "where it touches is not found")


def _read_off(system: System, force: Array, active: Mask) -> Places:
    """Return places by forces (N, K) on nodes: of three and more in a row a part that lies."""
    s, places = system.mesh.s[1:], list[Place]()
    for j in range(active.shape[1]):
        nodes = np.flatnonzero(active[:, j])
        for run in np.split(nodes, np.flatnonzero(np.diff(nodes) > 1) + 1) if nodes.size else ():
            if run.size > 2:
                places.append(Place(j, float(s[run[0]]), float(s[run[-1]])))
            elif run[-1] == s.size - 1:
                places.append(point(j, float(s[-1])))
            else:
                places.append(point(j, float(np.average(s[run], weights=force[run, j]))))
    return tuple(places)


def _nodes(system: System, rough: Linearised, active: Mask) -> Places:
    """Return where nodes are wanted: those that touch, and where gaps are least and below 0."""
    s, least = system.mesh.s[1:], least_gaps(system, rough.x)
    spacing, wanted = np.diff(system.mesh.s), [point(*at) for at in least]
    for k, j in zip(*np.nonzero(active), strict=True):
        near = spacing[max(k - 1, 0) : k + 2].max() / 2
        if all(j != i or abs(at - s[k]) > near for i, at in least):
            wanted.append(point(int(j), float(s[k])))
    return tuple(wanted)


def _with_friction(at: Callable[[float], Request], start: Settled, jumps: bool) -> Continuation:
    """Return the end with friction, which looks back over each step; see follow."""
    snaps = list[float]()

    def solve(factor: float, near: Settled) -> Settled | None:
        request = replace(at(factor), history=History(near.here))
        there = sharpened(request, near.here, near.places)
        return there if there is not None and close(near.here, there.here) else None

    def over(before: float, factor: float, near: Settled) -> Settled:
        if not jumps:
            raise SnapError(before, "it jumps")
        snaps.append(factor)
        return _slid(replace(at(factor), history=History(near.here)), near)

    path = _stepped(solve, start, _WITH_FRICTION, over)
    assert path is not None
    ends = tuple((solution.here, factor) for solution, factor in path)
    return Continuation(path[-1][0], tuple(snaps), ends)


def _slid(request: Request, near: Settled) -> Settled:
    """Return the equilibrium with friction near that which the arm without it snaps to."""
    base = request.base
    form = base.of.form.stages, True, base.of.form.machine_code
    free = System(base.arm, without_friction(base.scene), base.mesh, *form)
    smooth = replace(request, base=free, history=None)
    there = _by_energy(lambda _: smooth, request.tensions, near).settled
    solution = sharpened(request, there.here, there.places)
    if solution is None:
        raise UnsettledContactError(1.0, "where it comes to rest with friction is not found")
    return solution
