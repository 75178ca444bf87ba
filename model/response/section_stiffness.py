"""Stiffness of single cross-sections of a settled shape."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.effects import Extension
from model.paths import Array
from model.shape import Shape
from model.statics import LoadedStatics, loaded_statics_of
from model.unloaded.closed_form import sections


def section_stiffness(shape: Shape, s: Array) -> Array:
    """Return torsional, flexural about n and b, and axial stiffness (N, 4) at s (N,).

    The diagonal of d(wrench) / d(strain), tensions held: moments per curvature [N m2], force per
    stretch [N]. Curvature is per unit deformed length with the paper's tangent, per unit reference
    length with exact tendons. At an anchorage, those on its base side.
    """
    arm, scene = shape.arm, shape.scene
    statics, strain = loaded_statics_of(scene, arm), shape.strain(s)
    active = np.array([sum(section.at >= place for section in arm.sections) for place in s])
    T = ca.MX.sym("T", arm.n_tendons)
    at = sections(arm, statics, s, active)
    diagonal = _diagonal(statics, scene.has(Extension)).map(s.size)
    found = ca.Function("sections", [T], [diagonal(strain.T, at.pull(T), at.data)])
    return np.array(found(shape.tensions)).T


@lru_cache(maxsize=64)
def _diagonal(statics: LoadedStatics, extension: bool) -> ca.Function:
    e = ca.SX.sym("e", 4)
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    v = ca.SX.sym("v", statics.size)
    slopes = ca.diag(ca.jacobian(statics.wrench(v, pull, data), v))
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], 0, 0)
    at = ca.substitute([slopes], [v], [statics.state(kappa, nu)])[0]
    stiff = at[3] if statics.forces else data[0]
    axial = stiff if extension else ca.SX(np.inf)
    return ca.Function("diagonal", [e, pull, data], [ca.vertcat(at[:3], axial)])
