"""Estimated loads against the loads of shapes that shooting with SciPy computes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, chi2

from octoplan import Arm, Scene, TipLoad, estimate_load
from octoplan.model.effects import Extension
from octoplan.planner.extensions.load_estimate.estimate import LoadEstimate
from tests.core.effects.spatial import LoadedRod, Loads
from tests.load_estimate.draws import KINDS, Draw, draw
from tests.oracles import Array, paper_rod

DRAWS = [(seed, KINDS[seed % 4]) for seed in range(60)]
# Honest 95 % regions hold fewer of 60 loads with a probability of 1e-3 only.
LEAST = binom.ppf(1e-3, len(DRAWS), 0.95)
ARM_PULLS = np.array([0.3, 0, 0, 0, 0.8, 0, 0, 0, 0, 1.0, 0, 0])


def estimated(drawn: Draw) -> LoadEstimate:
    return estimate_load(drawn.arm, drawn.scene, drawn.tensions, **drawn.measured)


def wrench(found: LoadEstimate) -> Array:
    return np.concatenate([found.force, found.moment])


@pytest.mark.quick("203-inner-3", "205-pose-6")
@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize(
    ("seed", "kind"),
    [(200, "tip"), (201, "pose"), (203, "inner"), (205, "pose"), (208, "tip"), (210, "points")],
)
def test_large_loads_are_recovered_without_noise(seed: int, kind: str, size: int) -> None:
    drawn = draw(seed, kind, size=size, noisy=False)
    found = estimated(drawn)
    off = wrench(found) - drawn.wrench
    assert off @ found.information @ off < 1e-4
    assert found.converged
    assert not found.undetermined


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "kind"), [(100, "tip"), (101, "pose"), (111, "inner")])
def test_loads_on_rubber_are_recovered_without_noise(seed: int, kind: str) -> None:
    drawn = draw(seed, kind, rubber=True, noisy=False)
    found = estimated(drawn)
    off = wrench(found) - drawn.wrench
    assert off @ found.information @ off < 1e-4


def in_region(drawn: Draw, level: float = 0.95) -> bool:
    moment = drawn.wrench[3:] if drawn.wrench[3:].any() else None
    return estimated(drawn).holds(drawn.wrench[:3], moment, level)


def in_ellipsoid(drawn: Draw) -> bool:
    found = estimated(drawn)
    off = wrench(found) - drawn.wrench
    return bool(off @ found.information @ off <= chi2.isf(0.05, found.n_determined))


def test_wide_regions_hold_in_two_draws() -> None:
    assert all(in_region(draw(seed, kind), 1 - 1e-5) for seed, kind in DRAWS[1:3])


def test_an_estimate_does_not_buckle_the_arm() -> None:
    """The noise of this draw asks for a compression beyond the critical load."""
    drawn = draw(1008, "tip")
    found = estimated(drawn)
    assert found.stable
    assert not found.converged
    assert "buckles near this load" in found.outcome
    assert found.holds(drawn.wrench[:3])


@pytest.mark.slow
def test_95_percent_regions_hold_in_60_draws() -> None:
    held = sum(in_region(draw(seed, kind)) for seed, kind in DRAWS)
    assert held >= LEAST


@pytest.mark.slow
def test_95_percent_ellipsoids_hold_for_small_noise() -> None:
    held = sum(in_ellipsoid(draw(seed, kind, std=5e-5)) for seed, kind in DRAWS)
    assert held >= LEAST


@pytest.mark.slow
def test_95_percent_regions_hold_with_noise_of_tensions() -> None:
    held = sum(in_region(draw(seed, kind, tension_std=0.02)) for seed, kind in DRAWS)
    assert held >= LEAST


def test_the_load_adds_to_a_load_of_the_scene() -> None:
    drawn = draw(208, "tip", noisy=False)
    known = (0.6 * drawn.wrench[:3]).tolist()
    scene = drawn.scene + TipLoad((known[0], known[1], known[2]))
    found = estimate_load(drawn.arm, scene, drawn.tensions, **drawn.measured)
    assert found.force == pytest.approx(0.4 * drawn.wrench[:3], abs=1e-3 * found.std[:3].max())


@pytest.mark.slow
def test_the_load_adds_to_a_follower_of_the_scene() -> None:
    arm = Arm.from_paper("table-4")
    known = (0.0, 0.5e-3, -0.5e-3)
    loads = Loads(force=np.array(known), follower=True)
    u, _ = LoadedRod(paper_rod("table-4"), ARM_PULLS, loads).poses((arm.length,))
    scene = Scene(Extension(), TipLoad(known, follower=True))
    found = estimate_load(arm, scene, ARM_PULLS, tip=u[0], std=1e-4)
    assert np.abs(found.force).max() < 1e-2 * found.std[:3].max()
