"""Shapes that were settled last: what a plan's steps ask for, one after the other, is the same."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.mesh import FINEST_ACCURACY
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape


def settled(arm: Arm, tensions: Array, scene: Scene, accuracy: float, machine_code: bool) -> Shape:
    """Return the shape of a plan of an accuracy, a digit more accurate; raises what settle does."""
    flat, sharper = np.ravel(tensions), max(accuracy / 10, FINEST_ACCURACY)
    return _settled(arm, tuple(flat.tolist()), scene, sharper, machine_code)


@lru_cache(maxsize=8)
def _settled(
    arm: Arm, tensions: tuple[float, ...], scene: Scene, accuracy: float, machine_code: bool
) -> Shape:
    return settle(arm, tensions, scene, accuracy, compile=machine_code)
