"""Settles by lengths against SciPy's minimisation of the energy under inequalities."""

from __future__ import annotations

import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Material, Scene, settle
from model.effects import ExactTendons, Extension, TipLoad
from model.winches import rest_lengths
from tests.lengths.minimisation import Cone
from tests.model.cases import Array

FRAME = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def test_the_shape_is_of_least_energy() -> None:
    check_least(1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_many_shapes_are_of_least_energy(seed: int) -> None:
    check_least(seed)


def check_least(seed: int) -> None:
    """Assert that a random arm with random lengths and a payload is where SciPy finds it."""
    rng = np.random.default_rng(seed)
    ends = (0.12, 0.2)
    radii = rng.uniform(7e-3, 9e-3), rng.uniform(5e-3, 7e-3)
    offsets = tuple((rng.uniform(4e-3, 6e-3), rng.uniform(2e-3, 5e-3)) for _ in ends)
    E = rng.uniform(1e5, 3e5)
    force: Array = rng.normal(0, 0.5 * E * np.pi * radii[1] ** 4 / 4 / ends[-1] ** 2, 3)
    sections = tuple(
        Anchorage(at, Linear(*offset)) for at, offset in zip(ends, offsets, strict=True)
    )[::-1]
    arm = Arm(ends[-1], Linear(*radii), sections, Material(E, 0.45))
    lengths = rest_lengths(arm) * (1 + rng.uniform(-0.03, 0.03, 8))
    scene = Scene(Extension(), ExactTendons(), TipLoad(tuple(force.tolist())))
    shape = settle(arm, scene=scene, accuracy=1e-8, lengths=lengths)
    order = np.r_[4:8, 0:4]
    cone = Cone(ends, radii, offsets, E, 0.45, FRAME, force)
    tip, found, _ = cone.least(lengths[order])
    assert np.linalg.norm(shape.tip - tip) <= 1e-6 * arm.length
    assert shape.tendon_lengths[order] == pytest.approx(found, abs=1e-6 * arm.length)
