"""Coulomb friction of the tendons: the effect, and its rod term.

A tendon has the unit tangent e = c/|c|. While the motor pulls in (direction 1), the tension falls
from the motor on, while the motor pays out (direction -1) it rises:

    T' = -direction mu theta' T,    theta' = |de/ds|    =>    T = T(0) exp(-direction mu theta)

The wrap angle theta is the state of the tendon. theta' depends on the rates v' of the strains,
which are additional stage variables. Their equations are the stage equations differentiated along
s,

    d/ds (body(v) + sum T tendon(v)) = (-kappa x M - nu x F, -kappa x F - R^T f)

in local components. The strains jump where other tendons end. There a tendon that continues is
bent sharply, and theta jumps by the angle between its tangents on both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import casadi as ca
import numpy as np
import scipy
from msgspec import Meta

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import CrossSection, join, size
from octoplan.model.effects.base import Effect, EffectSet
from octoplan.model.mesh import Counts, tendon_paths
from octoplan.model.paths import Array, Path
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.rod_term import RodTerm, SectionView, Sizes, TendonView, Values
from octoplan.model.rod.structure import RodPoints
from octoplan.model.rotations import norm
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import NotNegative, Sign, value

__all__ = ["Friction"]

# Number of points between base and anchorage at which a tendon is tested for crossing the midline.
_CROSSING_SAMPLES = 401


@value
class Friction(Effect):
    """Coulomb friction: ``dT/ds = -direction mu T |d(c/|c|)/ds|`` from the motor to the anchorage.

    On a circular arc of angle theta, T(L) = T(0) exp(-mu theta) while pulling in. All tendons
    slide; where a section's tendons end, those that go on are bent sharply and lose exp(-mu
    angle) there. Adds to the paper's scene torsion, the moment at the nodes, the angle that each
    tendon has turned there, and the rates of the strains: the most expensive effect. Without it a
    tendon is as tight at its end as at its motor: at mu = 0.2 a bend of 180 degrees costs half the
    tension.

    Attributes
    ----------
    mu : float
        Coefficient of friction.
    direction : int or tuple of int
        1 while the motor pulls in, -1 while it pays out; one for all tendons or one for each.
    """

    mu: NotNegative
    direction: Sign | Annotated[tuple[Sign, ...], Meta(min_length=1)] = 1

    def check_arm(self, arm: Arm) -> None:
        """See Effect: there is one direction for all tendons, or one for each."""
        if isinstance(self.direction, tuple) and len(self.direction) != arm.n_tendons:
            allowed = f"one number, or one for each of {arm.n_tendons} tendons"
            raise InputError("Friction.direction", self.direction, allowed)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return the friction of all tendons."""
        return TendonFriction(self.mu, self.direction)


@dataclass(frozen=True)
class TendonFriction(RodTerm):
    """Coulomb friction of all tendons; see Friction."""

    mu: float
    direction: int | tuple[int, ...]
    couples_sections = True
    bends = False
    n_tendon_states = 1
    section_parameters: ClassVar[Sizes] = {"dead_load": 3}
    tendon_parameters: ClassVar[Sizes] = {"signed_mu": 1, "path_rate": 4}

    @property
    def is_conservative(self) -> bool:
        """No: friction dissipates."""
        return False

    def signed_friction(self, arm: Arm) -> tuple[float, ...]:
        """Return direction mu of each tendon."""
        return tuple((self.mu * np.broadcast_to(self.direction, arm.n_tendons)).tolist())

    def n_stage_variables(self, law: CrossSection) -> int:
        """Return the number of the rates v' of the strains."""
        return size(law)

    def required_arc_lengths(self, arm: Arm) -> tuple[float, ...]:
        """Return the arc lengths at which tendons cross the midline [m].

        A tendon turns the other way from there on, so that its tension has a kink.
        """
        crossings = list[float]()
        for section, path in arm.offset_paths:
            crossings += _crossings(path, arm.sections[section].at)
        return tuple(crossings)

    def convergence_order(self, order: int, derivatives: bool, is_bent: bool) -> int:
        """Return one order less, which a fine mesh shows.

        Under loads an arm may bend to both sides, and theta' has a kink in between.
        """
        kinked = 1 if derivatives else 2
        return min(order - 1, kinked) if is_bent else order - 1

    # Tendons

    def tension_ratio(self, tendon: TendonView) -> ca.SX:
        """Return exp(-direction mu theta)."""
        return ca.exp(-tendon.load_factor * tendon.parameters["signed_mu"] * tendon.states[0])

    def tendon_state_rate(self, law: CrossSection, tendon: TendonView) -> ca.SX:
        """Return theta' = |d(c/|c|)/ds| = |c x c'| / |c|^2 with c' in the base frame [rad/m]."""
        rates = _Rates(tendon)
        c = law.tangent(tendon.strains, tendon.path, rates.define)
        kappa, _ = law.twist(tendon.strains)
        c_rate = tendon.define(rates.along(c) + ca.cross(kappa, c))
        return norm(ca.cross(c, c_rate)) / ca.sumsqr(c)

    def tendon_jump(
        self,
        law: CrossSection,
        before: Sequence[TendonView],
        after: Sequence[TendonView],
        h: ca.SX,
    ) -> ca.SX:
        """Return the angle between the tangents on both sides [rad]."""
        unit_before = _unit_tangent_at_end(law, before, h[0], 1.0)
        unit_after = _unit_tangent_at_end(law, after, h[1], 0.0)
        half = ca.fmin(norm(unit_before - unit_after) / 2, 1)
        return 2 * ca.asin(half)

    # Stage equations, differentiated along s

    def section_equations(self, law: CrossSection, section: SectionView) -> ca.SX:
        """Return -d/ds of the local wrench."""
        dead = section.from_base(section.load_factor * section.parameters["dead_load"])
        load = section.frame.T @ (section.load + dead)
        moment = ca.cross(section.kappa, section.moment) + ca.cross(section.nu, section.force)
        moment += section.frame.T @ section.distributed_moment
        force = ca.cross(section.kappa, section.force) + load
        return join(law, moment, force[0], force[1:])

    def body_equations(self, law: CrossSection, section: SectionView) -> ca.SX:
        """Return d/ds body(v)."""
        wrench = law.body(section.strains, section.body)
        by_strains = ca.jtimes(wrench, section.strains, section.variables)
        return by_strains + ca.jtimes(wrench, section.body, section.body_rate)

    def tendon_equations(self, law: CrossSection, tendon: TendonView) -> ca.SX:
        """Return d/ds tendon(v), the share of T in d/ds [T tendon(v)]."""
        rates = _Rates(tendon)
        return rates.along(law.tendon(tendon.strains, tendon.path, rates.define))

    def tension_rate_equations(self, law: CrossSection, wrench: ca.SX) -> ca.SX:
        """Return tendon(v), the share of T' in d/ds [T tendon(v)]."""
        return wrench

    # Numbers

    def section_values(self, points: RodPoints) -> Values:
        """Return the dead loads of all terms per length."""
        return {"dead_load": points.dead_load}

    def tendon_values(self, points: RodPoints, place: Counts, tendon: Counts) -> Values:
        """Return direction mu, and the derivatives of the paths along s."""
        signed_mu = np.array(self.signed_friction(points.arm))
        path_rate = tendon_paths(points.arm, points.stations, place, tendon, 1)
        return {"signed_mu": signed_mu[tendon][None], "path_rate": path_rate}

    def stage_scales(self, arm: Arm, strain: Array, balance: Array) -> tuple[Array, Array]:
        """Return the scales of strains and balance equations divided by L."""
        return strain / arm.length, balance / arm.length

    def initial_stage_variables(self, strains: Array, h: Array) -> Array:
        """Return the derivatives along s of the polynomials through the strains."""
        m = strains.shape[-2]
        slope = np.arange(1, m) * gauss(m).c[:, None] ** np.arange(m - 1)
        return np.asarray(slope @ gauss(m).powers[1:] @ strains / h[:, None, None])

    def interpolated_variables(
        self, shares: Array, strains: Array, variables: Array, h: Array
    ) -> Array:
        """Return the derivatives along s of the polynomials through strains and rates."""
        m = strains.shape[-2]
        weights = np.array([_hermite_weights(m, x, 1) for x in shares.ravel().tolist()])
        values, slopes = np.moveaxis(weights, 1, 0).reshape(2, *shares.shape, m)
        rates = np.einsum("...pm,pmn->...pn", values, strains) / h[:, None]
        return np.asarray(rates + np.einsum("...pm,pmn->...pn", slopes, variables))


