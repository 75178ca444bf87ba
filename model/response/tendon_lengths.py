"""Lengths of tendons along a settled shape, by quadrature."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.paths import Array
from model.scene import Scene
from model.statics import LoadedStatics, loaded_statics_of


def tendon_lengths(arm: Arm, scene: Scene, s: Array, weight: Array, strain: Array) -> Array:
    """Return the length of each tendon from base to anchorage (n_tendons,) [m].

    The sum of weight |u_c'| at arc lengths s (N,), with u_c of eq. (6), or the tangent of the
    section's energy with exact tendons; strain (N, 4 or 6) is tau, xi, k, q, and nu_n, nu_b.
    """
    statics = loaded_statics_of(scene, arm)
    slide = strain[:, 4:] if strain.shape[1] > 4 else np.zeros((len(s), 2))
    full = np.hstack([strain[:, :4], slide])
    lengths = []
    for j, (i, _) in enumerate(arm.tendons):
        section = arm.sections[i]
        inside = s < section.at
        y, y_rate, _ = section.offset.evaluate(s[inside], section.at)
        speed = _speed(statics, j)(full[inside].T, y[None, :], y_rate[None, :])
        lengths.append(float(weight[inside] @ np.array(speed).ravel()))
    return np.array(lengths)


@lru_cache(maxsize=512)
def _speed(statics: LoadedStatics, j: int) -> ca.Function:
    """Return (tau, xi, k, q, nu_n, nu_b; y; y') -> |u_c'| of tendon j."""
    e, y, y_rate = ca.SX.sym("e", 6), ca.SX.sym("y"), ca.SX.sym("y_rate")
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], e[4:])
    c = statics.run(j, statics.state(kappa, nu), kappa, nu, y, y_rate)
    return ca.Function("speed", [e, y, y_rate], [ca.norm_2(c)])
