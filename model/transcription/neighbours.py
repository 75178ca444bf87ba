"""How the numbers of an arm's equations move with a number of the arm or of its scene.

The numbers are cheap to put together, nothing is settled for them, and they are smooth: differences
of arms and scenes a little to both sides are good to nine digits or more. The mesh moves with what
it was made for: between anchorages, knots and point loads its nodes keep their shares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.errors import InputError
from model.loads import places
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.transcription.system import System

_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class NumberDerivatives:
    """Derivatives by K numbers of arm and scene.

    Attributes
    ----------
    p : (n_p, K)
        Of the numbers of the equations.
    lengths : (n, K)
        Of those of the tendons' lengths.
    s : (N + 1, K)
        Of the nodes' arc lengths [m per unit].
    """

    p: Array
    lengths: Array
    s: Array


def neighbour(
    system: System,
    arm: Arm,
    scene: Scene,
    before: Sequence[float] = (),
    after: Sequence[float] = (),
) -> System:
    """Return the equations of an arm in a scene near those of another, node by node.

    Nodes that were at arc lengths `before` are now at `after` [m]. Raises what mesh_through does.
    """
    form, places = system.of.form, landmarks(system.arm, system.scene, before)
    mesh = mesh_through(system.mesh, places, landmarks(arm, scene, after))
    result = System(arm, scene, mesh, form.stages, form.loaded, form.machine_code)
    # A quaternion has either sign.
    if result.base[:4] @ system.base[:4] < 0:
        result.base[:4] *= -1
    return result


def mesh_through(mesh: Mesh, before: Array, new: Array) -> Mesh:
    """Return a mesh with landmarks (n,) [m] as it fits their new places, node by node.

    Raises InputError where landmarks that coincide would part, or pass each other.
    """
    if np.array_equal(before, new):
        return mesh
    if before.size != new.size:
        allowed = f"as many knots and loads as before, {before.size}"
        raise InputError("places along the arm", new.size, allowed)
    order, room = np.argsort(before, kind="stable"), _SAME * mesh.s[-1]
    before, after = before[order], new[order]
    apart, ahead = np.diff(before) > room, np.diff(after)
    parted, passed = ~apart & (np.abs(ahead) > 2 * room), apart & (ahead <= room)
    for wrong, allowed in (
        (parted, "to move all that is there together: tie their keys in one unknown"),
        (passed, "to stay on its side of its neighbour"),
    ):
        if wrong.any():
            raise InputError("a place along the arm", float(before[:-1][wrong][0]), allowed)
    kept = np.concatenate([[True], apart])
    return Mesh(np.interp(mesh.s, before[kept], after[kept]), mesh.active)


def landmarks(arm: Arm, scene: Scene, at: Sequence[float] = ()) -> Array:
    """Return the arc lengths that a mesh has nodes at [m], in an order that stays."""
    knots = [s for path in arm.along for s in path.knots() if 0 < s < arm.length]
    return np.array([0.0, arm.length, *arm.anchorages, *knots, *places(arm, scene), *at])
