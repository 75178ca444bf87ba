"""How an arm comes into contact: tensions and loads grow together from none, obstacles there.

From the straight arm at rest the least energy with gaps >= 0 at the nodes is followed while
tensions and loads grow in proportion. Where frames turn far in however short a step the minimum was
lost, and the arm has snapped to the next one. At the end nodes are exchanged for others where the
gap is least (Hettich and Kortanek, SIAM Review 35, 1993), until what touches is told well enough
for Newton's method; see model.contact.sharp. With friction, which looks back over each step, places
are followed all the way; over a snap it slides without.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.contact.gaps import least_gaps
from model.contact.history import History
from model.contact.newton import newton
from model.contact.places import Place, Places, mesh_with, point
from model.contact.sharp import Question, Settled, sharpened
from model.contact.stability import held_stands
from model.contact.touches import Mask, Touches, forces
from model.equilibrium.forward import carried_strains
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import is_near
from model.errors import SnapError, UnsettledContactError
from model.least_energy.program import LeastEnergy, Minimum
from model.loads import contacts, without_friction
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from model.transcription.system import System
from model.winches import Winches, rest_lengths, slackened

# First and least steps in the share of tensions and loads; the longest and the least with friction:
# where a point rolls, that is not to count as slip.
_FIRST, _LEAST, _WITH_FRICTION, _FINEST = 0.25, 1 / 64, 1 / 8, 1 / 128
# The farthest that a frame may turn in a step [rad]; between nodes and places.
_TURN, _CLOSE = 1.0, 0.6
# How often nodes are exchanged; forces that are those of an interior point, over the largest, and
# over what bends the arm.
_ROUNDS, _NONE, _NOTHING = 8, 1e-5, 1e-6
# How many places on its way in a step each node is looked at.
_LOOKS = 9


@dataclass(frozen=True, eq=False)
class Followed:
    """Where an arm came to, and how.

    Attributes
    ----------
    settled : Settled
    snaps : tuple of float
        The shares of tensions and loads at which the arm jumped to another equilibrium.
    before : Linearised or None
        With friction the equilibrium before the last step.
    way : tuple
        With friction the equilibria on the way, and at which shares of it.
    """

    settled: Settled
    snaps: tuple[float, ...] = ()
    before: Linearised | None = None
    way: tuple[tuple[Linearised, float], ...] = ()


def follow(
    of: Question, before: Array, load: float, start: Settled, jumps: bool = True
) -> Followed:
    """Return where an equilibrium under tensions `before` and a load factor comes to.

    While tensions go to others in a straight line, and loads to the full. Raises
    UnsettledContactError where none is found; unless it may jump, SnapError where it would.
    """
    if of.history is not None:
        return _with_friction(of, before, load, start, jumps)
    found = _by_newton(of, before, load, start)
    if found is not None:
        return Followed(found)
    here, snaps = _least_energy(of, before, load, start)
    if snaps and not jumps:
        raise SnapError(snaps[0], "it jumps")
    return Followed(here, snaps)


def by_lengths(of: Question, winches: Winches) -> Settled | None:
    """Return the equilibrium whose tendons winches hold, by steps of strokes and loads from rest.

    Tensions are those of the least energy with forces at nodes. None where none is found.
    """
    program, rest = LeastEnergy(of.base), rest_lengths(of.base.arm)
    here, longest = program.at_rest(), np.maximum(rest, winches.lengths)
    for share in np.arange(_FIRST, 1 + _FIRST, _FIRST).tolist():
        check_time()
        part = replace(winches, lengths=longest + share * (winches.lengths - longest))
        found = program.least(here, share * winches.tensions, share, part)
        if found is None:
            return None
        here = found
    left = winches.lacks(program.lengths(here), here.tensions)
    T = slackened(here.tensions, left, winches, of.base.arm)
    return _exchanged(replace(of, tensions=T), program, replace(here, tensions=T))


def close(one: Linearised, other: Linearised, most: float) -> bool:
    """Return whether no frame turns farther than `most` [rad] between two equilibria."""
    a, b = one.system, other.system
    before, after = a.poses(one.states), b.poses(other.states)
    there = np.array([np.interp(b.mesh.s, a.mesh.s, column) for column in before[:, :4].T]).T
    there /= np.linalg.norm(there, axis=1)[:, None]
    return bool(np.abs((there * after[:, :4]).sum(axis=1)).min() > np.cos(most / 2))


def _by_newton(of: Question, before: Array, load: float, start: Settled) -> Settled | None:
    """Return the equilibrium at the end of the way, followed with forces at nodes.

    None where the arm snaps.
    """
    system, old = of.base, start.here
    strains = carried_strains(old.system, old.system.strains(old.states), system)
    states, at, step, found = system.start(before, strains, load), 0.0, _FIRST, None
    while at < 1:
        check_time()
        share = min(1.0, at + step)
        on = _way(of, before, load, share)
        after = newton(system, on.tensions, on.load, states, complementary=True)
        near = after is not None and is_near(system, states, after.states)
        if after is not None and near and not _passes(system, states, after.states):
            at, states, step, found = share, after.states, 2 * step, after
            system = after.system
        elif share - at > _LEAST:
            step = (share - at) / 4
        else:
            return None
    if found is None:
        return None
    touches = Touches.of(found.system)
    settled = sharpened(of, found, _read_off(system, forces(system, states)[1:], touches.point[1:]))
    return settled if settled is not None and _holds(found, settled) else None


def _passes(system: System, before: Array, after: Array) -> bool:
    """Return whether nodes go through an obstacle in a step, by half the arm's radius or more."""
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    start, end = (system.poses(states)[1:, 4:] for states in (before, after))
    way = np.linspace(start, end, _LOOKS).reshape(-1, 3)
    radius = np.tile(system.arm.outer_radius(system.mesh.s[1:])[0], _LOOKS)
    return bool((distances(bodies, way)[0].min(axis=1) < radius / 2).any())


