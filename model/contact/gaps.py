"""Gaps between the arm and its obstacles: anywhere along the arm, and where they are least."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d

from model.centreline import Centreline
from model.contact.touches import Places
from model.equilibrium.integration import poses_and_strains
from model.equilibrium.linearised import Index
from model.errors import InputError
from model.loads import contacts
from model.machine.buffered import mapped
from model.machine.compiled import built
from model.obstacles import distances, numbers_of
from model.paths import SAME, Array
from model.transcription.collocation import gauss
from model.transcription.system import System
from model.transcription.touch import gap_along

# What a gap may be below 0, over the arm's length; of slopes, and over the largest of forces, what
# is rounding.
THROUGH = SAME
# Gaps are sampled so often in each element; where one is least, among so many places in as many
# intervals, each around the least of the one before.
_SAMPLES, _AMONG = 6, 9


def along(system: System, x: Array, s: Array, obstacles: Index) -> tuple[Array, Array, Array]:
    """Return gap [m], gap' [-] and gap'' [1/m] (N, 3) at arc lengths s (N,), on their base side.

    Each of one of the obstacles (N,), by its number; and its normal and the midline's derivative
    (N, 3) there.
    """
    of, mesh = system.of, system.mesh
    poses, v = poses_and_strains(system, x, s)
    m, step = of.form.stages, np.clip(np.searchsorted(mesh.s, s) - 1, 0, mesh.steps - 1)
    h, p = np.diff(mesh.s)[step], np.arange(1, m)
    fraction = (s - mesh.s[step]) / h
    weights = p * fraction[:, None] ** (p - 1) @ gauss(m).powers[1:] / h[:, None]
    stages = x[of.first + of.stages].reshape(-1, m, of.form.strains)[step]
    rate = np.einsum("km,kmn->kn", weights, stages)
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])[obstacles]
    radii = np.array(system.arm.outer_radius(s)).T
    call = mapped(built(gap_along, of.form.law), of.form.machine_code)
    gaps, normals, tangents = call(poses, v, rate, bodies, radii)
    return gaps, normals, tangents


def gaps_along(system: System, states: Array, samples: int = _SAMPLES) -> tuple[Array, Array]:
    """Return arc lengths (n,) beyond the base, and the gaps there (n, K) [m].

    So many in each element, the last at its end.
    """
    line, steps = Centreline.at_states(system, states), system.mesh.steps
    element = np.repeat(np.arange(steps), samples)
    fraction = np.tile(np.arange(1, samples + 1) / samples, steps)
    points = line.along(element, np.zeros(element.size), fraction)[0]
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    s = system.mesh.s[element] + fraction * np.diff(system.mesh.s)[element]
    return s, distances(bodies, points)[0] - line.radius(element, fraction)[:, None]


def least_gaps(system: System, x: Array, places: Places = ()) -> list[tuple[int, float]]:
    """Return obstacle and arc length [m] where gaps are least, and below 0.

    But for `places`, where the arm touches already. Gaps change at most twice as fast as arc
    length, so that they may be below 0 beside samples which are nearer than that.
    """
    s, gap = gaps_along(system, x[system.of.first :])
    apart = np.diff(s, prepend=0.0)
    reach = np.maximum(apart, np.append(apart[1:], 0.0))
    least, same, L = (
        (gap <= minimum_filter1d(gap, 3, 0)) & (gap < reach[:, None]),
        SAME * s[-1],
        system.arm.length,
    )
    for place in places:
        least[(s >= place.start - same) & (s <= place.end + same), place.obstacle] = False
    k, j = np.nonzero(least)
    at, reach, gaps = s[k], reach[k], np.zeros((k.size, 1))
    for _ in range(_AMONG * bool(k.size)):
        ends = np.maximum(at - reach, THROUGH * L), np.minimum(at + reach, L)
        stations = np.linspace(*ends, _AMONG, axis=1)
        gaps = along(system, x, stations.ravel(), np.repeat(j, _AMONG))[0][:, 0]
        gaps = gaps.reshape(stations.shape)
        at = stations[np.arange(k.size), gaps.argmin(axis=1)]
        reach = (ends[1] - ends[0]) / (_AMONG - 1)
    low = gaps.min(axis=1) < -THROUGH * L
    return sorted(set(zip(j[low].tolist(), at[low].tolist(), strict=True)))


def check_outside(system: System, states: Array) -> None:
    """Raise InputError where the arm at rest, with states (n_states,), is inside of an obstacle."""
    (s, gap), bodies = gaps_along(system, states), contacts(system.scene)
    inside = np.flatnonzero(gap.min(axis=0) < -THROUGH * system.arm.length)
    if inside.size:
        deepest = gap[:, inside].argmin(axis=0)
        of = ["", *(f" of {bodies[j].obstacle}" for j in inside[1:])]
        where = [
            f"{-1e3 * gap[k, j]:.3g} mm inside{body} at s = {s[k]:.4g} m"
            for j, k, body in zip(inside, deepest, of, strict=True)
        ]
        allowed = f"one that the arm at rest is clear of; it is {', and '.join(where)}"
        raise InputError("Contact.obstacle", bodies[inside[0]].obstacle, allowed)
