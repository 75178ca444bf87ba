"""How an arm comes into contact: tensions and loads grow together from none, obstacles there.

While tensions and loads grow in proportion, or winches take tendons in, the equilibrium is followed
with forces at the nodes that are complementary to the gaps: by Newton's method, and where that
fails by the least energy with gaps >= 0. Where frames turn far in however short a step the arm has
snapped. At the end nodes are exchanged for others where the gap is least (Hettich and Kortanek,
SIAM Review 35, 1993), until places can be refined; see model.contact.sharp. With friction, which
looks back over each step, places are refined in each; over a snap the arm slides without.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from model.contact.friction import Path
from model.contact.gaps import least_gaps
from model.contact.newton import newton
from model.contact.sharp import Request, sharpened
from model.contact.touches import (
    Place,
    Places,
    Touches,
    forces,
    mesh_with,
    places_of,
    read_off,
)
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import carried_strains
from model.equilibrium.stability import unstable_mode
from model.errors import SnapError, UnsettledContactError
from model.least_energy import LeastEnergy
from model.loads import contacts, without_friction
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System
from model.winches import Winches, rest_lengths, slackened

# First, least and longest step in the load factor; with friction: where a point rolls, that is not
# to count as slip.
_STEPS, _WITH_FRICTION = (1 / 4, 1 / 16, 1.0), (1 / 8, 1 / 128, 1 / 8)
# The farthest that a frame may turn in a step [rad], and from forces at nodes to refined places.
_TURN, _CLOSE = 1.0, 0.6
# How often nodes are exchanged; forces that are those of an interior point, over the largest.
_EXCHANGES, _NONE = 8, 1e-5
# How often forces without a potential are updated in a step: places are refined with them in full.
_ROUNDS = 3
# How far frames turn off an unstable equilibrium at first [rad].
_ASIDE = 0.1
# At how many positions on its way in a step each node is checked.
_SAMPLES = 9
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Touching(Linearised):
    """An equilibrium with contact, whose equations know what touches on their mesh.

    Attributes
    ----------
    snaps : tuple of float
        The load factors at which the arm jumped to another equilibrium.
    path : tuple
        With friction the equilibria on the way with their load factors, the one before first.
    """

    snaps: tuple[float, ...] = ()
    path: Path = ()

    @classmethod
    def of(cls, end: Linearised, snaps: tuple[float, ...] = (), path: Path = ()) -> Touching:
        """Return an equilibrium that an arm came to like this."""
        return cls(end.system, end.x, end.near, end.jacobian, snaps, path)

    @property
    def before(self) -> Linearised | None:
        """With friction the equilibrium before the last step: what has slipped since."""
        return self.path[-2][0] if self.path else None

    def __reduce__(self) -> tuple[Any, ...]:
        return Touching, (self.system, self.x, None, None, self.snaps, self.path[-2:])


def in_proportion(request: Request, tensions: Array, load: float) -> Callable[[float], Request]:
    """Return requests by how far tensions and loads have come to those of a request, from some."""

    def at(factor: float) -> Request:
        between = tensions + factor * (request.tensions - tensions)
        return replace(request, tensions=between, load=load + factor * (request.load - load))

    return at


def taken_in(request: Request, winches: Winches) -> Callable[[float], Request]:
    """Return requests by how far winches have taken tendons in, and loads have grown, from rest."""
    longest = np.maximum(rest_lengths(request.base.arm), winches.lengths)

    def at(factor: float) -> Request:
        part = replace(winches, lengths=longest + factor * (winches.lengths - longest))
        return replace(request, tensions=factor * winches.tensions, load=factor, winches=part)

    return at


def follow(at: Callable[[float], Request], start: Linearised, jumps: bool = True) -> Touching:
    """Return where an equilibrium comes to by requests from a load factor of 0 to 1.

    Raises UnsettledContactError where none is found; unless it may jump, SnapError where it would.
    """
    request, snaps = at(1.0), list[float]()
    rubs = request.before is not None
    most = _CLOSE if rubs else _TURN

    def solve(factor: float, near: Linearised) -> Linearised | None:
        if rubs:
            there = sharpened(replace(at(factor), before=near), near, places_of(near.system))
        else:
            there = _at_nodes(at(factor), near)
        return there if there is not None and close(near, there, most) else None

    def over(before: float, factor: float, near: Linearised) -> Linearised:
        if rubs and not jumps:
            raise SnapError(before, "it jumps")
        to = replace(at(factor), before=near) if rubs else at(factor)
        there = _slid(to, near) if rubs else _least(to, near)
        if there is None:
            raise UnsettledContactError(factor, "no least energy is found")
        if rubs or not close(near, there, most):
            if not jumps:
                raise SnapError(before, "it jumps")
            snaps.append(factor)
        return there

    if not rubs:
        begin, system = at(0.0), request.base
        strains = carried_strains(start.system, start.system.strains(start.states), system)
        states = system.start(begin.tensions, strains, begin.load)
        start = Linearised(system, system.x(begin.tensions, begin.load, states))
    path = stepped(solve, start, _WITH_FRICTION if rubs else _STEPS, over)
    end, winches = path[-1][0], request.winches
    if rubs:
        return Touching.of(end, tuple(snaps), tuple(path))
    if winches is not None:
        left = winches.lacks(end.lengths, end.tensions)
        tensions = slackened(end.tensions, left, winches, request.base.arm)
        request = replace(request, tensions=tensions, winches=None)
    return Touching.of(_sharp(request, end), tuple(snaps))


def close(one: Linearised, other: Linearised, most: float = _CLOSE) -> bool:
    """Return whether no frame turns by `most` [rad] between equilibria, be they on two meshes."""
    a, b = one.system, other.system
    before, after = a.poses(one.states)[:, :4], b.poses(other.states)[:, :4]
    there = np.array([np.interp(b.mesh.s, a.mesh.s, column) for column in before.T]).T
    same = np.abs((there * after).sum(axis=1)) / np.linalg.norm(there, axis=1)
    return bool(same.min() > np.cos(most / 2))


def stepped(
    solve: Callable[[float, T], T | None],
    start: T,
    steps: tuple[float, float, float],
    over: Callable[[float, float, T], T],
) -> list[tuple[T, float]]:
    """Return solutions and load factors from a start at 0 to 1, each from the one before.

    Steps, of which the first, the least and the longest are given, are cut where `solve` returns
    None; where they are the least `over` leads from one load factor to the next.
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
            there, step = over(at, factor, near), least
        path, step = [*path, (there, factor)], min(2 * step, longest)
    return path


