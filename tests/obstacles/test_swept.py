"""Arms on their way: bounds of the clearance are never above what fine sampling sees."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from model import Arm, InputError, Scene
from model.centreline import Centreline
from model.clearance.lines import Lines
from model.clearance.smooth import SHARES, chebyshev, control, falls, highest
from model.clearance.swept import Around, swept
from model.effects import Buoyancy, Extension, Weight
from model.obstacles import Box, Capsule, HalfSpace, Obstacle, Sphere
from model.obstacles.bodies import Bodies
from tests.model.cases import paper_tensions

ARM = Arm.from_paper("table-4")
PAPER, SILICONE = Scene(Extension()), Scene.silicone()
IN_WATER = Scene(*Scene.silicone().effects, Weight(), Buoyancy())
KEEP = 0.002
Array = NDArray[np.float64]
_FAR = np.array([[(0.0, 0.0, 0.0)], [(0.02, -0.01, 0.03)]])


def _obstacles(rng: np.random.Generator) -> list[Obstacle]:
    a, b = rng.uniform((0.05, -0.15, -0.15), (0.35, 0.15, 0.15), (2, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return [
        Sphere(a, rng.uniform(0.01, 0.05)),
        Capsule(b, b + 0.1 * rng.normal(size=3), rng.uniform(0.01, 0.03)),
        Box(rng.uniform(0.1, 0.3, 3), rng.uniform(0.02, 0.08, 3), turn * np.linalg.det(turn)),
    ]


def _ways(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return tensions where ways begin and end (count, 12): far ones, and near ones."""
    start = np.array([paper_tensions(rng, "table-4") for _ in range(count)])
    start *= rng.uniform(size=start.shape) < 0.5
    other = np.array([paper_tensions(rng, "table-4") for _ in range(count)])
    size = np.where(np.arange(count) % 2, 1.0, 0.05)[:, None]
    return start, start + size * (other * (rng.uniform(size=start.shape) < 0.5) - start)


def _least(line: Centreline, obstacles: list[Obstacle], moved: Array, turn: float) -> float:
    """Return the least distance of many places of an arm, from what has moved (B, 3).

    `turn` is about a half turn: between places that may meet.
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

    def settled(which: NDArray[np.int64], share: Array) -> list[Centreline | None]:
        return lines.many(start[which] + share[:, None] * (end - start)[which])

    plane = HalfSpace(ARM.base_position, np.array(ARM.base_frame)[:, 0])
    bodies, turns = Bodies([*obstacles, plane]), np.array([0, 0, 0, np.pi / 2])
    with_plane = np.concatenate([moved, np.zeros((count, 2, 1, 3))], axis=2)
    found = swept(settled, count, Around(bodies, with_plane, turns, True, KEEP))

    def true(k: int, share: float, turn: float) -> float:
        line = lines(start[k] + share * (end[k] - start[k]))
        assert line is not None
        at = moved[k, 0] + share * (moved[k, 1] - moved[k, 0])
        return _least(line, obstacles, at, turn) - KEEP

    for k in range(count):
        shares = np.linspace(0, 1, instants)
        assert found.bound[k] <= min(true(k, share, np.pi) for share in shares) + 1e-9
        # Of places 1.5 mm apart turns are a little less than those of the arm.
        nearest = min(true(k, share, 0.96 * np.pi) for share in shares)
        if found.seen[k] < 0:
            nearest = min(nearest, true(k, found.share[k], 0.96 * np.pi))
            assert nearest <= found.seen[k] + 1e-3
        assert found.bound[k] >= min(1.0101 * nearest, 0.0) - 1.5e-3


@pytest.mark.quick("paper")
@pytest.mark.parametrize("scene", [PAPER, SILICONE], ids=["paper", "silicone"])
def test_no_bound_on_the_way_is_above_what_fine_sampling_sees(scene: Scene) -> None:
    _check(scene, np.random.default_rng(0), 4, 25)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [PAPER, SILICONE, IN_WATER], ids=["paper", "silicone", "water"])
def test_no_bound_on_many_ways_is_above_what_fine_sampling_sees(scene: Scene) -> None:
    for seed in range(8):
        _check(scene, np.random.default_rng(seed), 8, 61)


def test_what_is_only_touched_halfway_is_seen() -> None:
    lines, T = Lines(ARM, PAPER, 2, (), False), np.zeros((2, 12))
    T[0, 4], T[1, 6] = 4.0, 4.0
    line = lines((T[0] + T[1]) / 2)
    assert line is not None
    tip = line.poses[-1, 4:] + np.array([0.0, 0.0, 0.008])

    def settled(_: NDArray[np.int64], share: Array) -> list[Centreline | None]:
        return lines.many(T[0] + share[:, None] * (T[1] - T[0]))

    ball = Bodies([Sphere(tip, 0.0065)])
    still, zero = np.zeros((1, 2, 1, 3)), np.zeros(1)
    found = swept(settled, 1, Around(ball, still, zero, False, 0.0))
    assert found.seen[0] < 0
    assert found.share[0] == pytest.approx(0.5, abs=0.2)
    away = swept(settled, 1, Around(ball, still + np.array([0, 0, 0.1]), zero, False, 0.0))
    assert away.bound[0] > 0


def test_an_arm_that_jumps_on_its_way_is_not_verified() -> None:
    lines = Lines(ARM, PAPER, 2, (), False)
    T = np.zeros((2, 12))
    T[1, 4] = 4.0
    around = Around(Bodies([Sphere((0, 0, 5.0), 1.0)]), np.zeros((1, 2, 1, 3)), np.zeros(1), 0, 0)

    def jumps(_: NDArray[np.int64], share: Array) -> list[Centreline | None]:
        return [lines(T[int(u > 0.43)]) for u in share]

    def fails(_: NDArray[np.int64], share: Array) -> list[Centreline | None]:
        return [None if u == 0.5 else lines(T[0]) for u in share]

    assert swept(jumps, 1, around).bound[0] == -np.inf
    assert swept(fails, 1, around).bound[0] == -np.inf
    assert swept(lambda _, u: lines.many(T[1] * u[:, None]), 1, around).bound[0] > 3.0


def test_smooth_functions_stay_below_their_bound_and_others_are_told() -> None:
    x = np.linspace(0, 1, 1001)
    smooth = [
        lambda u: np.exp(2 * u),
        lambda u: np.sin(3 * u + 0.4),
        lambda u: 1 / (1.5 + u),
        lambda u: u**3 - u**2,
        lambda u: 0 * u + 2,
    ]
    for f in smooth:
        values = f(SHARES)[None]
        assert falls(np.abs(chebyshev(values)), 1e-12)[0]
        assert highest(values)[0] >= f(x).max() - 1e-12
        assert control(values).min() <= f(x).min() + 1e-3
    for g in (lambda u: np.sign(u - 0.3), lambda u: np.sin(12 * u), lambda u: u**8 * (1 - u)):
        assert not falls(np.abs(chebyshev(g(SHARES)[None])), 1e-12)[0]
    assert highest(-np.abs(SHARES - 0.6)[None])[0] >= 0


def test_motions_as_printed_are_refused_and_not_cleared_for_another_shape() -> None:
    with pytest.raises(InputError, match="motions as printed are not cleared"):
        Lines(ARM, Scene.as_printed(), 2, (), False)
