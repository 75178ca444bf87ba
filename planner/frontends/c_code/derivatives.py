"""First and second derivatives of poses along the arm by the tensions, in closed form.

For strains in closed form, the spatial twist of a step depends on the strains, the strains on the
pull of the tendons, and the pull on coefficients that are constant between anchorages. If offsets
are linear in s, the sums over tendons that cross-sections require are polynomials of degree two at
most. An anchorage adds the terms of new tendons to the coefficients. Steps are summed up to each
anchorage before multiplication by the tensions, so that the work is linear in the number of
tendons.

With the spatial twists z_k (6,) by which steps displace everything beyond, a pose becomes
exp(z_1) exp(z_2) .. g, and by the formula of Baker, Campbell and Hausdorff the twist is

    zeta = sum_k z_k + 1/2 sum_(i<k) [z_i, z_k] + ...

so that a second derivative of zeta is the sum of the second derivatives of the steps and of
brackets with the preceding sums. The Hessian is evaluated as its product with one wrench, or with
several wrenches at points along the arm, which are accumulated from the tip to each step.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import size
from octoplan.model.cross_section.statics import ClosedStatics
from octoplan.model.equilibrium.explicit_sensitivities import adjoint_function, step_jacobian
from octoplan.model.mesh import stations
from octoplan.model.paths import Array, Linear
from octoplan.model.rod.collocation import Magnus
from octoplan.model.rotations import compose, exponential, inverse

# Coefficients of a quadratic polynomial.
TERMS = 3


@dataclass(frozen=True, eq=False)
class PullPolynomials:
    """The coefficients of pull in (1 - s/L)^2, (1 - s/L) s/L and (s/L)^2.

    This basis has no cancellation at either end: at a slender tip, or for an anchorage near the
    base.

    Attributes
    ----------
    length : float
        L [m].
    own : one array per section, tip first
        Coefficients (3 n_pull, n) per newton of the n tendons of the section, term by term.
    """

    length: float
    own: tuple[Array, ...]

    @classmethod
    def of(cls, arm: Arm, statics: ClosedStatics) -> PullPolynomials | None:
        """Return the polynomials of an arm; None if an offset is not linear or a tendon turns."""
        is_linear = all(isinstance(path, Linear) for _, path in arm.offset_paths)
        if not is_linear or any(arm.angle_paths):
            return None
        parts = []
        for i, section in enumerate(arm.sections):
            s = section.at * np.array([0.0, 0.5, 1.0])
            maps = statics.resultant_maps(arm, stations(arm, s, np.full(TERMS, i + 1)))
            maps = maps[:, :, list(arm.tendons_of(i + 1))]
            parts.append(_coefficients(maps, section.at / arm.length))
        return cls(arm.length, tuple(parts))

    def basis(self, s: Array) -> Array:
        """Return the three basis functions at arc lengths s (N,): (3, N)."""
        v = s / self.length
        u = 1 - v
        return np.stack([u * u, u * v, v * v])

    def carried(self, T: ca.MX) -> list[ca.MX]:
        """Return the coefficients (n_pull, 3) for tensions T where 0, 1, .. sections cross."""
        results = [ca.MX(self.own[0].shape[0] // TERMS, TERMS)]
        start = 0
        for each in self.own:
            added = ca.sparsify(ca.DM(each)) @ T[start : start + each.shape[1]]
            results.append(results[-1] + ca.reshape(added, -1, TERMS))
            start += each.shape[1]
        return results


def _coefficients(values: Array, share: float) -> Array:
    """Return coefficients (3 n_pull, n) from values (3, n_pull, n) at 0, share / 2 and share of L.

    Convert the values to Bernstein form on this interval, then, by t = v / share and
    1 - t = u - k v, to the basis in u = 1 - s/L and v = s/L.
    """
    first = values[0]
    middle = 2 * values[1] - (values[0] + values[2]) / 2
    last = values[2]
    k = (1 - share) / share
    mixed = 2 * (middle / share - k * first)
    square = k * k * first - 2 * k * middle / share + last / share**2
    return np.concatenate([first, mixed, square])


def strain_function(statics: ClosedStatics) -> ca.Function:
    """Return the function (pull, data) -> (tau, xi, k, q) of a cross-section; tau is 0."""
    pull = ca.SX.sym("pull", statics.n_pull)
    data = ca.SX.sym("data", statics.n_data)
    strain = statics.law.reported(statics.solve(pull, data))
    return ca.Function("strain", [pull, data], [ca.densify(strain)], {"cse": True})


def twist(strain: ca.SX) -> ca.SX:
    """Return (kappa, nu) per unit reference length from (tau, xi, k, q), eq. (1)."""
    stretch = 1 + strain[3]
    return ca.vertcat(stretch * strain[:3], stretch, 0, 0)


def twist_step(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return the function (x, c, basis (TERMS, m), data, h) -> x after a step.

    x is the pose (7,), then for each coefficient the sum over steps of the spatial twist per unit
    of the coefficient (6 n_pull TERMS), column by column. Pull is given by coefficients c.
    """
    m = len(scheme.nodes)
    n = statics.n_pull
    h = ca.SX.sym("h")
    x = ca.SX.sym("x", 7 + 6 * n * TERMS)
    c = ca.SX.sym("c", n * TERMS)
    data = ca.SX.sym("data", statics.n_data, m)
    basis = ca.SX.sym("basis", TERMS, m)
    e = ca.SX.sym("e", 3 * m)
    nodes = _Nodes(statics, ca.reshape(c, n, TERMS) @ basis, data)
    pose, local = step_jacobian(scheme, [twist(ca.vertcat(0, v)) for v in ca.vertsplit(e, 3)], h, e)
    jacobian, _ = nodes.derivatives(ca.SX(3 * m, 1))
    grown = adjoint_function()(x[:7]) @ local @ jacobian @ _by_terms(basis, n)
    after = ca.vertcat(compose(x[:7], pose), x[7:] + ca.vec(grown))
    after = ca.substitute([after], [e], [nodes.strains])[0]
    return ca.Function("twist_step", [x, c, basis, data, h], [after], {"cse": True})