def _holds(rough: Linearised, found: Settled) -> bool:
    return close(rough, found.here, _CLOSE) and held_stands(found.here)


def _least_energy(
    of: Question, before: Array, load: float, start: Settled
) -> tuple[Settled, tuple[float, ...]]:
    """Return the equilibrium at the end of the way, and the shares at which the arm snaps."""
    program, old = LeastEnergy(of.base), start.here
    strains = carried_strains(old.system, old.system.strains(old.states), program.system)
    here, at, step, snaps = program.near(before, strains), 0.0, _FIRST, list[float]()
    while at < 1:
        check_time()
        tell("percent of tensions and loads", round(100 * at), 100)
        share = min(1.0, at + step)
        on = _way(of, before, load, share)
        found = program.least(here, on.tensions, on.load)
        far = found is None or not _is_near(program, here, found)
        if far and step > _LEAST:
            step /= 2
            continue
        if found is None:
            raise UnsettledContactError(share, "no least energy is found")
        if far:
            snaps.append(share)
        here, at, step = found, share, 2 * step
    return _exchanged(of, program, here), tuple(snaps)


def _is_near(program: LeastEnergy, one: Minimum, other: Minimum) -> bool:
    a, b = (program.nodes(here)[:, :4] for here in (one, other))
    return bool(np.abs((a * b).sum(axis=1)).min() > np.cos(_TURN / 2))


def _exchanged(of: Question, program: LeastEnergy, here: Minimum) -> Settled:
    """Return the equilibrium at places that move, near one with forces at nodes.

    Nodes that touch go to where the gap is least, others to where it is below 0 in between.
    """
    for _ in range(_ROUNDS):
        check_time()
        most = max(_NONE * here.forces.max(), _NOTHING * program.force_unit)
        system, active = program.system, here.forces > most
        touches = Touches.none(system.mesh.steps, active.shape[1])
        touches.point[1:] = active
        told = touches.told(system)
        rough = Linearised(told, told.x(here.tensions, of.load, program.states(here, of.load)))
        places = _read_off(system, here.forces, active)
        found = sharpened(of, rough, places)
        if found is not None and _holds(rough, found):
            return found
        nodes = _nodes(told, rough, active)
        mesh = mesh_with(of.base, of.fixed, nodes)
        assert mesh is not None
        program, before = LeastEnergy(of.on(mesh)), program
        strains = carried_strains(before.system, before.strains(here), program.system)
        after = program.least(program.near(here.tensions, strains), of.tensions, of.load)
        if after is None:
            break
        here = after
    raise UnsettledContactError(1.0, "where it touches is not found")


def _read_off(system: System, force: Array, active: Mask) -> Places:
    """Return places by forces (N, K) on nodes: of three and more in a row a part that lies."""
    s, places = system.mesh.s[1:], list[Place]()
    for j in range(active.shape[1]):
        own = np.flatnonzero(active[:, j])
        for run in np.split(own, np.flatnonzero(np.diff(own) > 1) + 1) if own.size else ():
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
    spacing, found = np.diff(system.mesh.s), [point(*own) for own in least]
    for k, j in zip(*np.nonzero(active), strict=True):
        near = spacing[max(k - 1, 0) : k + 2].max() / 2
        if all(j != i or abs(at - s[k]) > near for i, at in least):
            found.append(point(int(j), float(s[k])))
    return tuple(found)


def _way(of: Question, before: Array, load: float, share: float) -> Question:
    """Return the question at a share of the way."""
    tensions = before + share * (of.tensions - before)
    return replace(of, tensions=tensions, load=load + share * (of.load - load))


def _with_friction(
    of: Question, before: Array, load: float, start: Settled, jumps: bool
) -> Followed:
    """Return the end of the way with friction, which looks back over each step; see follow."""
    here, at, step, snaps = start, 0.0, _WITH_FRICTION, list[float]()
    last, way = start.here, list[tuple[Linearised, float]]()
    while at < 1:
        check_time()
        tell("percent of tensions and loads", round(100 * at), 100)
        share = min(1.0, at + step)
        on = replace(_way(of, before, load, share), history=History(here.here))
        last = here.here
        found = sharpened(on, here.here, here.places)
        if found is not None and close(here.here, found.here, _CLOSE):
            here, at, step = found, share, min(2 * step, _WITH_FRICTION)
        elif step > _FINEST:
            step /= 4
            continue
        elif not jumps:
            raise SnapError(at, "it jumps")
        else:
            here, at, step = _slid(on, here), share, _WITH_FRICTION
            snaps.append(share)
        way.append((here.here, share))
    return Followed(here, tuple(snaps), last, tuple(way))


def _slid(of: Question, here: Settled) -> Settled:
    """Return the equilibrium with friction near that which the arm without it snaps to."""
    base = of.base
    form = base.of.form.stages, True, base.of.form.machine_code
    free = System(base.arm, without_friction(base.scene), base.mesh, *form)
    smooth = replace(of, base=free, history=None)
    there, _ = _least_energy(smooth, of.tensions, of.load, here)
    found = sharpened(of, there.here, there.places)
    if found is None:
        raise UnsettledContactError(1.0, "where it comes to rest with friction is not found")
    return found
