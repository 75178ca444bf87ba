"""The Jacobian of the tip: how it moves and turns with the tensions."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from model.arm import Arm
from model.forward import check_scheme
from model.loads import is_loaded
from model.machine.buffered import Buffered
from model.machine.compiled import Compile
from model.paths import Array
from model.scene import Scene
from model.settle import ACCURACY, checked_scene, settle
from model.stiffness import stiffness
from model.unloaded.tip_jacobian import tip_jacobian_function


def tip_jacobian(
    arm: Arm,
    tensions: Any,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
) -> Array:
    """Return how the tip moves [m/N] and rotates [rad/N] per tension (6, n_tendons), base frame.

    Exact for the shape on the mesh that settles it to the accuracy. Under loads derivatives come
    from the stiffness, whose mesh is refined until it is as accurate. `compile` is that of settle.

    Raises as settle does, and CompilerError.
    """
    scene = checked_scene(arm, scene)
    if is_loaded(scene):
        return stiffness(arm, tensions, scene, accuracy=accuracy, compile=compile).pose_tension
    shape = settle(arm, tensions, scene, accuracy, compile=compile)
    mesh = (check_scheme(scene, None), shape.refinement)
    call = _call(arm, shape.scene, *mesh, shape.machine_code)
    return call(shape.tensions)[0].T


@lru_cache(maxsize=64)
def _call(arm: Arm, scene: Scene, scheme: str, refinement: int, machine_code: bool) -> Buffered:
    return Buffered(tip_jacobian_function(arm, scene, scheme, refinement, machine_code))
