"""Laws of a cross-section, as SX expressions of strains, and the law of a scene.

Strains v are the curvatures about t, n, b, then stretch and shears. Torsion, stretch and shears are
strains only if the scene enables them. A wrench is the local moment, then the local forces that do
work on stretch and shears.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects.sections import ExactTendons, Extension, NeoHookean, Shear
from octoplan.model.mesh import Stations
from octoplan.model.paths import Array
from octoplan.model.rod.kernels import Name
from octoplan.model.scene import Scene

# Added to the squared length of a tendon, so that the length is differentiable at 0. The root is
# large compared with the rounding of the square (1e-16).
TINY = 1e-24

# Size of the stiffness in the numbers of the body.
STIFFNESS_SIZE = 5


@dataclass(frozen=True)
class CrossSection(ABC):
    """The law of a cross-section: a frozen value of its structure. Numbers are arguments.

    The argument `body` contains E A [N], E J about n and about b [N m2], G I [N m2], k_s G A [N],
    and the curvature at rest about n and b [1/m] of a section that is curved at rest. The argument
    `path` contains the offset Y = y d (2,) [m] of a tendon along n and b, and its derivative along
    s [-].

    Attributes
    ----------
    extension : bool
        Whether the stretch is a strain.
    torsion : bool
        Whether the curvature about t is a strain.
    shear : bool
        Whether the shears along n and b are strains.
    curved : bool
        Whether the section is curved at rest.
    along_at_rest : float
        The stretch strain at rest: q = 0 or lambda = 1.
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
        """Return the wrench of a tendon per newton of tension; `name` marks intermediates."""

    @abstractmethod
    def tangent(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """Return the tangent c (3,) along which a tendon pulls; `name` marks intermediates."""

    def tendon_rate(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """Return the derivative along s (3,) of the curve that a tendon runs along."""
        return self.tangent(v, path)


def size(law: CrossSection) -> int:
    """Return the number of strains."""
    return 2 + law.torsion + law.extension + 2 * law.shear


def body_size(law: CrossSection) -> int:
    """Return the size of `body`."""
    return STIFFNESS_SIZE + 2 * law.curved


def elastic_strains(law: CrossSection, v: ca.SX, body: ca.SX) -> ca.SX:
    """Return the strains minus the curvature at rest."""
    if not law.curved:
        return v
    none = ca.SX(0)
    return v - join(law, ca.vertcat(none, body[5:7]), none, ca.SX.zeros(2))


def components(law: CrossSection) -> list[int]:
    """Return the indices of the strains among curvatures, stretch and shears (6,).

    The same indices select the components of local moment and force that do work on the strains.
    """
    return [0] * law.torsion + [1, 2] + [3] * law.extension + [4, 5] * law.shear


def split(law: CrossSection, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return curvatures (3,), stretch strain (a scalar) and shears (2,), 0 without a strain."""
    parts = ca.SX.zeros(6)
    parts[components(law)] = v
    return parts[:3], parts[3], parts[4:]


def join(law: CrossSection, curvature: ca.SX, along: ca.SX, shear: ca.SX) -> ca.SX:
    """Return the strains of their parts, the inverse of split. Wrenches are joined likewise."""
    return ca.vertcat(curvature, along, shear)[components(law)]


def offset(path: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the offset of a tendon, and its derivative along s, as vectors (3,) in (t, n, b)."""
    return ca.vertcat(0, path[:2]), ca.vertcat(0, path[2:])


@dataclass(frozen=True)
class PaperSection(CrossSection):
    """Eqs. (8), (9) with (6): strains omega per unit deformed length, q, and shears.

    The balance is K omega + sum T Y x c = M, E A q + sum T t . c = F_t, and with shear
    k_s G A nu_n + sum T n . c = F_n, with the tangent c = t + Y' + omega x Y and Y = y d. The
    balance is linear in the strains and in the resultants of the tensions. See CrossSection.
    """

    along_at_rest: ClassVar[float] = 0.0

    def twist(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See CrossSection.twist: kappa = (1 + q) omega, eq. (1)."""
        omega, q, slide = split(self, v)
        return (1 + q) * omega, ca.vertcat(1 + q, slide)

    def strains(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See CrossSection.strains."""
        return join(self, kappa / nu[0], nu[0] - 1, nu[1:])

    def reported(self, v: ca.SX) -> ca.SX:
        """See CrossSection.reported: the strains themselves."""
        return ca.vertcat(*split(self, v)[:2])

    def body(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See CrossSection.body."""
        omega, q, slide = split(self, elastic_strains(self, v, body))
        EA, EJn, EJb, GI, GA = ca.vertsplit(body[:STIFFNESS_SIZE])
        return join(self, ca.vertcat(GI, EJn, EJb) * omega, EA * q, GA * slide)

    def tendon(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """See CrossSection.tendon."""
        moment, force = self.tendons(v, ca.vertcat(*resultants(*ca.vertsplit(path))))
        return join(self, moment, force[0], force[1:])

    def tendons(self, v: ca.SX, sums: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the moment and the force (3,) of tendons from their resultants (9,).

        The first six resultants are sufficient without torsion and shear.
        """
        tau, xi, k = ca.vertsplit(split(self, v)[0])
        T, n, b, nn, nb, bb, n_rate, b_rate, turn = ca.vertsplit(
            ca.vertcat(sums, ca.SX.zeros(9 - sums.numel()))
        )
        moment = ca.vertcat((nn + bb) * tau + turn, bb * xi - nb * k + b, nn * k - nb * xi - n)
        return moment, ca.vertcat(T + b * xi - n * k, n_rate - tau * b, b_rate + tau * n)

    def tangent(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """See CrossSection.tangent: c = t + Y' + omega x Y."""
        Y, Y_rate = offset(path)
        return name(ca.SX([1, 0, 0]) + Y_rate + ca.cross(split(self, v)[0], Y))

    def tendon_rate(self, v: ca.SX, path: ca.SX) -> ca.SX:
        """See CrossSection.tendon_rate: u_c' of eq. (6), which differs from the tangent c."""
        kappa, nu = self.twist(v)
        Y, Y_rate = offset(path)
        return nu + Y_rate + ca.cross(kappa, Y)


def resultants(n: Any, b: Any, n_rate: Any, b_rate: Any) -> tuple[Any, ...]:
    """Return the resultants of a tendon at Y = (n, b) under a tension of 1 N.

    The resultants are T, T Y, T Y Y^T (6), then T Y' and the moment t . T Y x Y' (3), which shear
    and twist a section. For the four tendons of a section of the paper, the first six are
    T1+T2+T3+T4, y (T1-T3), y (T2-T4), y^2 (T1+T3), 0 and y^2 (T2+T4).
    """
    return 1.0, n, b, n * n, n * b, b * b, n_rate, b_rate, n * b_rate - b * n_rate


@dataclass(frozen=True)
class EnergySection(CrossSection):
    """Strains are kappa, lambda = 1 + q and shears, all per unit reference length.

    The wrench is the gradient of `energy` plus the gradient of the sum of T |c|; see CrossSection.
    A subclass defines the energy, and the width of the section as a function of the stretch.
    """

    along_at_rest: ClassVar[float] = 1.0

    @abstractmethod
    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """Return the energy of a body that is straight at rest, per unit reference length [N]."""

    def width(self, stretch: ca.SX) -> ca.SX:
        """Return the width of a section relative to rest: 1 for a rigid section."""
        return ca.SX(1)

    def tangent(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """See CrossSection.tangent: c = nu + w (Y' + kappa x Y) with the width w."""
        kappa, nu = self.twist(v)
        w = name(self.width(nu[0]))
        return name(self.tangent_of_bend(w * kappa, nu, w, path))

    def tangent_of_bend(self, bend: ca.SX, nu: ca.SX, w: ca.SX, path: ca.SX) -> ca.SX:
        """Return the tangent of a tendon, a linear function of bend = w kappa (3,)."""
        Y, Y_rate = offset(path)
        return nu + w * Y_rate + ca.cross(bend, Y)

    def twist(self, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """See CrossSection.twist."""
        kappa, stretch, slide = split(self, v)
        along = stretch if self.extension else ca.SX(1)
        return kappa, ca.vertcat(along, slide)

    def strains(self, kappa: ca.SX, nu: ca.SX) -> ca.SX:
        """See CrossSection.strains."""
        return join(self, kappa, nu[0], nu[1:])

    def body(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See CrossSection.body: the gradient of the energy."""
        at = ca.SX.sym("v", size(self))
        gradient = ca.gradient(self.energy(at, body[:STIFFNESS_SIZE]), at)
        return ca.substitute([gradient], [at], [elastic_strains(self, v, body)])[0]

    def tendon(self, v: ca.SX, path: ca.SX, name: Name = ca.densify) -> ca.SX:
        """See CrossSection.tendon: the gradient of |c(v, w(v))|, (c_v + c_w w_v)^T c / |c|."""
        at = ca.SX.sym("v", size(self))
        w = ca.SX.sym("w")
        kappa, nu = self.twist(at)
        width = self.width(nu[0])
        c = self.tangent_of_bend(w * kappa, nu, w, path)
        jacobian = ca.jacobian(c, at) + ca.jacobian(c, w) @ ca.jacobian(width, at)
        here = [v, name(self.width(self.twist(v)[1][0]))]
        jacobian = ca.substitute([jacobian], [at, w], here)[0]
        tangent = self.tangent(v, path, name)
        return jacobian.T @ name(tangent / ca.sqrt(ca.sumsqr(tangent) + TINY))


@dataclass(frozen=True)
class ExactSection(EnergySection):
    """EA (lambda - 1)^2 / 2 + EJ (kappa_n^2 + kappa_b^2) / 2 + GI kappa_t^2 / 2, and shear.

    Tendons run along c = nu + y' d + y kappa x d.
    """

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See EnergySection.energy."""
        kappa, nu = self.twist(v)
        EA, EJn, EJb, GI, GA = ca.vertsplit(body)
        bend = EJn * kappa[1] ** 2 + EJb * kappa[2] ** 2 + GI * kappa[0] ** 2
        return (EA * (nu[0] - 1) ** 2 + bend + GA * ca.sumsqr(nu[1:])) / 2


@dataclass(frozen=True)
class RubberSection(EnergySection):
    """EA (l^2 + 2/l - 3) / 6 + EJ (1 + 2/l^3) / (6 l) kappa^2 + GI kappa_t^2 / (2 l), l = lambda.

    The section and the offsets of tendons shrink by l^(-1/2): c = nu + l^(-1/2) (y' d + y kappa x
    d).

    Attributes
    ----------
    anticlastic : bool
        Whether tendons shift with the section, which swells on the inside of a bend.
    """

    anticlastic: bool = field(default=False, kw_only=True)

    def energy(self, v: ca.SX, body: ca.SX) -> ca.SX:
        """See EnergySection.energy."""
        kappa, nu = self.twist(v)
        EA, EJn, EJb, GI, GA = ca.vertsplit(body)
        stretch = nu[0]
        bend = (EJn * kappa[1] ** 2 + EJb * kappa[2] ** 2) / 2
        bend *= (1 + 2 / stretch**3) / (3 * stretch)
        twist = GI * kappa[0] ** 2 / (2 * stretch)
        along = EA / 6 * (stretch**2 + 2 / stretch - 3)
        return along + bend + twist + GA * ca.sumsqr(nu[1:]) / 2

    def width(self, stretch: ca.SX) -> ca.SX:
        """See EnergySection.width: the volume is constant."""
        return 1 / ca.sqrt(stretch)

    def tangent_of_bend(self, bend: ca.SX, nu: ca.SX, w: ca.SX, path: ca.SX) -> ca.SX:
        """See EnergySection.tangent_of_bend."""
        c = super().tangent_of_bend(bend, nu, w, path)
        if self.anticlastic:
            Y, _ = offset(path)
            inward = bend[2] * Y[1] - bend[1] * Y[2]
            across = bend[2] * Y[2] + bend[1] * Y[1]
            c[0] -= (inward**2 - across**2) / (4 * nu[0])
        return c


def cross_section_of(scene: Scene, curved: bool = False, twisted: bool = True) -> CrossSection:
    """Return the law of the cross-sections of a scene.

    Parameters
    ----------
    curved : bool
        Whether the cross-sections are curved at rest.
    twisted : bool
        Whether the law has torsion, and shear if the scene has Shear.
    """
    extension = scene.has(Extension)
    shear = twisted and scene.has(Shear)
    rubber = scene.find(NeoHookean)
    if rubber is not None:
        return RubberSection(extension, twisted, shear, curved, anticlastic=rubber.anticlastic)
    kind = ExactSection if scene.has(ExactTendons) else PaperSection
    return kind(extension, twisted, shear, curved)


def body_parameters(arm: Arm, scene: Scene, at: Stations, rates: bool = False) -> Array:
    """Return the numbers of the body (n, N), or the derivatives along s; see CrossSection."""
    rest = at.rest_rate if rates else at.rest
    body = arm.section_stiffness(at.s)[int(rates)]
    shear = scene.find(Shear)
    GA = body[0] * (shear.k_s * arm.material.G / arm.material.E if shear else 0.0)
    return np.vstack([body, GA, rest])
