"""The clearance of settled arms: never above the true clearance, and close to it."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.arm import conical
from octoplan.model.centreline import Centreline
from octoplan.model.effects import Buoyancy, Extension, TipLoad, Weight
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.extensions.clearance import clearance
from octoplan.model.extensions.clearance.nearest import BASE, ITSELF, clearances
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.rod.discrete_rod import system
from tests.core.model.cases import paper_tensions
from tests.oracles import Array

ARM = Arm.from_paper("table-4")
_ALLOWED = 2e-5, 2e-2


def _sampled(line: Centreline, obstacles: list[Obstacle], count: int) -> dict[str, float]:
    """Return distances at many places: balls along the midline, written out anew."""
    arm, s = line.arm, np.linspace(0.0, line.arm.length, count)
    x, r = line.at(s)
    t = np.diff(x, axis=0)
    length = np.linalg.norm(t, axis=1, keepdims=True)
    t /= length
    angle = np.arccos(np.clip(np.einsum("ki,ki->k", t[1:], t[:-1]), -1, 1))
    turned = np.concatenate([[0, 0], np.cumsum(angle)])
    found = {
        "obstacles": min((float((o.distance(x) - r).min()) for o in obstacles), default=np.inf)
    }
    height = (x - arm.base_position) @ np.array(arm.base_frame)[:, 0]
    found[BASE] = float((height - r)[turned >= np.pi / 2].min(initial=np.inf))
    pairs = np.linalg.norm(x[:, None] - x[None], axis=2) - r[:, None] - r[None]
    found[ITSELF] = float(pairs[turned[None] - turned[:, None] >= np.pi].min(initial=np.inf))
    return found


def _pulls(rng: np.random.Generator) -> Array:
    """Return tensions (12,) [N] that the arm bears, half of them 0."""
    return paper_tensions(rng, "table-4") * (rng.uniform(size=12) < 0.5)


def _line(scene: Scene, T: Array) -> Centreline:
    forward = CollocationMap(system(ARM, scene, STAGES, 3))
    return Centreline.at_states(forward.system, forward.solve(T).states)


def _obstacles(rng: np.random.Generator) -> list[Obstacle]:
    a, b, c = rng.uniform(-0.2, 0.4, (3, 3))
    size = rng.uniform(0.01, 0.08, 3)
    normal = rng.normal(size=3)
    return [
        Sphere(a, size[0]),
        Capsule(b, b + 0.1 * normal, size[1]),
        Box(c, size),
        HalfSpace((-0.2, -0.2, -0.2), normal),
    ]


def _check(seeds: range, count: int) -> None:
    for seed in seeds:
        rng = np.random.default_rng(seed)
        scene = (Scene(Extension()), Scene.silicone())[seed % 2]
        line, obstacles = _line(scene, _pulls(rng)), _obstacles(rng)
        found, true = clearances(line, obstacles), _sampled(line, obstacles, count)
        for name, clear in found.items():
            low, high = clear.gap, true[name]
            assert low <= high + 1e-9
            # Sampling starts at the first place beyond a turn, not exactly at the turn.
            if name == "obstacles":
                sampling = 0.3 * (ARM.length / count)
                assert high - low <= _ALLOWED[0] * ARM.length + _ALLOWED[1] * abs(high) + sampling


def test_clearance_is_a_lower_bound_and_close() -> None:
    _check(range(8), 900)


@pytest.mark.slow
def test_clearance_of_a_thousand_shapes_is_a_lower_bound_and_close() -> None:
    _check(range(1000), 1500)


def test_what_is_between_nodes_is_that_of_the_shape() -> None:
    T = _pulls(np.random.default_rng(3))
    for scene in (Scene(Extension()), Scene.silicone(), Scene(Extension(), Weight(), Buoyancy())):
        shape = settle(ARM, T, scene, 1e-9)
        s = np.linspace(0.0, ARM.length, 41)
        for line in (shape.centreline(), _line(scene, T)):
            assert np.abs(line.at(s)[0] - shape.position(s)).max() < 1e-6 * ARM.length


def test_a_straight_arm_meets_nothing_by_itself() -> None:
    found = clearance(settle(ARM, np.zeros(12), Scene()))
    assert found.gap == np.inf
    assert str(found) == "nothing near"


def test_a_straight_arm_is_as_far_from_a_ball_as_geometry_says() -> None:
    shape = settle(ARM, np.zeros(12), Scene())
    taper, height = 13e-3 / 0.45, 0.1
    # Gap of the cone u = (s, 0, 0), r = 15 mm - taper s, to a ball above s = 0.2 m.
    at = 0.2 - height * taper / np.sqrt(1 - taper**2)
    true = np.hypot(at - 0.2, height) - (15e-3 - taper * at) - 0.03
    gap = clearance(shape, Sphere((0.2, 0.0, height), 0.03)).gap
    assert true - 1e-2 * true - 1e-5 <= gap <= true + 1e-9


def _coil(turns: float, radius: float) -> Centreline:
    """Return a cylinder 1 m long that a tip moment bends to a number of turns of a circle."""
    arm = conical(1.0, (radius, radius), [(1.0, radius / 2, radius / 2)])
    moment = 2 * np.pi * turns * arm.material.E * np.pi * radius**4 / 4
    scene = Scene(TipLoad(moment=(0.0, 0.0, moment)))
    return settle(arm, np.zeros(4), scene, 1e-9).centreline()


@pytest.mark.parametrize(("turns", "radius"), [(0.8, 0.01), (0.95, 0.02), (1.3, 0.01)])
def test_a_circular_arm_is_as_near_to_itself_as_geometry_says(turns: float, radius: float) -> None:
    found = clearances(_coil(turns, radius))[ITSELF]
    most = 2 * np.pi * turns
    # The chord falls with the angle between two places once this is beyond half a turn.
    angles = np.linspace(np.pi, most, 4001)
    chord = (2 / most * np.abs(np.sin(angles / 2))).min()
    true = chord - 2 * radius
    assert true - 1e-2 * abs(true) - 1e-4 <= found.gap <= true + 1e-6


def test_half_a_circle_and_less_never_meets_itself() -> None:
    assert clearances(_coil(0.49, 0.03))[ITSELF].gap == np.inf
