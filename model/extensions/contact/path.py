"""Load paths with contact: tensions and loads change along straight lines, obstacles are present.

The equilibrium is continued with forces at the nodes that are complementary to the gaps. Newton's
method solves each step; if no stable equilibrium is found nearby, the least energy with gaps >= 0
is minimised. The arm snaps if the frames turn far in the shortest step. At the end of the path,
nodes are exchanged for points of least gap (Hettich and Kortanek, SIAM Review 35, 1993), until the
contact places can be refined; see octoplan.model.extensions.contact.sharp. Friction depends on each
step, so that the places are refined in each step; during a snap the arm slides without friction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from scipy.ndimage import minimum_filter1d

from octoplan.model.equilibrium.collocation_map import transfer_strains
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.modes import unstable_mode
from octoplan.model.equilibrium.newton import Start, newton
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.extensions.contact.effects import bodies_of, without_friction
from octoplan.model.extensions.contact.gaps import gaps_along, least_gaps
from octoplan.model.extensions.contact.sharp import Request, close, sharpened
from octoplan.model.extensions.contact.touches import (
    ContactFlags,
    Place,
    Places,
    forces,
    places_of,
    read_off,
)
from octoplan.model.extensions.lengths.least_energy import LeastEnergy
from octoplan.model.extensions.obstacles.base import distances
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.errors import SnapError, UnsettledContactError
from octoplan.model.support.progress import check_time, report

# First, least and longest step in the load factor. Longer steps may end on the other side of an
# obstacle, and with friction a rolling point would count as slip.
_STEPS = 1 / 8, 1 / 128, 1 / 8
# Largest number of exchanges of nodes or pairs.
EXCHANGES = 8
# Number of updates of forces without a potential in a step; the refinement includes such forces.
_ROUNDS = 3
# Initial rotation of the frames away from an unstable equilibrium [rad].
_ASIDE = 0.1
T = TypeVar("T")
# Equilibria on a load path with load factors; the first factor is 0.
Path = Sequence[tuple[Equilibrium, float]]


@dataclass(frozen=True, eq=False)
class ContactEquilibrium(Equilibrium):
    """An equilibrium with contact, whose system contains the contact flags of the mesh.

    Attributes
    ----------
    path : tuple
        With friction, the equilibria of the load path with load factors, the initial one first.
    """

    path: Path = ()

    @classmethod
    def of(
        cls, end: Equilibrium, snaps: tuple[float, ...] = (), path: Path = ()
    ) -> ContactEquilibrium:
        """Return an equilibrium with the history of the load path."""
        return cls(
            end.system,
            end.x,
            linearised_at=end.linearised_at,
            jacobian=end.jacobian,
            history="near",
            snaps=snaps,
            path=path,
        )

    @property
    def before(self) -> Equilibrium | None:
        """With friction, the equilibrium before the last step, from which slip is measured."""
        return self.path[-2][0] if self.path else None

    def __reduce__(self) -> tuple[Any, ...]:
        values = self.system, self.x, None, None, self.history, self.snaps, self.path[-2:]
        return ContactEquilibrium, values


def follow(end: Request, near: Equilibrium, jumps: bool = True) -> ContactEquilibrium:
    """Return the equilibrium at the end of the load path from an equilibrium to a request.

    Raises UnsettledContactError if no equilibrium is found, and SnapError if the arm snaps and
    `jumps` is False.
    """
    snaps, rubs, base = list[float](), end.before is not None, end.base
    begin, goal = near.x[: near.system.layout.n_before_states], np.append(end.tensions, end.load)

    def solve(before: float, factor: float, near: Equilibrium, least: bool) -> Equilibrium | None:
        x = begin + factor * (goal - begin)
        to = replace(end, tensions=x[:-1], load=float(x[-1]), before=near if rubs else None)
        there = sharpened(to, near) if rubs else _complementary(to, near) or _least_energy(to, near)
        if there is not None and close(near, there):
            # Motion before the first contact does not count as slip.
            begins = rubs and len(places_of(there.system)) > len(places_of(near.system))
            return None if begins and not least else there
        if not least:
            return None
        if there is None and not rubs:
            raise UnsettledContactError(factor, "no least energy is found")
        if not jumps:
            raise SnapError(before, "it jumps")
        snaps.append(factor)
        return _with_friction(to, near) if rubs else there

    if rubs:
        path = stepped(solve, near, _STEPS)
        return ContactEquilibrium.of(path[-1][0], tuple(snaps), tuple(path))
    strains = transfer_strains(near.system, near.states[near.system.layout.stages], base)
    states = base.initial_states(begin[:-1], strains, float(begin[-1]))
    free = Equilibrium(base, np.append(begin, states))
    rough, _ = stepped(solve, free, _STEPS)[-1]
    there = _at_refined_places(end, rough)
    if not close(rough, there):
        if not jumps:
            raise SnapError(1.0, "it jumps")
        snaps.append(1.0)
    return ContactEquilibrium.of(there, tuple(snaps))


def retraced(end: Request, path: Path) -> ContactEquilibrium | None:
    """Return the equilibrium after the steps of a path with friction on another mesh, or None.

    With equal steps, two shapes differ by the errors of both meshes alone.
    """
    (begin, _), *others = path
    x, goal = begin.x[: begin.system.layout.n_before_states], np.append(end.tensions, end.load)
    anew = [path[0]]
    for near, factor in others:
        check_time()
        at = x + factor * (goal - x)
        to = replace(end, tensions=at[:-1], load=float(at[-1]), before=anew[-1][0])
        there = sharpened(to, near)
        if there is None:
            return None
        anew.append((there, factor))
    return ContactEquilibrium.of(anew[-1][0], (), tuple(anew))


def stepped(
    solve: Callable[[float, float, T, bool], T | None], start: T, steps: tuple[float, float, float]
) -> list[tuple[T, float]]:
    """Return solutions and load factors from 0 to 1, each solved from the previous solution.

    `solve` takes the load factors before and after a step, the previous solution, and whether the
    step is the least. The step is shortened if `solve` returns None; for the least step `solve`
    returns a solution, or raises. `steps` are the first, the least and the longest step.
    """
    path, (step, least, longest) = [(start, 0.0)], steps
    while path[-1][1] < 1:
        check_time()
        near, at = path[-1]
        report("percent of tensions and loads", round(100 * at), 100)
        factor = min(1.0, at + step)
        there = solve(at, factor, near, step <= least)
        if there is None:
            step /= 4
            continue
        path, step = [*path, (there, factor)], min(2 * step, longest)
    return path


def _complementary(request: Request, near: Equilibrium) -> Equilibrium | None:
    """Return the equilibrium with forces at nodes, on the mesh of a near equilibrium.

    Return None if Newton's method finds no close and stable equilibrium, or if a node moves through
    an obstacle by half the arm's radius or more; the motion is sampled at this distance.
    """
    to = request.tensions, request.load
    (there,) = newton(near.system, [Start(*to, near.states)], update_contacts=_active_set)
    if there is None or not (close(near, there) and is_stable(there)):
        return None
    half = there.system.arm.outer_radius(there.mesh.s[1:])[0] / 2
    start, end = near.poses[1:, 4:], there.poses[1:, 4:]
    count = 2 + int((np.linalg.norm(end - start, axis=1) / half).max())
    between = np.linspace(start, end, count).reshape(-1, 3)
    gaps = distances(bodies_of(there.system.scene), between)[0].min(axis=1).reshape(count, -1)
    return None if (gaps < half).any() else there


def _active_set(system: DiscreteRod, states: Array) -> DiscreteRod:
    """Return the system with the touching nodes: nodes with f > 0, and local minima of gaps < 0.

    With this active set Newton's method solves f >= 0, gap >= 0, f gap = 0 at the nodes.
    """
    gap, touches = gaps_along(system, states, 1)[1], ContactFlags.of(system)
    deepest = (gap < 0) & (gap <= minimum_filter1d(gap, 3, 0))
    presses = forces(system, states)[1:] > 0
    touches.held[1:] = np.where(touches.points[1:], presses, deepest)
    return touches.on(system)


def _least_energy(request: Request, near: Equilibrium) -> Equilibrium | None:
    """Return the equilibrium of least energy near another one, with forces at nodes, or None."""
    program, system = LeastEnergy(request.base), request.base
    strains = transfer_strains(near.system, near.states[near.system.layout.stages], system)
    to = request.tensions, request.load
    minimum = program.minimise(program.near(near.tensions, strains), *to, rounds=_ROUNDS)
    if minimum is None:
        return None
    touches, states = ContactFlags.of(system), program.states(minimum, request.load)
    gaps, L = gaps_along(system, states, 1)[1], system.arm.length
    # A node of an interior point is in contact if the scaled force exceeds the scaled gap.
    touches.held[1:] = minimum.forces / program.force_unit > gaps / L
    return Equilibrium(touches.on(system), system.x(minimum.tensions, request.load, states))


def _at_refined_places(request: Request, rough: Equilibrium) -> Equilibrium:
    """Return the stable equilibrium at refined places, near an equilibrium with forces at nodes.

    If the refinement fails, touching nodes move to points of least gap, and other nodes to negative
    gaps between nodes. From an unstable equilibrium the energy is minimised on one side.
    """
    for _ in range(EXCHANGES):
        check_time()
        # Touching neighbours lie on the obstacle.
        touching = ContactFlags.of(rough.system).points
        force = forces(rough.system, rough.states)
        end = sharpened(request, rough, read_off(rough.system, touching, touching, force))
        if end is not None:
            mode, rough = unstable_mode(end), end
            if mode is None:
                return end
            x, of = end.x.copy(), end.system.layout
            x[of.n_before_states + of.stages] += _ASIDE * mode
            rough = Equilibrium(end.system, x)
        base = request.on(_contact_nodes(rough))
        after = None if base is None else _least_energy(replace(request, base=base), rough)
        if after is None:
            break
        rough = after
    raise UnsettledContactError(1.0, "where it touches is not found")


def _contact_nodes(rough: Equilibrium) -> Places:
    """Return the wanted places of nodes: touching nodes, and negative local minima of gaps."""
    s, least = rough.mesh.s, least_gaps(rough.system, rough.x)
    touching = np.argwhere(ContactFlags.of(rough.system).points)
    widths = np.append(np.diff(s), 0.0)
    return least + tuple(
        Place(int(j), float(s[k]), float(s[k]))
        for k, j in touching
        if not any(
            j == i and abs(at - s[k]) <= widths[max(k - 2, 0) : k + 1].max() / 2
            for i, at, _ in least
        )
    )


def _with_friction(request: Request, near: Equilibrium) -> Equilibrium:
    """Return the equilibrium with friction near the end of a snap without friction."""
    base = request.base
    scene = without_friction(base.scene)
    base = base.on_mesh(base.mesh, scene)
    smooth = replace(request, base=base, before=None)
    rough = _least_energy(smooth, near)
    there = None if rough is None else sharpened(request, _at_refined_places(smooth, rough))
    if there is None:
        raise UnsettledContactError(1.0, "where it comes to rest with friction is not found")
    return there
