"""First guesses with a physical meaning.

An arm that leans towards a point can do it in several ways that a local method cannot leave, and
what tells them apart is how far its tip is curled up: a tip that hangs loose, one that is bent,
one that is wound up into a coil. So there is one initial guess for each degree of curling; the
sections nearer the base pull, towards the point or away from it, as brings the arm closest to what
is wanted. All are read off a coarse mesh in one sweep.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from model.arm import Arm
from model.paths import Array
from planner.initial_guess.residuals import Residuals
from planner.program.limits import Limits, natural_tensions
from planner.program.problem import Problem
from planner.targets.base import Target

# In units of what bends the arm by about 1 rad. A slender tip saturates, so it takes many. The
# order is that in which they add to the share of targets whose best optimum is found.
_CURLS = (0.0, 12.0, 3.0, -2.0, 18.0, 7.0, -6.0)
_MIDDLE = (-4.0, -1.5, -0.5, 0.0, 0.4, 0.8, 1.4, 2.2, 3.5, 6.0)
_BASE = (-2.0, -1.0, -0.4, 0.0, 0.3, 0.7, 1.5, 3.5)
_ALONE = (0.15, 0.3, 0.6, 1.0, 1.6, 2.5, 4.0, 6.0)


def curled_arms(
    problem: Problem, targets: tuple[Target, ...], limits: Limits
) -> list[tuple[float, Array]]:
    """Return (distance from what is wanted, tensions): one for each degree of curling, in order.

    Each is the best over all directions to lean in; the other directions come after.
    """
    groups = _patterns(problem.arm, targets, limits)
    gaps, crushed = Residuals(problem, targets)(np.vstack([T for _, T in groups]))
    score = np.linalg.norm(gaps, axis=1) + 10 * crushed
    best: dict[float, list[tuple[float, Array]]] = {}
    first = 0
    for curl, T in groups:
        here = score[first : first + len(T)]
        best.setdefault(curl, []).append((float(here.min()), T[int(np.argmin(here))]))
        first += len(T)
    ranked = [sorted(found, key=_first) for found in best.values()]
    leading = [found[0] for found in ranked]
    others = [item for found in ranked for item in found[1:]]
    return leading + sorted(others, key=_first)


def _first(item: tuple[float, Array]) -> float:
    return item[0]


def _patterns(arm: Arm, targets: tuple[Target, ...], limits: Limits) -> list[tuple[float, Array]]:
    """Return (degree of curling, tensions (m, n_tendons) to choose from), for each direction."""
    tendons = frozenset.intersection(*(target.tendons(arm) for target in targets))
    sections = sorted({arm.tendons[j][0] for j in tendons})
    groups = []
    for angle in _leans(arm, targets):
        sides = [
            [section_tensions(arm, i, turned, tendons) for i in sections]
            for turned in (angle, angle + np.pi)
        ]
        if len(sections) == 1:
            groups.append((0.0, np.outer(_ALONE, sides[0][0])))
            continue
        tip, base = (_signed(sides, [k]) for k in (0, len(sections) - 1))
        middle = _signed(sides, list(range(1, len(sections) - 1)))
        inner = middle(_MIDDLE if len(sections) > 2 else (0.0,))[:, None]
        for curl in _CURLS:
            pulls = tip((curl,)) + inner + base(_BASE)
            groups.append((curl, pulls.reshape(-1, arm.n_tendons)))
    return [(curl, _pulled(T, limits)) for curl, T in groups]


def _signed(sides: list[list[Array]], sections: list[int]) -> Callable[[tuple[float, ...]], Array]:
    """Return levels (m,) -> the pull (m, n_tendons) of some sections together.

    That is towards for levels above 0, away below.
    """
    zero = np.zeros_like(sides[0][0])
    toward, away = (sum((side[k] for k in sections), zero) for side in sides)

    def pulls(levels: tuple[float, ...]) -> Array:
        level = np.array(levels)[:, None]
        return np.where(level >= 0, level * toward, -level * away)

    return pulls


def _pulled(T: Array, limits: Limits) -> Array:
    """Return tensions (m, n_tendons) within the limits."""
    low = np.array(limits.lower)
    T = np.clip(T, low, limits.upper)
    if limits.total is not None:
        spare = (T - low).sum(axis=1)
        room = np.maximum(limits.total - low.sum(), 0.0)
        T = low + (T - low) * np.minimum(1.0, room / np.maximum(spare, 1e-300))[:, None]
    return np.asarray(T)


def _leans(arm: Arm, targets: tuple[Target, ...]) -> list[float]:
    """Return directions to lean in, angles in the base's plane of n and b [rad]."""
    frame, base = np.array(arm.base_frame), np.array(arm.base_position)
    angles: list[float] = []
    for target in targets:
        point = target.guess_towards(arm)
        if point is None:
            continue
        local = frame.T @ (point - base)
        if np.hypot(local[1], local[2]) > 1e-3 * arm.length:
            angles.append(float(np.arctan2(local[2], local[1])))
    kept: list[float] = []
    for angle in angles or [0.0, np.pi / 2, np.pi, -np.pi / 2]:
        if all(abs(np.exp(1j * angle) - np.exp(1j * other)) > 0.1 for other in kept):
            kept.append(angle)
    return kept


def section_tensions(arm: Arm, section: int, angle: float, tendons: frozenset[int]) -> Array:
    """Return the tensions of one section that bend the arm by about 1 rad towards an angle [N].

    The tendons on that side share the pull as the law of section 6.1 has it for four of them.
    """
    unit = natural_tensions(arm)
    sides = np.array([np.exp(1j * (phi - angle)) for _, phi in arm.tendons])
    own = np.array([i == section and j in tendons for j, (i, _) in enumerate(arm.tendons)])
    share = np.where(own, np.maximum(sides.real, 0.0), 0.0)
    reach = abs(np.sum(share * sides))
    return share * unit / reach if reach > 0 else share


def distinct(starts: list[Array], count: int) -> list[Array]:
    """Return the first `count` starts that differ from each other."""
    kept: list[Array] = []
    for T in starts:
        scale = np.abs(T).max() + 1e-300
        if all(np.abs(T - other).max() > 1e-3 * scale for other in kept):
            kept.append(T)
        if len(kept) == count:
            break
    return kept
