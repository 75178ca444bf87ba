"""The poses of many arms without loads at once, side by side where that is known how."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from model.forward import ExplicitMap
from model.machine.batch import Batch
from model.machine.buffered import Mapped
from model.paths import Array
from model.unloaded.closed_form import ClosedForm
from model.unloaded.pulls import PullPolynomials
from model.unloaded.statics import closed_statics

# Tensions (n_tendons, M) [N] -> poses (K, 7, M), and the least 1 + q (M,), NaN where none settles.
ManyPoses = Callable[[Array], tuple[Array, Array]]


def many_poses(forward: ExplicitMap, nodes: Sequence[int]) -> ManyPoses:
    """Return what finds the poses of a forward map at nodes in order from the base on.

    By tables of steps where strains are in closed form and offsets linear, else by CasADi. What is
    returned raises CompilerError where the map is to be compiled and cannot be.
    """
    own = np.array(nodes, np.int32)
    if isinstance(forward, ClosedForm):
        statics = closed_statics(forward.scene, forward.arm)
        polynomials = PullPolynomials.of(forward.arm, statics)
        if polynomials is not None:
            tables = Batch(forward, polynomials)
            return lambda T: tables.poses(T, own)
    T = ca.MX.sym("T", forward.function.size1_in(0))
    poses, stretch = forward.function(T)[:2]
    found = [ca.vec(ca.densify(poses[:, own.tolist()])), ca.densify(ca.mmin(stretch))]
    mapped = Mapped(ca.Function("poses", [T], found))

    def by_casadi(T: Array) -> tuple[Array, Array]:
        poses, least = mapped(T.T)
        return poses.reshape(T.shape[1], own.size, 7).transpose(1, 2, 0), least[:, 0]

    return by_casadi
