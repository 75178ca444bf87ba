"""Gaps between the arm and its obstacles: anywhere along the arm, and where they are least."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d

from octoplan.model.centreline import Centreline
from octoplan.model.equilibrium.integration import poses_and_strains
from octoplan.model.equilibrium.linearised import Index
from octoplan.model.extensions.contact.effects import bodies_of, contacts
from octoplan.model.extensions.contact.kernels import gap_along
from octoplan.model.extensions.contact.touches import Place, Places
from octoplan.model.extensions.obstacles.base import distances
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import BatchFunction, cached

# What a gap may be below 0, over the arm's length; of slopes, and over the largest of forces, what
# is rounding.
THROUGH = SAME
# Gaps are sampled so often in each element; where one is least, among so many places in as many
# intervals, each around the least of the one before.
_SAMPLES, _AMONG = 6, 9


def along(system: DiscreteRod, x: Array, s: Array, obstacles: Index) -> tuple[Array, Array]:
    """Return gap [m], gap' [-] and gap'' [1/m] (N, 3) at arc lengths s (N,), on their base side.

    Each of one of the obstacles (N,), by its number; and the midline's derivative (N, 3) there.
    """
    of, mesh = system.layout, system.mesh
    poses, v = poses_and_strains(system, x, s)
    m, step = of.structure.stages, np.clip(np.searchsorted(mesh.s, s) - 1, 0, mesh.elements - 1)
    h, p = np.diff(mesh.s)[step], np.arange(1, m)
    weights = p * ((s - mesh.s[step]) / h)[:, None] ** (p - 1) @ gauss(m).powers[1:] / h[:, None]
    stages = x[of.n_before_states + of.stages].reshape(-1, m, of.structure.n_strains)[step]
    rate = np.einsum("km,kmn->kn", weights, stages)
    call = cached(BatchFunction, cached(gap_along, of.structure.law), of.structure.machine_code)
    radii = np.array(system.arm.outer_radius(s)).T
    gaps, _, tangents = call(poses, v, rate, bodies_of(system.scene)[obstacles], radii)
    return gaps, tangents


def gaps_along(system: DiscreteRod, states: Array, samples: int = _SAMPLES) -> tuple[Array, Array]:
    """Return arc lengths (n,) beyond the base, and the gaps there (n, K) [m].

    So many in each element, the last at its end.
    """
    steps, mesh = system.mesh.elements, system.mesh.s
    s = np.interp(np.arange(1, samples * steps + 1) / samples, np.arange(steps + 1), mesh)
    points, radii = Centreline.at_states(system, states).at(s)
    return s, distances(bodies_of(system.scene), points)[0] - radii[:, None]


def least_gaps(system: DiscreteRod, x: Array, places: Places = ()) -> Places:
    """Return where gaps are least, and below 0, by obstacle.

    But for `places`, where the arm touches already. Gaps change at most twice as fast as arc
    length, so that they may be below 0 beside samples which are nearer than that.
    """
    s, gap = gaps_along(system, x[system.layout.n_before_states :])
    apart, same, L = np.diff(s, prepend=0.0, append=s[-1]), SAME * s[-1], system.arm.length
    widest = np.maximum(apart[:-1], apart[1:])
    least = (gap <= minimum_filter1d(gap, 3, 0)) & (gap < widest[:, None])
    for place in places:
        least[(s >= place.start - same) & (s <= place.end + same), place.obstacle] = False
    k, j = np.nonzero(least)
    at, reach, gaps = s[k], widest[k], np.zeros((k.size, 1))
    for _ in range(_AMONG):
        if not k.size:
            break
        ends = np.maximum(at - reach, THROUGH * L), np.minimum(at + reach, L)
        stations = np.linspace(*ends, _AMONG, axis=1)
        values, _ = along(system, x, stations.ravel(), np.repeat(j, _AMONG))
        gaps = values[:, 0].reshape(-1, _AMONG)
        at = stations[np.arange(k.size), gaps.argmin(axis=1)]
        reach = (ends[1] - ends[0]) / (_AMONG - 1)
        # Between stations gaps are smaller by at most the distance of the stations.
        maybe = gaps.min(axis=1) < reach
        k, j, at, reach, gaps = k[maybe], j[maybe], at[maybe], reach[maybe], gaps[maybe]
    low = gaps.min(axis=1) < -THROUGH * L
    lowest = zip(j[low].tolist(), at[low].tolist(), strict=True)
    return tuple(Place(number, place, place) for number, place in sorted(set(lowest)))


def check_outside(system: DiscreteRod, states: Array) -> None:
    """Raise InputError where the arm at rest, with states (n_states,), is inside of an obstacle."""
    (s, gap), bodies = gaps_along(system, states), contacts(system.scene)
    inside, deepest = gap.min(axis=0) < -THROUGH * system.arm.length, gap.argmin(axis=0)
    if inside.any():
        first, *_ = which = np.flatnonzero(inside)
        where = [
            f"{-1e3 * gap[deepest[j], j]:.3g} mm inside"
            f"{f' of {bodies[j].obstacle}' * bool(j > first)} at s = {s[deepest[j]]:.4g} m"
            for j in which
        ]
        allowed = f"one that the arm at rest is clear of; it is {', and '.join(where)}"
        raise InputError("Contact.obstacle", bodies[first].obstacle, allowed)
