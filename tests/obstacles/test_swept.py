"""Arms in motion: bounds of the clearance are never above the clearance by fine sampling."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from octoplan.model import Arm, Scene
from octoplan.model.centreline import Centreline
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.extensions.clearance.bisection import ClearanceQuery, closest
from octoplan.model.extensions.clearance.nearest import BASE, ITSELF, clearance_query
from octoplan.model.extensions.obstacles import Box, Capsule, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.loads import is_coupled
from octoplan.planner.extensions.avoidance.lines import Lines, Moving
from tests.core.model.cases import paper_tensions
from tests.oracles import Array

ARM = Arm.from_paper("table-4")
PAPER, SILICONE = Scene(Extension()), Scene.silicone()
IN_WATER = Scene(*Scene.silicone().effects, Weight(), Buoyancy())
KEEP = 0.002


def _obstacles(rng: np.random.Generator) -> list[Obstacle]:
    a, b = rng.uniform((0.05, -0.15, -0.15), (0.35, 0.15, 0.15), (2, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return [
        Sphere(a, rng.uniform(0.01, 0.05)),
        Capsule(b, b + 0.1 * rng.normal(size=3), rng.uniform(0.01, 0.03)),
        Box(rng.uniform(0.1, 0.3, 3), rng.uniform(0.02, 0.08, 3), turn * np.linalg.det(turn)),
    ]


def _ways(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return tensions at the ends of motions (count, 12): far and near ones."""
    start = np.array([paper_tensions(rng, "table-4") for _ in range(count)])
    start *= rng.uniform(size=start.shape) < 0.5
    other = np.array([paper_tensions(rng, "table-4") for _ in range(count)])
    size = np.where(np.arange(count) % 2, 1.0, 0.05)[:, None]
    return start, start + size * (other * (rng.uniform(size=start.shape) < 0.5) - start)


def _least(line: Centreline, obstacles: list[Obstacle], moved: Array, turn: float) -> float:
    """Return the least distance of many places of an arm, from displaced bodies (B, 3).

    `turn` is about half a turn: the angle between places that may meet.
    """
    x, r = line.at(np.linspace(0.0, ARM.length, 301))
    gaps = [float((own.distance(x - d) - r).min()) for own, d in zip(obstacles, moved, strict=True)]
    t = np.diff(x, axis=0) / np.linalg.norm(np.diff(x, axis=0), axis=1, keepdims=True)
    angle = np.arccos(np.clip(np.einsum("ki,ki->k", t[1:], t[:-1]), -1, 1))
    turned = np.concatenate([[0, 0], np.cumsum(angle)])
    d = np.linalg.norm(x[:, None] - x[None], axis=2) - r[:, None] - r[None]
    gaps.append(float(d[turned[None] - turned[:, None] >= turn].min(initial=np.inf)))
    height = (x - ARM.base_position) @ np.array(ARM.base_frame)[:, 0] - r
    gaps.append(float(height[turned >= turn / 2].min(initial=np.inf)))
    return min(gaps)


def _check(scene: Scene, rng: np.random.Generator, count: int, instants: int) -> None:
    start, end = _ways(rng, count)
    obstacles = _obstacles(rng)
    lines = Lines(ARM, scene, 2, (), False)
    moved = rng.normal(size=(count, 2, 3, 3)) * 0.02

    def tensions(which: NDArray[np.int64], share: Array) -> Array:
        return np.asarray(start[which] + share[:, None] * (end - start)[which])

    of_bodies = ClearanceQuery(obstacles, KEEP, np.zeros(3), moved)
    others = [clearance_query(ARM, kind, (), KEEP) for kind in (BASE, ITSELF)]
    found = [closest(Moving(lines, tensions), count, own) for own in (of_bodies, *others)]
    least = np.argmin([own.bound for own in found], axis=0), np.arange(count)
    bound, seen, at = (
        np.array([getattr(own, name) for own in found])[least]
        for name in ("bound", "seen", "share")
    )

    def true(k: int, share: float, turn: float) -> float:
        line = lines(start[k] + share * (end[k] - start[k]))
        assert line is not None
        at = moved[k, 0] + share * (moved[k, 1] - moved[k, 0])
        return _least(line, obstacles, at, turn) - KEEP

    for k in range(count):
        shares = np.linspace(0, 1, instants)
        assert bound[k] <= min(true(k, share, np.pi) for share in shares) + 1e-9
        # Places 1.5 mm apart have a slightly smaller angle than the arm.
        nearest = min(true(k, share, 0.96 * np.pi) for share in shares)
        if seen[k] < 0:
            nearest = min(nearest, true(k, at[k], 0.96 * np.pi))
            assert nearest <= seen[k] + 1e-3
        assert bound[k] >= min(1.0101 * nearest, 0.0) - 1.5e-3


