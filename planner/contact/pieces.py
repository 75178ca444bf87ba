"""Where an equilibrium with contact is smooth in the tensions: what touches goes on touching.

The map from tensions to shapes is smooth in pieces. In one of them the same places touch: their
forces stay 0 or above, pressures along parts that lie as well, and gaps elsewhere. Where one of
these vanishes the piece ends and another begins. Programs in the tensions have them as inequalities
of a step, and then look at the piece beyond (a piecewise program; Luo, Pang and Ralph,
"Mathematical Programs with Equilibrium Constraints", 1996, chapter 6).
"""

from __future__ import annotations

import numpy as np

from model.centreline import Centreline
from model.contact.along import along
from model.contact.between import between_nodes
from model.contact.gaps import Gaps
from model.contact.passing import gaps_along
from model.contact.touches import Touches
from model.equilibrium.linearised import Linearised
from model.loads import contacts
from model.obstacles import numbers_of
from model.obstacles.base import pair_distances
from model.paths import Array

# Gaps up to this share of the arm's length count, with this step in the tensions' derivatives.
_NEAR, _STEP = 0.01, 1e-5
_NEWTON = 3
# Gaps below this share may close with an optimum.
_CLOSING = 1e-4


def piece_margins(here: Linearised, force: float, pressed: float = 0.0) -> tuple[Array, Array]:
    """Return what is 0 or above in the piece (k,), and its derivatives by tensions (k, n).

    Forces over a unit of force [N] and beyond what has to be `pressed`, pressures over that and the
    arm's length, gaps over the length.
    """
    system, L = here.system, here.system.arm.length
    touches, own = Touches.of(system), system.of.touches
    P, p = own[:, :, 0][touches.held], own[:, :, 1][touches.end | touches.inside]
    moved = here.by_tensions
    s, j = _openings(here, touches)
    gap, gap_jacobian = _gaps(here, s, j)
    values = [here.states[P] / force - pressed, here.states[p] * L / force, gap / L]
    jacobian = [moved[P] / force, moved[p] * L / force, gap_jacobian / L]
    return np.concatenate(values), np.vstack(jacobian)


def _openings(here: Linearised, touches: Touches) -> tuple[Array, Array]:
    """Return where gaps that are open are least (k,) [m], and whose of the obstacles they are."""
    system, L = here.system, here.system.arm.length
    s, gap = gaps_along(system, here.states)
    nodes = system.mesh.s
    at, whose = list[float](), list[int]()
    for j in range(gap.shape[1]):
        shut = nodes[touches.held[:, j] | touches.inside[:, j]]
        before, after = np.append(np.inf, gap[:-1, j]), np.append(gap[1:, j], np.inf)
        least = (gap[:, j] < before) & (gap[:, j] <= after) & (gap[:, j] < _NEAR * L)
        for k in np.flatnonzero(least).tolist():
            h = s[min(k + 1, s.size - 1)] - s[k - 1]
            if not shut.size or np.abs(shut - s[k]).min() > h:
                at.append(float(s[k]))
                whose.append(j)
    found, own = np.array(at), np.array(whose, dtype=int)
    for _ in range(_NEWTON if found.size else 0):
        _, slope, curve = along(system, here.x, found, own).T
        inner = (found < L) | (slope > 0)
        step = np.where(inner & (curve > 0), -slope / np.where(curve > 0, curve, 1.0), 0.0)
        h = np.diff(nodes).min()
        found = np.clip(found + np.clip(step, -h, h), nodes[1] / 2, L)
    return found, own


def _gaps(here: Linearised, s: Array, j: Array) -> tuple[Array, Array]:
    """Return gaps (k,) [m] at arc lengths s (k,), and their derivatives (k, n) by tensions.

    Of gaps that are about to close they are found at the place, by differences; of others, which
    hold no optimum, they are those of the nodes around it, on a cubic.
    """
    n = here.tensions.size
    if not s.size:
        return np.zeros(0), np.zeros((0, n))
    system = here.system
    gap = along(system, here.x, s, j)[:, 0]
    jacobian, near = np.zeros((s.size, n)), gap < _CLOSING * system.arm.length
    if near.any():
        jacobian[near] = _by_differences(here, s[near], j[near])
    if not near.all():
        moved = Gaps.of(system, here.states).moved(here.by_tensions)
        there = between_nodes(system.mesh.s[1:], moved, s[~near])
        jacobian[~near] = there[np.arange(len(there)), j[~near]]
    return gap, jacobian


def _by_differences(here: Linearised, s: Array, j: Array) -> Array:
    """Return the derivatives (k, n) by tensions of gaps at arc lengths s (k,)."""
    system, moved, k = here.system, here.by_tensions, s.size
    turns = np.abs(moved[system.of.nodes[:, :4]]).max(axis=(0, 1))
    steps = _STEP / np.maximum(turns, 1e-300)
    there = here.states[:, None] + np.hstack([moved * steps, -moved * steps])
    lines = Centreline.joined([Centreline.at_states(system, own) for own in there.T])
    nodes = system.mesh.s
    element = np.clip(np.searchsorted(nodes, s) - 1, 0, nodes.size - 2)
    share = np.tile((s - nodes[element]) / np.diff(nodes)[element], 2 * steps.size)
    element = (nodes.size * np.arange(2 * steps.size)[:, None] + element).ravel()
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])[j]
    points = lines.moved(element, np.zeros(element.size), share)[0]
    distance = pair_distances(np.tile(bodies, (2 * steps.size, 1)), points)[0]
    gaps = (distance - lines.radius(element, share)).reshape(2, steps.size, k)
    return np.asarray((gaps[0] - gaps[1]).T / (2 * steps))
