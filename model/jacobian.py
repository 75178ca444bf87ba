"""The Jacobian of the tip: how it moves and turns with the tensions."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

from model.arm import Arm
from model.forward import explicit_map
from model.loads import is_loaded
from model.machine.buffered import Buffered
from model.machine.compiled import Compile
from model.paths import Array
from model.rotations import small_turns
from model.scene import Scene
from model.settle import ACCURACY, checked_scene, settle
from model.stiffness import stiffness
from model.unloaded.closed_form import ClosedForm
from model.unloaded.march_derivative import MarchDerivative
from model.unloaded.marched import Marched


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
    here = shape.equilibrium
    assert isinstance(here, Marched)
    if isinstance(here.march, ClosedForm):
        return MarchDerivative(here.march, shape.tensions, here.mesh.steps).pose_tension
    return _printed(arm, scene, here.scheme, here.refinement)(shape.tensions)[0].T


@lru_cache(maxsize=16)
def _printed(arm: Arm, scene: Scene, scheme: str, refinement: int) -> Buffered:
    """Return tensions -> the Jacobian of the tip: CasADi's of the equations as printed."""
    T = ca.MX.sym("T", arm.n_tendons)
    pose = explicit_map(arm, scene, scheme, refinement).function(T)[0][:, -1]
    jacobian = ca.jacobian(pose, T)
    found = ca.vertcat(jacobian[4:, :], small_turns()(pose[:4]) @ jacobian[:4, :])
    return Buffered(ca.Function("tip_jacobian", [T], [ca.densify(found)]))
