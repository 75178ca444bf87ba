"""First guesses with a physical meaning.

An arm of this kind has few ways to lean towards a point: one section pulls towards it, or one
pulls towards it and another away, or neighbours alternate. Each way is a pattern; how hard each
section of a pattern pulls is read off a coarse mesh, all levels in one sweep. The patterns are then
taken in the order of how near they come, those with fewer sections first.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations, product

import casadi as ca
import numpy as np

from model.arm import Arm
from model.forward import forward_map, schemes_of
from model.paths import Array
from model.scene import Scene
from planner.limits import Limits, natural_tensions
from planner.problem import Problem
from planner.targets.base import Target

_LEVELS = (0.15, 0.3, 0.6, 1.0, 1.6, 2.5, 4.0, 6.0)
_PAIR_LEVELS = (0.2, 0.5, 1.0, 2.0, 4.0)
_MOST_PAIRS = 12
_FEASIBLE = 0.05


def candidates(
    problem: Problem, targets: tuple[Target, ...], limits: Limits
) -> list[tuple[float, Array]]:
    """Return (distance from what is wanted, tensions), most promising first.

    First the best of each pattern over all directions, single sections before others; then the
    patterns in their other directions.
    """
    groups = _patterns(problem.arm, targets, limits)
    score = _scores(problem, targets, np.vstack([T for _, T in groups]))
    best: dict[str, list[tuple[float, Array]]] = {}
    first = 0
    for name, T in groups:
        here = score[first : first + len(T)]
        best.setdefault(name, []).append((float(here.min()), T[int(np.argmin(here))]))
        first += len(T)
    ranked = [sorted(found, key=_first) for found in best.values()]
    leading = [found[0] for found in ranked]
    singles = sum(name.startswith("one") for name in best)
    others = [item for found in ranked for item in found[1:]]
    ordered = sorted(leading[:singles], key=_first) + sorted(leading[singles:], key=_first)
    return ordered + sorted(others, key=_first)


def _first(item: tuple[float, Array]) -> float:
    return item[0]


def _scores(problem: Problem, targets: tuple[Target, ...], T: Array) -> Array:
    """Return the size of all residuals and violations (m,) for tensions (m, n_tendons)."""
    sweep = _sweep(problem.arm, problem.scene, problem.stations).map(len(T))
    poses, least = (np.array(value) for value in sweep(T.T))
    numbers = np.concatenate([target.parameters(problem.arm) for target in targets])
    terms = problem.terms.map(len(T))(poses, np.tile(numbers[:, None], len(T)))
    match, approach, margin = (np.array(value).reshape(-1, len(T)) for value in terms)
    size = np.sqrt((match**2).sum(0) + (approach**2).sum(0) + (np.minimum(margin, 0) ** 2).sum(0))
    crushed = np.maximum(_FEASIBLE - least[0], 0)
    return np.asarray(np.where(np.isfinite(size), size, 1e3) + 10 * crushed)


@lru_cache(maxsize=64)
def _sweep(arm: Arm, scene: Scene, stations: tuple[float, ...]) -> ca.Function:
    """Return tensions -> station poses (7, K), least 1 + q, on the coarsest mesh."""
    forward = forward_map(arm, scene, schemes_of(scene)[0], 1, stations)
    T = ca.MX.sym("T", arm.n_tendons)
    poses, stretch = forward.function(T)[:2]
    columns = [forward.mesh.node(s) for s in stations]
    return ca.Function("sweep", [T], [poses[:, columns], ca.mmin(stretch)])


def _patterns(arm: Arm, targets: tuple[Target, ...], limits: Limits) -> list[tuple[str, Array]]:
    """Return (name of a pattern, tensions (m, n_tendons) at all its levels), for each direction."""
    tendons = frozenset.intersection(*(target.tendons(arm) for target in targets))
    sections = sorted({arm.tendons[j][0] for j in tendons})
    singles, others = [], []
    for angle in _leans(arm, targets):
        toward = [section_pulls(arm, i, angle, tendons) for i in sections]
        away = [section_pulls(arm, i, angle + np.pi, tendons) for i in sections]
        for i, pull in enumerate(toward):
            singles.append((f"one {i}", np.outer(_LEVELS, pull)))
        pairs = list(permutations(range(len(sections)), 2))
        near = [pair for pair in pairs if abs(pair[0] - pair[1]) == 1]
        for i, j in pairs if len(pairs) <= _MOST_PAIRS else near:
            levels = product(_PAIR_LEVELS, _PAIR_LEVELS)
            pulls = [a * toward[i] + b * away[j] for a, b in levels]
            others.append((f"two {i} {j}", np.array(pulls)))
        if len(sections) > 2:
            others.append(("all, tip towards", _alternating(toward, away)))
            others.append(("all, tip away", _alternating(away, toward)))
    return [(name, _pulled(T, limits)) for name, T in singles + others]


def _alternating(one: list[Array], other: list[Array]) -> Array:
    """Return pulls (m, n_tendons) that change sides from section to section, tip first."""
    sides = np.array([one[i] if i % 2 == 0 else other[i] for i in range(len(one))])
    powers = np.arange(len(sides))
    shares = [ratio**powers @ sides for ratio in (0.7, 1.0, 1.5)]
    return np.array([level * share for share in shares for level in (0.5, 1.0, 2.0, 4.0)])


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
        local = frame.T @ (target.lean(arm) - base)
        if np.hypot(local[1], local[2]) > 1e-3 * arm.length:
            angles.append(float(np.arctan2(local[2], local[1])))
    kept: list[float] = []
    for angle in angles or [0.0, np.pi / 2, np.pi, -np.pi / 2]:
        if all(abs(np.exp(1j * angle) - np.exp(1j * other)) > 0.1 for other in kept):
            kept.append(angle)
    return kept


def section_pulls(arm: Arm, section: int, angle: float, tendons: frozenset[int]) -> Array:
    """Return the tensions of one section that bend the arm by about 1 rad towards an angle [N].

    The tendons on that side share the pull as the law of section 6.1 has it for four of them.
    """
    unit = natural_tensions(arm)
    sides = np.array([np.exp(1j * (phi - angle)) for _, phi in arm.tendons])
    own = np.array([i == section and j in tendons for j, (i, _) in enumerate(arm.tendons)])
    share = np.where(own, np.maximum(sides.real, 0.0), 0.0)
    reach = abs(np.sum(share * sides))
    return share * unit / reach if reach > 0 else share


def spread(starts: list[tuple[float, Array]], count: int) -> list[Array]:
    """Return the first `count` starts that differ from each other."""
    kept: list[Array] = []
    for _, T in starts:
        scale = np.abs(T).max() + 1e-300
        if all(np.abs(T - other).max() > 1e-3 * scale for other in kept):
            kept.append(T)
        if len(kept) == count:
            break
    return kept
