"""Backbones that the arm can follow are met, at an effort that no far limit changes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import Extension
from octoplan.planner import plan
from octoplan.planner.limits import natural_tensions
from octoplan.planner.targets import Backbone
from tests.core.planner.cases import Array

SIX = Arm(
    1.416,
    Linear(0.041, 0.0386),
    (
        Anchorage(
            1.416,
            Linear(0.0192, 0.0248),
            tuple(np.radians([248.7, 327.8, 369.3, 452.8, 512.9, 567.3]).tolist()),
        ),
    ),
    Material(42572.0, 0.5, 1048.0),
)
SEVEN = Arm(
    0.5,
    Linear(0.012, 0.008),
    (
        Anchorage(0.5, Linear(0.008, 0.006), (0.2, 1.8, 3.2, 4.9)),
        Anchorage(0.25, Linear(0.009, 0.008), (0.5, 2.6, 4.7)),
    ),
    Material(3e5, 0.45, 1050.0),
)
PAPER = Scene(Extension())
TABLE_4 = Arm.from_paper("table-4")
OWN = ((0.0, 0.4552, 0.0, 0.0), (1.2522, 0.0, 0.8235, 0.0), (7.8793, 0.0, 0.0, 3.3421))


def own_backbone(arm: Arm, T: Array, scene: Scene, shares: Array) -> Backbone:
    """Return the backbone of an arm's own shape through places at fractions of the length."""
    shape = settle(arm, T, scene, 1e-9)
    s = shares * arm.length
    return Backbone(tuple(tuple(shape.position(each)) for each in s), tuple(s.tolist()))


def distance(arm: Arm, T: Array, scene: Scene, backbone: Backbone) -> Array:
    """Return the distances of the settled arm from the points over its length."""
    shape, s = settle(arm, T, scene, 1e-10), backbone.s
    assert s is not None
    places = np.array([shape.position(each) for each in s])
    return (places - backbone.points).ravel() / arm.length / np.sqrt(len(s))


def drawn(arm: Arm, seed: int) -> Array:
    """Return tensions, of which some pull about as much as bends the arm by 0.5 rad [N]."""
    rng = np.random.default_rng(seed)
    of_each = rng.random(arm.n_tendons)
    return rng.uniform(0, 0.8, arm.n_tendons) * natural_tensions(arm) * (of_each < 0.6)


@pytest.mark.quick("2")
@pytest.mark.parametrize("norm", ["2", "1", "inf"])
def test_limits_that_are_far_leave_effort_as_it_is(norm: str) -> None:
    rng = np.random.default_rng(140112)
    T = 0.946 * rng.uniform(0, 0.5, 6) * (rng.random(6) < 0.6)
    backbone = own_backbone(SIX, T, PAPER, np.array([0.2, 0.6, 1.0]))
    efforts = []
    for most in (0.5, 1.0, 1.5, 3.0, 30.0, np.inf):
        p = plan(SIX, backbone, PAPER, most, norm=norm)
        assert p.reached, p.outcome
        assert np.linalg.norm(distance(SIX, p.tensions, PAPER, backbone)) < 1e-8
        efforts.append(p.effort)
    assert efforts == pytest.approx([efforts[0]] * len(efforts), rel=1e-5)
    assert efforts[0] <= np.linalg.norm(T, float(norm)) * (1 + 1e-5)


@pytest.mark.parametrize("most", [10.0, pytest.param(30.0, marks=pytest.mark.slow)])
def test_a_backbone_of_the_own_shape_of_silicone_is_met(most: float) -> None:
    scene = Scene.silicone()
    backbone = own_backbone(TABLE_4, np.array(OWN), scene, np.linspace(0.25, 1, 4))
    p = plan(TABLE_4, backbone, scene, most)
    assert p.reached, p.outcome
    assert np.linalg.norm(distance(TABLE_4, p.tensions, scene, backbone)) < 1e-7
    assert p.effort <= np.linalg.norm(OWN) * (1 + 1e-6)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 7))]
)
@pytest.mark.parametrize("arm", [SIX, SEVEN], ids=["six", "seven"])
def test_effort_is_least_among_tensions_that_meet_it(arm: Arm, seed: int) -> None:
    """SciPy trades effort for residuals at a low price, from the plan's tensions."""
    T = drawn(arm, seed)
    backbone = own_backbone(arm, T, PAPER, np.array([0.3, 0.5, 0.8, 1.0]))
    most = float(2 * T.max())
    p = plan(arm, backbone, PAPER, most)
    assert np.linalg.norm(distance(arm, p.tensions, PAPER, backbone)) < 1e-8
    assert p.effort <= np.linalg.norm(T) * (1 + 1e-5)
    unit = T.max()

    def gaps(x: Array, price: float) -> Array:
        return np.append(distance(arm, unit * np.abs(x), PAPER, backbone), price * x)

    price = 1e-7
    begin = np.ravel(p.tensions) / unit
    best = least_squares(gaps, begin, args=(price,), x_scale=1.0, max_nfev=12)
    cheaper = unit * np.linalg.norm(best.x)
    missed = np.linalg.norm(distance(arm, unit * np.abs(best.x), PAPER, backbone))
    # Tensions of less effort miss the points.
    assert cheaper > p.effort * (1 - 1e-4) or missed > 1e-9


@pytest.mark.slow
def test_a_backbone_out_of_reach_costs_the_same_for_far_limits() -> None:
    backbone = own_backbone(SEVEN, drawn(SEVEN, 7), PAPER, np.array([0.3, 0.5, 0.8, 1.0]))
    moved = Backbone(
        tuple((x, y, z + 0.01 * i) for i, (x, y, z) in enumerate(backbone.points)), backbone.s
    )
    plans = [plan(SEVEN, moved, PAPER, most) for most in (3.0, 10.0, 100.0, np.inf)]
    assert all(p.mode == "closest" for p in plans)
    assert [p.effort for p in plans] == pytest.approx([plans[0].effort] * 4, rel=1e-5)
