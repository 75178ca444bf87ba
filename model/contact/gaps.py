"""Gaps between the arm and its obstacles: anywhere along the arm, and where they are least."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.centreline import Centreline
from model.contact.touches import Places
from model.cross_section.law import CrossSection, size
from model.equilibrium.integration import poses_and_strains
from model.equilibrium.linearised import Index
from model.errors import InputError
from model.loads import contacts
from model.machine.buffered import Mapped
from model.obstacles import distances, numbers_of
from model.obstacles.base import SIZE, signed_distance
from model.paths import SAME, Array
from model.rotations import unit_matrix
from model.transcription.collocation import gauss
from model.transcription.system import System
from model.transcription.touch import TOUCH, swelling

# What a gap may be below 0, over the arm's length.
THROUGH = 1e-9
# Gaps are sampled so often in each element; where one is least, among so many places in so many
# intervals, each around the least of the one before.
_SAMPLES, _AMONG, _NARROWED = 6, 9, 7


def along(system: System, x: Array, s: Array, obstacles: Array | Index) -> Array:
    """Return gap [m], gap' [-] and gap'' [1/m] (N, 3) at arc lengths s (N,), on their base side.

    Each of one of the obstacles (N,), by its number.
    """
    of, mesh = system.of, system.mesh
    poses, v = poses_and_strains(system, x, s)
    m, step = of.form.stages, np.clip(np.searchsorted(mesh.s, s) - 1, 0, mesh.steps - 1)
    h = np.diff(mesh.s)[step]
    fraction = (s - mesh.s[step]) / h
    p = np.arange(1, m)
    weights = p * fraction[:, None] ** (p - 1) @ gauss(m).powers[1:] / h[:, None]
    stages = x[of.first + of.stages].reshape(-1, m, of.form.strains)[step]
    rate = np.einsum("km,kmn->kn", weights, stages)
    bodies = system.p[of.equations.numbers_of("touch")].reshape(-1, of.form.contacts, TOUCH)
    radii = np.array(system.arm.outer_radius(s))
    return _along(of.form.law, of.form.machine_code)(
        poses, v, rate, bodies[0, obstacles, :SIZE], radii.T
    )[0]


@lru_cache(maxsize=32)
def _along(law: CrossSection, machine_code: bool) -> Mapped:
    """Return pose, strains, their rates, an obstacle, radius and two derivatives -> gap, ..."""
    g, v, rate = ca.SX.sym("g", 7), ca.SX.sym("v", size(law)), ca.SX.sym("rate", size(law))
    body, radius = ca.SX.sym("body", SIZE), ca.SX.sym("radius", 3)
    distance, normal = signed_distance()(g[4:], body)
    kappa, nu = law.twist(v)
    R = unit_matrix(g[:4])
    u1 = R @ nu
    u2 = R @ (ca.cross(kappa, nu) + ca.jtimes(nu, v, rate))
    bend = ca.jacobian(normal, g[4:])
    wide, widening = swelling(law, v)
    wide1 = widening @ rate
    wide2 = ca.jtimes(wide1, v, rate)
    gap = ca.vertcat(
        distance - radius[0] * wide,
        ca.dot(normal, u1) - radius[1] * wide - radius[0] * wide1,
        ca.dot(normal, u2)
        + ca.dot(u1, bend @ u1)
        - radius[2] * wide
        - 2 * radius[1] * wide1
        - radius[0] * wide2,
    )
    function = ca.Function("along", [g, v, rate, body, radius], [gap], {"cse": True})
    return Mapped(function, machine_code)


def gaps_along(system: System, states: Array) -> tuple[Array, Array]:
    """Return arc lengths (n,) beyond the base, and the gaps there (n, K) [m]."""
    line, fractions = Centreline.at_states(system, states), np.arange(1, _SAMPLES + 1) / _SAMPLES
    element = np.repeat(np.arange(system.mesh.steps), _SAMPLES)
    fraction = np.tile(fractions, system.mesh.steps)
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
    wide = np.pad(gap, ((1, 1), (0, 0)), constant_values=np.inf)
    least, same = (gap < reach[:, None]) & (gap <= wide[:-2]) & (gap <= wide[2:]), SAME * s[-1]
    for place in places:
        least[(s >= place.start - same) & (s <= place.end + same), place.obstacle] = False
    k, j = np.nonzero(least)
    if not k.size:
        return []
    at, reach, most = s[k], reach[k], system.arm.length
    for _ in range(_NARROWED):
        ends = np.maximum(at - reach, THROUGH * most), np.minimum(at + reach, most)
        stations = np.linspace(*ends, _AMONG, axis=1)
        gaps = along(system, x, stations.ravel(), np.repeat(j, _AMONG))[:, 0].reshape(
            stations.shape
        )
        at = np.take_along_axis(stations, gaps.argmin(axis=1)[:, None], axis=1)[:, 0]
        reach = (ends[1] - ends[0]) / (_AMONG - 1)
    low = gaps.min(axis=1) < -THROUGH * most
    return sorted(set(zip(j[low].tolist(), at[low].tolist(), strict=True)))


def check_outside(system: System, states: Array) -> None:
    """Raise InputError where the arm at rest, with states (n_states,), is inside of an obstacle."""
    s, gap = gaps_along(system, states)
    inside = np.flatnonzero(gap.min(axis=0) < -THROUGH * system.arm.length)
    if inside.size:
        bodies = [contact.obstacle for contact in contacts(system.scene)]
        deepest = zip(inside, gap[:, inside].argmin(axis=0), strict=True)
        where = [
            f"{-1e3 * gap[k, j]:.3g} mm inside{f' of {bodies[j]}' if j > inside[0] else ''}"
            f" at s = {s[k]:.4g} m"
            for j, k in deepest
        ]
        allowed = f"one that the arm at rest is clear of; it is {', and '.join(where)}"
        raise InputError("Contact.obstacle", bodies[inside[0]], allowed)
