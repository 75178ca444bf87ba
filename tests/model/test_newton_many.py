"""Newton's method for many sets of tensions at once finds what it finds for each alone."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Buoyancy, Weight
from model.equilibrium.forward import Collocation
from model.equilibrium.newton import newton, newton_many

WATER = Scene(*Scene.silicone().effects, Weight(), Buoyancy(1000.0))


@pytest.mark.parametrize("farthest", [0.3, 0.01])
def test_many_equilibria_are_those_found_alone(farthest: float) -> None:
    forward = Collocation(Arm.from_paper("table-4"), WATER, 2, 1)
    rng, rest = np.random.default_rng(1), forward.found(np.zeros(12))
    T = rng.uniform(0, 0.3, (6, 12)) * rng.uniform(0, 1, (6, 1)) ** 3
    guesses = rest.states + T @ rest.by_tensions.T
    kept = [rest if i % 2 else None for i in range(6)]
    many = newton_many(forward.system, T, 1.0, guesses, farthest, kept)
    alone = [
        newton(forward.system, pulls, 1.0, guess, farthest, kept=own)
        for pulls, guess, own in zip(T, guesses, kept, strict=True)
    ]
    assert [own is None for own in many.solutions] == [own is None for own in alone]
    assert 0 < sum(own is not None for own in alone) < 7
    for one, other in zip(many.solutions, alone, strict=True):
        if one is not None and other is not None:
            assert np.allclose(one.states, other.states, rtol=1e-9, atol=1e-10)
    assert np.array_equal(many.turned > farthest, [own is None for own in alone]) or farthest > 0.1


def test_where_there_is_no_step_nothing_is_found() -> None:
    forward = Collocation(Arm.from_paper("table-4"), WATER, 2, 1)
    rest = forward.found(np.zeros(12))
    guesses = np.vstack([rest.states, np.full_like(rest.states, np.nan)])
    found, _, turned = newton_many(forward.system, np.zeros((2, 12)), 1.0, guesses)
    assert found[0] is not None and found[1] is None
    assert turned[1] == np.inf
