"""How far many sets of tensions are from what is wanted, in one sweep over a coarse mesh."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.forward import explicit_map, schemes_of
from model.loaded.forward import unloaded
from model.paths import Array
from model.scene import Scene
from model.statics import is_loaded
from planner.program.problem import Problem
from planner.targets.base import Target

_FEASIBLE = 0.05
# No shape is farther off; what is no number is.
_FAR = 1e3


class Residuals:
    """Residuals of targets, of tensions, without loads.

    Whether the arm is stiff enough is left out: as if it gave way just as much as is wanted.
    """

    def __init__(self, problem: Problem, targets: tuple[Target, ...]) -> None:
        self.terms = problem.terms
        self.sweep = _sweep(problem.arm, problem.scene, problem.stations)
        self.numbers = np.concatenate([target.parameters(problem.arm) for target in targets])
        gives = [np.eye(look.width).ravel() for look in problem.looks]
        self.gives = np.concatenate([np.zeros(0), *gives])

    def __call__(self, T: Array) -> tuple[Array, Array]:
        """Return residuals and what margins lack (m, k), and by how much it is crushed (m,).

        Of tensions (m, n_tendons) [N].
        """
        m = len(T)
        poses, least = (np.array(value) for value in self.sweep.map(m)(T.T))
        tiled = (np.tile(v[:, None], m) for v in (self.numbers, self.gives))
        terms = self.terms.map(m)(poses, *tiled)
        match, approach, margin = (np.array(value).reshape(-1, m) for value in terms[:3])
        gaps = np.vstack([match, approach, np.minimum(margin, 0)]).T
        gaps, crushed = (np.nan_to_num(v, nan=_FAR) for v in (gaps, _FEASIBLE - least[0]))
        return np.clip(gaps, -_FAR, _FAR), np.clip(crushed, 0, _FAR)


@lru_cache(maxsize=64)
def _sweep(arm: Arm, scene: Scene, stations: tuple[float, ...]) -> ca.Function:
    """Return tensions -> station poses (7, K), least 1 + q, on the coarsest mesh, without loads."""
    scene = unloaded(scene) if is_loaded(scene) else scene
    scheme = "magnus6" if "magnus6" in schemes_of(scene) else "rk4"
    forward = explicit_map(arm, scene, scheme, 1, stations)
    T = ca.MX.sym("T", arm.n_tendons)
    poses, stretch = forward.function(T)[:2]
    columns = [forward.mesh.node(s) for s in stations]
    return ca.Function("sweep", [T], [poses[:, columns], ca.mmin(stretch)])
