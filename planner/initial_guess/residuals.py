"""How far many sets of tensions are from what is wanted, in one sweep over a coarse mesh."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from model.effects import ExactTendons
from model.forward import explicit_map, schemes_of
from model.machine.buffered import Mapped
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
        if problem not in _sweeps:
            _sweeps[problem] = _sweep(problem)
        self.sweep = _sweeps[problem]
        self.numbers = np.concatenate([target.parameters(problem.arm) for target in targets])

    def __call__(self, T: Array) -> tuple[Array, Array]:
        """Return residuals and what inequalities lack (m, k), and by how much it is crushed (m,).

        Of tensions (m, n_tendons) [N].
        """
        gaps, least = self.sweep(T, np.tile(self.numbers, (len(T), 1)))
        crushed = np.nan_to_num(_FEASIBLE - least[:, 0], nan=_FAR)
        return np.clip(np.nan_to_num(gaps, nan=_FAR), -_FAR, _FAR), np.clip(crushed, 0, _FAR)


_sweeps: WeakKeyDictionary[Problem, Mapped] = WeakKeyDictionary()


def _sweep(problem: Problem) -> Mapped:
    """Return tensions, target numbers -> residuals (k,), least 1 + q, on the coarsest mesh."""
    arm, scene, stations = problem.arm, problem.scene, problem.stations
    scheme = "magnus4" if "magnus4" in schemes_of(scene) else "rk4"
    forward = explicit_map(arm, scene, scheme, 1, stations, problem.machine_code)
    T, numbers = ca.MX.sym("T", arm.n_tendons), ca.MX.sym("p", problem.terms.size1_in(1))
    poses, stretch = forward.function(T)[:2]
    compliances = ca.vertcat(
        ca.DM(0, 1), *(ca.vec(ca.DM.eye(request.width)) for request in problem.requests)
    )
    seen = poses[:, [forward.mesh.node(s) for s in stations]]
    equality, soft_residual, inequality, _ = problem.terms(seen, numbers, compliances)
    gaps = ca.vertcat(equality, soft_residual, ca.fmin(inequality, 0))
    found = [ca.densify(gaps), ca.densify(ca.mmin(stretch))]
    sweep = ca.Function("sweep", [T, numbers], found)
    # A section that takes a Newton's method to settle is a long list by itself.
    flat = not problem.machine_code and not scene.has(ExactTendons)
    return Mapped(_flat(sweep) if flat else sweep)


def _flat(function: ca.Function) -> ca.Function:
    """Return a function as one list of scalar instructions, each written once."""
    given = function.sx_in()
    return ca.Function(function.name(), given, function.call(given), {"cse": True})