class _Rates:
    """Derivatives along s of expressions of the strains and the path of a tendon."""

    def __init__(self, tendon: TendonView) -> None:
        self._define = tendon.define
        path_rate = tendon.parameters["path_rate"]
        self._known = [(tendon.strains, tendon.variables), (tendon.path, path_rate)]

    def define(self, value: ca.SX) -> ca.SX:
        """Define an intermediate and its derivative along s; return the intermediate."""
        z = self._define(value)
        is_known = any(z.shape == x.shape and ca.is_equal(z, x) for x, _ in self._known)
        if z.is_valid_input() and not is_known:
            self._known.append((z, self._define(self.along(value))))
        return z

    def along(self, value: ca.SX) -> ca.SX:
        """Return d/ds of an expression, which may contain intermediates."""
        rate = ca.SX(value.numel(), 1)
        for x, x_rate in self._known:
            rate += ca.jtimes(value, x, x_rate)
        return rate


def _unit_tangent_at_end(
    law: CrossSection, stages: Sequence[TendonView], h: ca.SX, end: float
) -> ca.SX:
    """Return the unit tangent (3,) at the end 0 or 1 of an element of length h [m].

    The strains there are those of the polynomials through strains and rates at the stages.
    """
    values, slopes = _hermite_weights(len(stages), end)
    strains = ca.horzcat(*(stage.strains for stage in stages)) @ ca.DM(values)
    rates = ca.horzcat(*(stage.variables for stage in stages)) @ ca.DM(slopes)
    c = law.tangent(stages[0].define(strains + h * rates), stages[0].path)
    return c / ca.norm_2(c)


def _hermite_weights(m: int, x: float, derivative: int = 0) -> tuple[Array, Array]:
    """Return the weights (m,) of values and of slopes at the Gauss nodes for the value at x.

    Or for the derivative there.
    """
    c = gauss(m).c
    p = np.arange(2 * m)
    values = c[:, None] ** p
    slopes = p * c[:, None] ** np.maximum(p - 1, 0)
    wanted = p * x ** np.maximum(p - 1, 0) if derivative else x**p
    weights = np.linalg.solve(np.vstack([values, slopes]).T, wanted)
    return weights[:m], weights[m:]


def _crossings(path: Path, end: float) -> list[float]:
    """Return the arc lengths up to `end` at which an offset changes its sign [m]."""

    def y(s: Any) -> Array:
        return path.evaluate(np.atleast_1d(s), end)[0]

    s = np.linspace(0.0, end, _CROSSING_SAMPLES)
    at = y(s)
    tiny = np.finfo(float).tiny
    results = list[float]()
    for i in np.flatnonzero(at[:-1] * at[1:] < 0):
        results.append(scipy.optimize.brentq(lambda s: y(s)[0], s[i], s[i + 1], xtol=tiny))
    return results + (s[1:-1][at[1:-1] == 0].tolist() if at.any() else [])