def _at_nodes(request: Request, near: Linearised) -> Linearised | None:
    """Return the equilibrium with forces at nodes near one: by Newton's method, or least energy.

    Without a potential the least energy takes several programs: only the least steps are by it.
    """
    if request.winches is None:
        states, to = near.states, (request.tensions, request.load)
        there = newton(near.system, *to, states, complementary=True)
        if there is not None and close(near, there, _TURN) and not _passes(near, there):
            return there
        if not LeastEnergy(request.base).conservative:
            return None
    return _least(request, near)


def _least(request: Request, near: Linearised) -> Linearised | None:
    """Return the least energy with forces at nodes near an equilibrium on the mesh of a request."""
    program, system = LeastEnergy(request.base), request.base
    begin = program.near(
        near.tensions, carried_strains(near.system, near.system.strains(near.states), system)
    )
    to = request.tensions, request.load, request.winches
    minimum = program.least(begin, *to, _ROUNDS)
    if minimum is None:
        return None
    touches = Touches.of(system)
    largest = max(minimum.forces.max(), program.force_unit)
    touches.held[1:] = minimum.forces > _NONE * largest
    states = program.states(minimum, request.load)
    return Linearised(touches.on(system), system.x(minimum.tensions, request.load, states))


def _passes(before: Linearised, after: Linearised) -> bool:
    """Return whether nodes go through an obstacle in a step, by half the arm's radius or more."""
    system = after.system
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    start, end = (system.poses(at.states)[1:, 4:] for at in (before, after))
    between = np.linspace(start, end, _SAMPLES).reshape(-1, 3)
    radius = np.tile(system.arm.outer_radius(system.mesh.s[1:])[0], _SAMPLES)
    return bool((distances(bodies, between)[0].min(axis=1) < radius / 2).any())


def _sharp(request: Request, rough: Linearised) -> Linearised:
    """Return the stable equilibrium at refined places, near one with forces at nodes.

    Where none is found nodes that touch go to where the gap is least, others to where it is below 0
    in between. From where it is unstable the arm falls to the least energy aside of it.
    """
    for _ in range(_EXCHANGES):
        check_time()
        end = sharpened(request, rough, _at_forces(rough))
        if end is not None and close(rough, end):
            mode, rough = unstable_mode(end), end
            if mode is None:
                return end
            states, system = rough.states.copy(), rough.system
            states[system.of.stages] += _ASIDE * mode
            rough = Linearised(system, system.x(rough.tensions, request.load, states))
        mesh = mesh_with(request.base, request.fixed, _nodes(rough))
        assert mesh is not None
        after = _least(replace(request, base=request.on(mesh)), rough)
        if after is None:
            break
        rough = after
    raise UnsettledContactError(1.0, "where it touches is not found")


def _at_forces(rough: Linearised) -> Places:
    """Return places by forces at nodes, which lie on an obstacle where they are beside another."""
    touching = Touches.of(rough.system).points
    force = forces(rough.system, rough.states)
    return read_off(rough.system, touching, touching[1:] & touching[:-1], force)


def _nodes(rough: Linearised) -> Places:
    """Return where nodes are wanted: those that touch, and where gaps are least and below 0."""
    s, least = rough.system.mesh.s, least_gaps(rough.system, rough.x)
    spacing, wanted = np.diff(s), [Place(at[0], at[1], at[1]) for at in least]
    for k, j in zip(*np.nonzero(Touches.of(rough.system).points), strict=True):
        near = spacing[max(k - 2, 0) : k + 1].max() / 2
        if all(j != i or abs(at - s[k]) > near for i, at in least):
            wanted.append(Place(int(j), float(s[k]), float(s[k])))
    return tuple(wanted)


def _slid(request: Request, near: Linearised) -> Linearised:
    """Return the equilibrium with friction near that which the arm without it snaps to."""
    base = request.base
    form = base.of.form.stages, True, base.of.form.machine_code
    free = System(base.arm, without_friction(base.scene), base.mesh, *form)
    smooth = replace(request, base=free, before=None)
    rough = _least(smooth, near)
    there = None if rough is None else _sharp(smooth, rough)
    solution = there and sharpened(request, there, places_of(there.system))
    if solution is None:
        raise UnsettledContactError(1.0, "where it comes to rest with friction is not found")
    return solution
