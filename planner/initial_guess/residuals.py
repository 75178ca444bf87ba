"""How far many sets of tensions are from what is wanted, in one sweep over a coarse mesh."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.forward import explicit_map, schemes_of
from model.machine.buffered import Mapped
from model.paths import Array
from model.scene import Scene
from planner.program.same import Same
from planner.program.terms import compliance_requests, stations_of, terms_function
from planner.targets.base import Target

_FEASIBLE = 0.05
# No shape is farther off; what is no number is.
_FAR = 1e3


def residuals(
    arm: Arm, scene: Scene, targets: tuple[Target, ...], tensions: Array, machine_code: bool
) -> Array:
    """Return what tensions (m, n_tendons) [N] are off by, in a scene without loads (m, k).

    The targets' residuals, what inequalities lack, and last by how much the arm is crushed.
    Whether it is stiff enough is left out: as if it gave way just as much as is wanted.
    """
    scheme, at = "magnus4" if "magnus4" in schemes_of(scene) else "rk4", stations_of(arm, targets)
    forward = explicit_map(arm, scene, scheme, 1, at, machine_code)
    structure = tuple(target.structure(arm) for target in targets)
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    poses, least = forward.many(tensions, [forward.mesh.node(s) for s in at])
    seen = poses.reshape(len(tensions), -1)
    off_by = _off_by(arm, structure, Same(targets))
    (gaps,) = off_by(seen, np.tile(numbers, (len(tensions), 1)))
    crushed = _bounded(_FEASIBLE - least, 0.0)
    return np.hstack([_bounded(gaps, -_FAR), 10 * crushed[:, None]])


def _bounded(values: Array, low: float) -> Array:
    return np.asarray(np.where(np.isnan(values), _FAR, np.clip(values, low, _FAR)))


@lru_cache(maxsize=16)
def _off_by(arm: Arm, structure: tuple[object, ...], given: Same) -> Mapped:
    """Return (poses (7 K,), target numbers) -> residuals (k,), as one list of instructions."""
    terms = terms_function(arm, given.value)
    poses, numbers = (ca.MX.sym("given", *terms.size_in(i)) for i in range(2))
    requests = compliance_requests(given.value)
    compliances = ca.vertcat(
        ca.DM(0, 1), *(ca.vec(ca.DM.eye(request.width)) for request in requests)
    )
    equality, soft_residual, inequality, _ = terms(poses, numbers, compliances)
    gaps = ca.densify(ca.vertcat(equality, soft_residual, ca.fmin(inequality, 0)))
    function = ca.Function("gaps", [poses, numbers], [gaps])
    own = function.sx_in()
    return Mapped(ca.Function("gaps", own, function.call(own), {"cse": True}))
