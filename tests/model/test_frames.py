"""Frames are orthonormal by every scheme, and what quaternions drift from unit length is small."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import ExactTendons, Extension
from model.forward import schemes_of
from tests.oracles import Array

SCENES = {
    "bare": Scene(),
    "extension": Scene(Extension()),
    "as_printed": Scene.as_printed(),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}
TENSIONS = np.array([0, 0.1, 0.2, 0, 1, 0, 0, 0.5, 0, 0, 2, 1])
ARM = Arm.from_paper("table-4")
EACH = [
    pytest.param(scene, scheme, id=f"{key}-{scheme}")
    for key, scene in SCENES.items()
    for scheme in schemes_of(scene)
]


def gap(frames: Array) -> float:
    """Return how far frames (N, 3, 3) are from right-handed orthonormal ones."""
    skew = np.abs(np.swapaxes(frames, 1, 2) @ frames - np.eye(3)).max()
    return float(max(skew, np.abs(np.linalg.det(frames) - 1).max()))


@pytest.mark.parametrize(("scene", "scheme"), EACH)
def test_frames_are_orthonormal_at_coarse_accuracy(scene: Scene, scheme: str) -> None:
    shape = settle(ARM, TENSIONS, scene, 1e-2, scheme)
    assert gap(shape.tip_frame[None]) <= 1e-13
    assert gap(shape.frame(np.linspace(0, ARM.length, 37))) <= 1e-13
