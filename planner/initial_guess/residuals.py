"""How far many sets of tensions are from what is wanted, in one sweep over a coarse mesh."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from model.forward import explicit_map, schemes_of
from model.machine.buffered import Mapped
from model.many_poses import ManyPoses, many_poses
from model.paths import Array
from planner.program.problem import Problem
from planner.targets.base import Target

_FEASIBLE = 0.05
# No shape is farther off; what is no number is.
_FAR = 1e3


class Residuals:
    """Residuals of targets, of tensions, for a scene without loads.

    Whether the arm is stiff enough is left out: as if it gave way just as much as is wanted.
    """

    def __init__(self, problem: Problem, targets: tuple[Target, ...]) -> None:
        if problem not in _known:
            _known[problem] = _coarse_poses(problem), _gaps(problem)
        self._poses, self._gaps = _known[problem]
        self.numbers = np.concatenate([target.parameters(problem.arm) for target in targets])

    def __call__(self, T: Array) -> tuple[Array, Array]:
        """Return residuals and what inequalities lack (m, k), and by how much it is crushed (m,).

        Of tensions (m, n_tendons) [N].
        """
        poses, least = self._poses(T.T)
        seen = poses.transpose(2, 0, 1).reshape(len(T), -1)
        (gaps,) = self._gaps(seen, np.tile(self.numbers, (len(T), 1)))
        return _bounded(gaps, -_FAR), _bounded(_FEASIBLE - least, 0.0)


def _bounded(values: Array, low: float) -> Array:
    return np.asarray(np.where(np.isnan(values), _FAR, np.clip(values, low, _FAR)))


_known: WeakKeyDictionary[Problem, tuple[ManyPoses, Mapped]] = WeakKeyDictionary()


def _coarse_poses(problem: Problem) -> ManyPoses:
    """Return what finds the poses that are looked at, on the coarsest mesh."""
    scheme = "magnus4" if "magnus4" in schemes_of(problem.scene) else "rk4"
    given = (problem.arm, problem.scene, scheme, 1, problem.stations, problem.machine_code)
    forward = explicit_map(*given)
    return many_poses(forward, [forward.mesh.node(s) for s in problem.stations])


def _gaps(problem: Problem) -> Mapped:
    """Return (poses (7 K,), target numbers) -> residuals (k,), as one list of instructions."""
    poses, numbers = (ca.MX.sym("given", *problem.terms.size_in(i)) for i in range(2))
    compliances = ca.vertcat(
        ca.DM(0, 1), *(ca.vec(ca.DM.eye(request.width)) for request in problem.requests)
    )
    equality, soft_residual, inequality, _ = problem.terms(poses, numbers, compliances)
    gaps = ca.densify(ca.vertcat(equality, soft_residual, ca.fmin(inequality, 0)))
    function = ca.Function("gaps", [poses, numbers], [gaps])
    given = function.sx_in()
    return Mapped(ca.Function("gaps", given, function.call(given), {"cse": True}))