def own_step(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return the function (pose, c, basis, data, h, wrench) -> Hessian of a single step.

    The result has three parts A (6, 6), B (6, n) and C (n_pull m, n_pull m) of the Hessian
    B^T A B + D C D^T, with D the Kronecker product of the basis and the unit matrix; see the
    module. Pull is given by coefficients c (n_pull TERMS,) and a basis.
    """
    m = len(scheme.nodes)
    n = statics.n_pull
    h = ca.SX.sym("h")
    c = ca.SX.sym("c", n * TERMS)
    data = ca.SX.sym("data", statics.n_data, m)
    basis = ca.SX.sym("basis", TERMS, m)
    e = ca.SX.sym("e", 3 * m)
    nodes = _Nodes(statics, ca.reshape(c, n, TERMS) @ basis, data)
    g = ca.SX.sym("g", 7)
    wrench = ca.SX.sym("wrench", 6)
    work = ca.SX.sym("work", 6)
    omega = scheme.expansion([twist(ca.vertcat(0, v)) for v in ca.vertsplit(e, 3)], h)
    moved, gradient = _displacement_derivatives()(omega, adjoint_function()(g).T @ wrench)
    along = ca.jacobian(omega, e)
    bent = ca.substitute([ca.hessian(ca.dot(work, omega), e)[0]], [work], [gradient])[0]
    jacobian, hessian = nodes.derivatives(along.T @ gradient)
    turned = along @ jacobian @ _by_terms(basis, n)
    by_pull = ca.tril2symm(ca.tril(jacobian.T @ bent @ jacobian + hessian))
    results = [ca.densify(value) for value in (moved, turned, by_pull)]
    results = ca.substitute(results, [e], [nodes.strains])
    return ca.Function("own_step", [g, c, basis, data, h, wrench], results, {"cse": True})


def _by_terms(basis: ca.SX, n: int) -> ca.SX:
    """Return the derivatives of pull (n,) at the nodes of a step by coefficients (n TERMS,)."""
    return ca.kron(basis.T, ca.SX.eye(n))


class _Nodes:
    """The cross-sections at the nodes of a step, for pull (n_pull, m) and data (n_data, m).

    Attributes
    ----------
    strains : SX (3 m,)
        xi, k and q of each cross-section.
    """

    def __init__(self, statics: ClosedStatics, pull: ca.SX, data: ca.SX) -> None:
        self._each = list(zip(ca.horzsplit(pull), ca.horzsplit(data), strict=True))
        strain = strain_function(statics)
        self._derivatives = _strain_derivatives(statics)
        self.strains = ca.vertcat(*(strain(pull, data)[1:] for pull, data in self._each))

    def derivatives(self, weights: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return first derivatives (3 m, n_pull m) of the strains by pull, and second derivatives.

        The second derivatives (n_pull m, n_pull m) are those of the weighted sum of the strains.
        """
        parts = zip(
            ca.vertsplit(self.strains, 3), self._each, ca.vertsplit(weights, 3), strict=True
        )
        pairs = [
            self._derivatives(strain, pull, data, weight) for strain, (pull, data), weight in parts
        ]
        first, second = zip(*pairs, strict=True)
        return ca.diagcat(*first), ca.diagcat(*second)


def _displacement_derivatives() -> ca.Function:
    """Return the function Omega (6,), wrench -> Hessian and gradient of work by exp(Omega).

    The work is that of the wrench on the logarithm of exp(Omega + change) exp(-Omega). The code
    uses an expression with quaternions that agrees with the logarithm to second order.
    """
    omega = ca.SX.sym("omega", 6)
    wrench = ca.SX.sym("wrench", 6)
    here = ca.SX.sym("here", 7)
    pose = exponential(omega[:3], omega[3:])
    moved = compose(pose, inverse(here))
    rotation = 2 * moved[1:4]
    shift = moved[4:] - ca.cross(rotation, moved[4:]) / 2
    work = ca.hessian(ca.dot(wrench, ca.vertcat(rotation, shift)), omega)
    results = [ca.densify(value) for value in ca.substitute(list(work), [here], [pose])]
    return ca.Function("move", [omega, wrench], results, {"cse": True})


def _strain_derivatives(statics: ClosedStatics) -> ca.Function:
    """Return the function (xi, k, q; pull, data, weights (3,)) -> derivatives of strains by pull.

    The results are first derivatives (3, n_pull), and second derivatives (n_pull, n_pull) of the
    weighted sum, by the implicit function theorem for the condition that the wrench vanishes.
    """
    law = statics.law
    e = ca.SX.sym("e", 3)
    weights = ca.SX.sym("weights", 3)
    pull = ca.SX.sym("pull", statics.n_pull)
    data = ca.SX.sym("data", statics.n_data)
    v = ca.SX.sym("v", size(law))
    wrench = statics.wrench(v, pull, data)
    strain = law.reported(v)[1:]
    value = ca.dot(weights, strain)
    multipliers = ca.SX.sym("lam", v.numel())
    inverted = ca.inv_minor(ca.jacobian(wrench, v))
    changes = -inverted @ ca.jacobian(wrench, pull)
    hessian = ca.hessian(value + ca.dot(multipliers, wrench), ca.vertcat(v, pull))[0]
    hessian = ca.substitute([hessian], [multipliers], [-inverted.T @ ca.gradient(value, v)])[0]
    along = ca.vertcat(changes, ca.SX.eye(pull.numel()))
    results = [ca.jacobian(strain, v) @ changes, along.T @ hessian @ along]
    kappa = ca.vertcat(0, (1 + e[2]) * e[:2])
    there = law.strains(kappa, ca.vertcat(1 + e[2], 0, 0))
    results = ca.substitute([ca.densify(each) for each in results], [v], [there])
    return ca.Function("strain_derivatives", [e, pull, data, weights], results, {"cse": True})
