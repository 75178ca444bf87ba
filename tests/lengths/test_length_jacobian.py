"""How the lengths of tendons change with tensions."""

from __future__ import annotations

import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Material, Scene
from model.unloaded.marched import tendon_lengths
from tests.lengths.cases import PAPER, SCENES

_SCENES = {"paper": PAPER["paper"], **{k: SCENES[k] for k in ("inextensible", "exact", "silicone")}}


def tapered(counts: tuple[int, ...]) -> Arm:
    """Return an arm whose sections, tip to base, have so many tendons."""
    ends = np.linspace(0.3, 0.3 / len(counts), len(counts))
    sections = tuple(
        Anchorage(at, Linear(6e-3, 3e-3), tuple(0.3 * i + 2 * np.pi / n * np.arange(n)))
        for i, (at, n) in enumerate(zip(ends, counts, strict=True))
    )
    return Arm(0.3, Linear(1e-2, 6e-3), sections, Material(E=2e5))


# Six tendons are as many as there are resultants, which were once taken for tensions.
@pytest.mark.parametrize("counts", [(4,), (3, 3), (4, 4)])
@pytest.mark.parametrize("scene", _SCENES.values(), ids=_SCENES)
def test_jacobian_of_lengths_are_those_of_differences(
    scene: Scene, counts: tuple[int, ...]
) -> None:
    arm, step = tapered(counts), 1e-5
    lengths = tendon_lengths(arm, scene)
    T = np.random.default_rng(1).uniform(0, 0.4, arm.n_tendons)
    found = lengths(T).length_tension
    sides = [[lengths(T + side * e).lengths for side in (step, -step)] for e in np.eye(T.size)]
    differences = np.array([(more - less) / (2 * step) for more, less in sides]).T
    assert found == pytest.approx(differences, abs=1e-7 * np.abs(found).max())