@pytest.mark.quick("paper")
@pytest.mark.parametrize("scene", [PAPER, SILICONE], ids=["paper", "silicone"])
def test_no_bound_on_the_way_is_above_what_fine_sampling_sees(scene: Scene) -> None:
    _check(scene, np.random.default_rng(0), 4, 25)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [PAPER, SILICONE, IN_WATER], ids=["paper", "silicone", "water"])
def test_no_bound_on_many_ways_is_above_what_fine_sampling_sees(scene: Scene) -> None:
    for seed in range(8):
        _check(scene, np.random.default_rng(seed), 8, 61)


def _way(scene: Scene, T: Array) -> tuple[Lines, Moving]:
    lines = Lines(ARM, scene, 2, (), False)
    return lines, Moving(lines, lambda _, share: T[0] + share[:, None] * (T[1] - T[0]))


def _still(obstacle: Obstacle) -> ClearanceQuery:
    return clearance_query(ARM, "obstacles", [obstacle])


@pytest.mark.parametrize("scene", [PAPER, SILICONE, IN_WATER], ids=["paper", "silicone", "water"])
def test_a_thin_obstacle_that_is_touched_only_between_samples_is_seen(scene: Scene) -> None:
    T = np.zeros((2, 12))
    T[0, 4], T[1, 6] = 2.0, 2.0
    lines, way = _way(scene, T)
    # No power of two divides the fraction of the motion at which the arm touches.
    line = lines(T[0] + (T[1] - T[0]) / 3)
    assert line is not None
    (place, radius) = (own[0] for own in line.at(np.array([0.8 * ARM.length])))
    across = np.array([0.0, 0.0, 0.1])
    needle = Capsule(place - across, place + across, 1e-4)
    sampled = [lines(T[0] + share * (T[1] - T[0])) for share in (0.0, 0.5, 1.0)]
    places = np.linspace(0, ARM.length, 300)
    for own in sampled:
        assert own is not None
        x, r = own.at(places)
        assert (needle.distance(x) - r).min() > 0
    found = closest(way, 1, _still(needle))
    assert found.bound[0] <= -radius
    assert found.seen[0] < 0


def test_an_arm_that_jumps_on_its_way_is_not_verified() -> None:
    T = np.zeros((2, 12))
    T[1, 4] = 4.0
    far = _still(Sphere((0, 0, 5.0), 1.0))
    for scene in (PAPER, IN_WATER):
        lines, smooth = _way(scene, T)

        class Jumping(Moving):
            def lines(self, stretch: NDArray[np.int64], share: Array) -> list[Centreline | None]:
                return super().lines(stretch, (share > 0.43).astype(float))

        class Failing(Moving):
            def lines(self, stretch: NDArray[np.int64], share: Array) -> list[Centreline | None]:
                found = super().lines(stretch, share)
                return [None if u == 0.5 else x for x, u in zip(found, share, strict=True)]

        if is_coupled(ARM, scene):  # without loads there is one shape for any tensions: none jumps
            assert closest(Jumping(lines, smooth._tensions), 1, far).bound[0] == -np.inf
        near = _still(Capsule((0.3, 0.1, 0.0), (0.3, 0.2, 0.0), 0.05))
        assert closest(Failing(lines, smooth._tensions), 1, near).bound[0] == -np.inf
        assert closest(smooth, 1, far).bound[0] > 3.0


@pytest.mark.slow
def test_a_way_of_which_nothing_can_be_proven_is_told_as_not_verified() -> None:
    rng, scene = np.random.default_rng(508), Scene(Extension(), ExactTendons())
    rng.integers(5), rng.choice([2, 6, 15])
    T = [rng.uniform(0, 15, 12) * (rng.random(12) < 0.4) for _ in range(2)]
    _, moving = _way(scene, np.array(T))
    assert closest(moving, 1, clearance_query(ARM, BASE, [])).bound[0] == -np.inf
