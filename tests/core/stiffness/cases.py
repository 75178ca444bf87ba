"""Scenes, settled tensions and differences of shapes that the tests of stiffness share."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model import Arm, Scene, Shape
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, NeoHookean, TipLoad, Weight
from tests.core.model.cases import MOST
from tests.oracles import Array

STATICS = {
    "bare": Scene(),
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
    "anticlastic": Scene(Extension(), ExactTendons(), NeoHookean(anticlastic=True)),
}
IN_WATER = (Weight(), Buoyancy(1000.0))


def with_effects(scene: Scene, *effects: object) -> Scene:
    """The scene with further effects."""
    return Scene(*scene.effects, *effects)  # type: ignore[arg-type]


def pulling(name: str, seed: int) -> Array:
    """Return random positive tensions (12,) of a paper arm, with large bends and strains [N]."""
    drawn = np.random.default_rng(seed).uniform(0.05, 0.5, (3, 4))
    return np.ravel(drawn * np.array(MOST[name])[:, None] / 2)


def pushed(scene: Scene, wrench: Array) -> Scene:
    """Return the scene with an additional force and moment on the tip."""
    there = scene.find(TipLoad) or TipLoad()
    load = TipLoad(
        tuple((np.array(there.force) + wrench[:3]).tolist()),
        tuple((np.array(there.moment) + wrench[3:]).tolist()),
    )
    return Scene(*(e for e in scene.effects if not isinstance(e, TipLoad)), load)


def scaled(arm: Arm, compliance: Array) -> Array:
    """A compliance (6, 6) per newton metre: displacements over L, forces times L."""
    size = np.repeat([arm.length, 1.0], 3)
    return np.asarray(compliance / np.outer(size, size))


def moved(start: Shape, end: Shape, at: float) -> Array:
    """Displacement over L and turn (6,) of the midline at an arc length between two shapes."""
    shift = (end.position(at) - start.position(at)) / start.arm.length
    turn = Rotation.from_matrix(end.frame(at) @ start.frame(at).T).as_rotvec()
    return np.concatenate([shift, turn])


def gap(found: Array, wanted: Array) -> float:
    """Return the distance of two vectors or matrices over the size of the expected one."""
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))
