"""Frames are orthonormal by every scheme, and what quaternions drift from unit length is small."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import ExactTendons, Extension
from model.forward import equilibrium_on, forward_map, order_of, schemes_of
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
EXPLICIT = {"rk4": (4, 8, 16), "rk6": (4, 8, 16), "rk8": (4, 8)}


def gap(frames: Array) -> float:
    """Return how far frames (N, 3, 3) are from right-handed orthonormal ones."""
    skew = np.abs(np.swapaxes(frames, 1, 2) @ frames - np.eye(3)).max()
    return float(max(skew, np.abs(np.linalg.det(frames) - 1).max()))


@pytest.mark.parametrize(("scene", "scheme"), EACH)
def test_frames_are_orthonormal_at_coarse_accuracy(scene: Scene, scheme: str) -> None:
    shape = settle(ARM, TENSIONS, scene, 1e-2, scheme)
    assert gap(shape.tip_frame[None]) <= 1e-13
    assert gap(shape.frame(np.linspace(0, ARM.length, 37))) <= 1e-13


@pytest.mark.parametrize("scheme", EXPLICIT)
def test_position_does_not_feel_the_length_of_the_quaternion(scheme: str) -> None:
    shape = settle(ARM, TENSIONS, SCENES["as_printed"], 1e-2, scheme)
    s = np.linspace(0, ARM.length, 400)
    run = np.linalg.norm(np.diff(shape.position(s), axis=0), axis=1).sum()
    stretch = 1 + shape.strain(s)[:, 3]
    assert run == pytest.approx(np.trapezoid(stretch, s), rel=1e-3)


# Exponentials are rotations.
UNIT = ("magnus2", "magnus4", "magnus6", "gauss2", "gauss4", "gauss6", "gauss8")


def drift(scene: str, scheme: str, refinement: int) -> float:
    """Return by how much the longest quaternion differs from 1."""
    states = equilibrium_on(forward_map(ARM, SCENES[scene], scheme, refinement), TENSIONS).poses
    return float(np.abs(np.linalg.norm(states[:, :4], axis=1) - 1).max())


@pytest.mark.parametrize("scheme", UNIT)
@pytest.mark.parametrize("refinement", [1, 16])
def test_lie_group_schemes_keep_quaternions_at_unit_length(scheme: str, refinement: int) -> None:
    assert drift("extension", scheme, refinement) <= 1e-14


@pytest.mark.parametrize("scheme", EXPLICIT)
def test_the_drift_that_the_projection_takes_away_falls_at_the_order(scheme: str) -> None:
    drifts = np.array([drift("as_printed", scheme, refinement) for refinement in EXPLICIT[scheme]])
    order = order_of(scheme, SCENES["as_printed"])
    assert drifts.min() > 1e-13
    assert np.all(np.log2(drifts[:-1] / drifts[1:]) > order - 0.3)
