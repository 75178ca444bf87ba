"""Strains and pose along an arm without loads: their rates, their jumps, and what these need.

A state x is the pose (7,), quaternion and position [m], then the strains that the statics carry.
A cross-section's numbers d are pull, data, and the rates of both along s; see model.statics.base.
The quaternion is not held to unit length: every scheme leaves a drift of its own order in it, but
Gauss collocation, which leaves none. Whatever reads it divides by its length (`rotate` and
`matrices` of model.rotations): that is the projection to a rotation, and frames are orthonormal.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.paths import Array
from model.rotations import multiply, rotate
from model.scene import Scene
from model.statics import Statics, statics_of
from model.statics.base import curvature
from model.stations import Counts
from model.unloaded.closed_form import full_strain, sections


def state_scale(statics: Statics, length: float) -> Array:
    """Return what one unit of each component of x is worth (7 + n,), for an arm's length [m]."""
    return np.array([1.0] * 4 + [length] * 3 + [1 / length] * len(statics.names))


@lru_cache(maxsize=64)
def slope_function(statics: Statics) -> ca.Function:
    """Return (x, d) -> derivative of x along s."""
    x = ca.SX.sym("x", 7 + len(statics.names))
    pull, pull_rate = (ca.SX.sym(name, statics.n_pull) for name in ("pull", "pull_rate"))
    data, data_rate = (ca.SX.sym(name, statics.n_data) for name in ("data", "data_rate"))
    strain_rate = statics.rate(x[7:], pull, data, pull_rate, data_rate)
    slope = ca.vertcat(pose_rate(statics, x, pull, data), strain_rate)
    d = ca.vertcat(pull, data, pull_rate, data_rate)
    return ca.Function("slope", [x, d], [slope], {"cse": True})


def pose_rate(statics: Statics, x: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
    """Return the derivative (7,) of the pose along s, eq. (1)."""
    stretch = 1 + statics.stretch(x[7:], pull, data)
    kappa = stretch * curvature(statics.names, x[7:])
    turn = multiply(x[:4], ca.vertcat(0, kappa)) / 2
    return ca.vertcat(turn, rotate(x[:4], ca.vertcat(stretch, 0, 0)))


@lru_cache(maxsize=64)
def jump_function(statics: Statics) -> ca.Function:
    """Return (strain on the tip side, outer pull, inner pull, data) -> strain on the base side."""
    strain = ca.SX.sym("strain", len(statics.names))
    outer, inner = (ca.SX.sym(name, statics.n_pull) for name in ("outer", "inner"))
    data = ca.SX.sym("data", statics.n_data)
    jump = statics.jump(strain, outer, inner, data)
    return ca.Function("jump", [strain, outer, inner, data], [jump], {"cse": True})


def section_numbers(arm: Arm, statics: Statics, s: Array, active: Counts, T: ca.MX) -> ca.MX:
    """Return d (n_d, N) of the cross-sections at s (N,)."""
    at = sections(arm, statics, s, active)
    return ca.vertcat(at.pull(T), at.data, at.pull_rate(T), at.data_rate)


def full_strains(
    arm: Arm, scene: Scene, s: Array, active: Counts, strains: ca.MX, T: ca.MX
) -> ca.MX:
    """Return (tau, xi, k, q) (4, N) at stations s from the strains that are states there (n, N)."""
    statics = statics_of(scene, arm)
    at = sections(arm, statics, s, active)
    return _full_strain_function(statics).map(s.size)(strains, at.pull(T), at.data)


@lru_cache(maxsize=64)
def _full_strain_function(statics: Statics) -> ca.Function:
    strain = ca.SX.sym("strain", len(statics.names))
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    full = full_strain(statics, strain, pull, data)
    return ca.Function("full_strain", [strain, pull, data], [full])
