"""Random lengths converge, whatever they ask; refused is only what no shape has or is crushed."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, CollapsedError, InputError, Scene, settle
from model.winches import rest_lengths
from tests.lengths.cases import EXACT, SCENES, check_complementary


@pytest.mark.parametrize("name", ["table-2", "table-4"])
@pytest.mark.parametrize("scene", [EXACT, Scene.silicone(), Scene(*EXACT.effects[1:])])
def test_random_strokes_settle(name: str, scene: Scene) -> None:
    check_strokes(Arm.from_paper(name), scene, 3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table-2", "table-4"])
@pytest.mark.parametrize("scene", ["exact", "silicone", "in water", "current"])
def test_many_random_strokes_settle(name: str, scene: str) -> None:
    check_strokes(Arm.from_paper(name), SCENES[scene], 125)


def check_strokes(arm: Arm, scene: Scene, count: int) -> None:
    """Assert that lengths within 15 % of those at rest settle, or are refused for a reason."""
    rng, rest = np.random.default_rng(5), rest_lengths(arm)
    for _ in range(count):
        lengths = rest * (1 + rng.uniform(-0.15, 0.15, rest.size))
        try:
            shape = settle(arm, scene=scene, accuracy=1e-4, lengths=lengths)
        except (CollapsedError, InputError) as refusal:
            assert "crushed" in str(refusal) or "no shape" in str(refusal)
            continue
        check_complementary(shape)
