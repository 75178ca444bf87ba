"""The stated tip error of a shape, against the true error."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.forward import forward_map
from tests.core.model.cases import MOST, paper_tensions

SCENES = {"bare": Scene(), "extension": Scene(Extension()), "as_printed": Scene.as_printed()}


@pytest.mark.quick("25")
@pytest.mark.parametrize("sets", [25, 100])
def test_stated_errors_are_as_fine_as_asked_bound_the_true_ones_and_are_not_far_above(
    sets: int,
) -> None:
    """Random tensions on both arms to several accuracies; the reference is the finest mesh."""
    asked = np.logspace(-9, -3, sets)
    stated, true = np.zeros((2, sets))
    for seed in range(sets):
        rng = np.random.default_rng(seed)
        name, scene = str(rng.choice(list(MOST))), SCENES[str(rng.choice(list(SCENES)))]
        arm, T = Arm.from_paper(name), paper_tensions(rng, name)
        shape = settle(arm, T, scene, float(asked[seed]))
        finest = forward_map(arm, scene, 256).solve(T).poses[-1, 4:]
        stated[seed], true[seed] = shape.error, np.linalg.norm(shape.tip - finest) / arm.length
    assert (true <= asked).sum() >= 0.99 * sets
    assert (true <= stated).sum() >= 0.99 * sets
    assert np.all((stated > 0) & (stated <= asked))
    assert np.median(stated / true) < 10
    # The shapes use meshes of many sizes.
    assert true.min() < 1e-10 and true.max() > 1e-6
