"""What the transcription asks of the law of a cross-section: SX expressions of its strains.

Strains v are curvatures about t, n, b (torsion only where it can arise), then what extends and
shears the section, where these effects are enabled. A wrench is the local moment, then the local
forces that do work on the strains after the curvatures.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from model.machine.buffered import Mapped
from model.machine.compiled import built
from model.paths import Array
from model.rotations import norm

# Keeps the length of a tendon differentiable where it has none left, wide enough for the rounding
# of its square (1e-16) to be small beside it.
TINY = 1e-24

# Names a quantity that an expression is computed by; see model.transcription.kernels.
Name = Callable[[ca.SX], ca.SX]


@dataclass(frozen=True)
class CrossSection(ABC):
    """The law of a cross-section; a frozen value of structure alone, numbers are arguments.

    `body` are E A [N], E J [N m2], G I [N m2], k_s G A [N], and of a section that is curved at rest
    its curvature about n and b there [1/m]; `path` the offset Y = y d (2,) [m] of a tendon in the
    cross-section, along n and b, and its derivative along s [-].

    Attributes
    ----------
    extension, torsion, shear : bool
        Whether the stretch, curvature about t, and shears across n and b are strains.
    curved : bool
        Whether the section is curved at rest.
    along_at_rest : float
        The strain that extends the section, where nothing does: q = 0 or lambda = 1.
    """

    extension: bool
    torsion: bool = True
    shear: bool = False
    curved: bool = False
    along_at_rest: ClassVar[float]

    @abstractmethod
    def twist(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return curvature kappa and tangent nu (3,) per unit reference length in (t, n, b)."""

    @abstractmethod
    def strains(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """Return the strains v of kappa and nu (3,)."""

    def reported(self, v: ca.SX) -> ca.SX:
        """Return tau, xi, k (3,) per unit deformed length [1/m] and q [-] of strains v, eq. (1)."""
        kappa, nu = self.twist(v)
        return ca.vertcat(kappa / nu[0], nu[0] - 1)

    @abstractmethod
    def body(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """Return the wrench of the body."""

    @abstractmethod
    def tendon(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """Return the wrench of a tendon per newton of its tension; `name` its intermediates."""

    @abstractmethod
    def tangent(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """Return the tangent c (3,) along which a tendon pulls."""

    def run(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """Return the derivative along s (3,) of the curve that a tendon runs along."""
        return self.tangent(v, path)


def size(law: CrossSection) -> int:
    """Return the number of strains."""
    return 2 + law.torsion + law.extension + 2 * law.shear


def body_size(law: CrossSection) -> int:
    """Return how many numbers a law takes of the body."""
    return 4 + 2 * law.curved


def less_rest(law: CrossSection, v: ca.SX, body: ca.SX) -> ca.SX:
    """Return by how much strains differ from those at rest, as far as these are curvatures."""
    if not law.curved:
        return v
    none = ca.SX(0)
    return v - join(law, ca.vertcat(none, body[4:6]), none, ca.SX.zeros(2))


def components(law: CrossSection) -> list[int]:
    """Return which of the local moment and force (6,), or curvature, stretch and shears, it has.

    Those that do work on the strains, in their order.
    """
    return [0] * law.torsion + [1, 2] + [3] * law.extension + [4, 5] * law.shear


def split(law: CrossSection, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return curvatures (3,), what extends (a scalar, 0 if nothing does), and shears (2,)."""
    parts = ca.SX.zeros(6)
    parts[components(law)] = v
    return parts[:3], parts[3], parts[4:]


def join(law: CrossSection, curvature: ca.SX, along: ca.SX, shear: ca.SX) -> ca.SX:
    """Return the strains of their parts; undoes split. A wrench is joined the same way."""
    return ca.vertcat(curvature, along, shear)[components(law)]


def offset(path: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the offset of a tendon, and its derivative along s, as vectors (3,) in (t, n, b)."""
    return ca.vertcat(0, path[:2]), ca.vertcat(0, path[2:])


def turning_rate(law: CrossSection, v: ca.SX, rate: ca.SX, path: ca.SX, change: ca.SX) -> ca.SX:
    """Return |d(c/|c|)/ds| in the base frame of a tendon at a cross-section [rad/m]."""
    c = law.tangent(v, path)
    c_rate = ca.jtimes(c, v, rate) + ca.jtimes(c, path, change)
    length = ca.norm_2(c)
    unit, c_rate = c / length, c_rate / length
    across = c_rate - unit * ca.dot(unit, c_rate) + ca.cross(law.twist(v)[0], unit)
    return norm(across)


def reported(law: CrossSection, v: Array) -> Array:
    """Return tau, xi, k, q (N, 4), with shear nu_n, nu_b (N, 6), of a law's strains v (N, n).

    Curvature per unit deformed length [1/m], eq. (1).
    """
    kappa, nu = kinematics(law, v)
    stretch = nu[:, :1]
    return np.hstack([kappa / stretch, stretch - 1, nu[:, 1:] if law.shear else nu[:, 3:]])


def strains_of(law: CrossSection, rows: Array) -> Array:
    """Return a law's strains (N, n) of tau, xi, k, q, and nu_n, nu_b if given (N, 4 or 6)."""
    padded = np.hstack([rows, np.zeros((len(rows), 6 - rows.shape[1]))])
    return built(Mapped, built(_strains, law))(padded)[0]


def kinematics(law: CrossSection, v: Array) -> tuple[Array, Array]:
    """Return kappa and nu (N, 3) per unit reference length of a law's strains v (N, n)."""
    twist = built(Mapped, built(_twist, law))(v)[0]
    return twist[:, :3], twist[:, 3:]


def _twist(law: CrossSection) -> ca.Function:
    v = ca.SX.sym("v", size(law))
    return ca.Function("twist", [v], [ca.densify(ca.vertcat(*law.twist(v)))], {"cse": True})


def _strains(law: CrossSection) -> ca.Function:
    e = ca.SX.sym("e", 6)
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], e[4:])
    return ca.Function("strains", [e], [ca.densify(law.strains(kappa, nu))])
