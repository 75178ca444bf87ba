"""Where many arms without loads are, between their nodes too, and their radii there."""

from __future__ import annotations

import numpy as np

from model.arm import Arm
from model.forward import explicit_map, schemes_of
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene

# Where between two nodes an arm is looked at.
_SHARES = (0.25, 0.5, 0.75, 1.0)


def many_places(arm: Arm, scene: Scene, tensions: Array, machine_code: bool) -> tuple[Array, Array]:
    """Return places (m, K, 3) of an arm under tensions (m, n_tendons), and radii (K,) there [m].

    Between the nodes they are on cubics.
    """
    m = len(tensions)
    scheme = "magnus6" if "magnus6" in schemes_of(scene) else "rk4"
    forward = explicit_map(arm, scene, scheme, 1, (), machine_code)
    poses, _ = forward.many(tensions, range(forward.mesh.steps + 1))
    u, t = poses[:, :, 4:], matrices(poses[:, :, :4].reshape(-1, 4))[:, :, 0].reshape(m, -1, 3)
    h = np.diff(forward.mesh.s)
    parts, places = [], []
    for x in _SHARES:
        rise, size = x * x * (3 - 2 * x), np.linalg.norm(np.diff(u, axis=1), axis=2)[..., None]
        ends = (1 - rise) * u[:, :-1] + rise * u[:, 1:]
        slopes = x * (1 - x) ** 2 * t[:, :-1] - x * x * (1 - x) * t[:, 1:]
        parts.append(ends + size * slopes)
        places.append(forward.mesh.s[:-1] + x * h)
    radius = arm.radius.evaluate(np.concatenate(places), arm.length)[0]
    return np.concatenate(parts, axis=1), radius
