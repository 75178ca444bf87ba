"""Strains as they are reported, tau, xi, k, q and shears, and as a law has them."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.cross_section.law import CrossSection, size
from model.machine.buffered import Mapped
from model.paths import Array


def reported(law: CrossSection, v: Array) -> Array:
    """Return tau, xi, k, q (N, 4), with shear nu_n, nu_b (N, 6), of a law's strains v (N, n).

    Curvature per unit deformed length [1/m], eq. (1).
    """
    return _reported(law)(v)[0]


def strains_of(law: CrossSection, rows: Array) -> Array:
    """Return a law's strains (N, n) of tau, xi, k, q, and nu_n, nu_b if given (N, 4 or 6)."""
    padded = np.hstack([rows, np.zeros((len(rows), 6 - rows.shape[1]))])
    return _strains(law)(padded)[0]


def kinematics(law: CrossSection, v: Array) -> tuple[Array, Array]:
    """Return kappa and nu (N, 3) per unit reference length of a law's strains v (N, n)."""
    (found,) = _twist(law)(v)
    return found[:, :3], found[:, 3:]


@lru_cache(maxsize=32)
def _twist(law: CrossSection) -> Mapped:
    v = ca.SX.sym("v", size(law))
    return Mapped(ca.Function("twist", [v], [ca.densify(ca.vertcat(*law.twist(v)))]))


@lru_cache(maxsize=32)
def _reported(law: CrossSection) -> Mapped:
    v = ca.SX.sym("v", size(law))
    rows = ca.vertcat(law.reported(v), law.twist(v)[1][1:] if law.shear else ca.SX(0, 1))
    return Mapped(ca.Function("reported", [v], [ca.densify(rows)]))


@lru_cache(maxsize=32)
def _strains(law: CrossSection) -> Mapped:
    e = ca.SX.sym("e", 6)
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], e[4:])
    return Mapped(ca.Function("strains", [e], [ca.densify(law.strains(kappa, nu))]))
