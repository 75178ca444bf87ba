"""How the lengths of tendons change with tensions, and where Newton steps by it lead to."""

from __future__ import annotations

import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Material, Scene
from model.unloaded.tendon_lengths import FEW, tendon_lengths
from model.winches import least_compliance
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
    found = lengths(T).by_tensions
    sides = [[lengths(T + side * e).lengths for side in (step, -step)] for e in np.eye(T.size)]
    differences = np.array([(more - less) / (2 * step) for more, less in sides]).T
    assert found == pytest.approx(differences, abs=1e-7 * np.abs(found).max())


@pytest.mark.parametrize("scene", _SCENES.values(), ids=_SCENES)
def test_newton_steps_in_one_call_come_to_taut_and_slack_tendons(scene: Scene) -> None:
    arm = tapered((3, 3))
    lengths = tendon_lengths(arm, scene, points=FEW)
    T = np.array([0.3, 0.0, 0.0, 0.0, 0.5, 0.2])
    left = lengths(T).lengths + 1e-3 * (T == 0)
    soft, at = np.full(T.size, least_compliance(arm)), lengths.at_rest
    for _ in range(3):
        at, to, solved = lengths.stepped(at, left, soft, np.ones(T.size))
    assert solved
    assert to == pytest.approx(T, abs=1e-6)
