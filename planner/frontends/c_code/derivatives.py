"""How poses along an arm answer to the tensions, to first and second order, in closed form.

Where strains are in closed form a step's pose answers to its strains by a spatial twist, its
strains to the pull of the tendons, the pull to the coefficients that are carried along the arm.
Where offsets are linear in s, the sums over tendons that a cross-section asks for are polynomials
of degree two at most. An anchorage adds those of its own tendons to the coefficients of the part
beyond. Steps are summed up to each anchorage before the tensions come in, so that the work grows
with the number of tendons, not with its square.

With the spatial twists z_k (6,) by which steps move what is beyond them, a pose becomes
exp(z_1) exp(z_2) .. g, and by the formula of Baker, Campbell and Hausdorff its own twist is

    zeta = sum_k z_k + 1/2 sum_(i<k) [z_i, z_k] + ...

so that a second derivative of zeta is the sum of the steps' own and of brackets with the sums so
far. What is asked of it is its product with a wrench, or with several of them at places along the
arm, which then add up from the tip to each step.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import size
from octoplan.model.cross_section.statics import ClosedStatics
from octoplan.model.integrators import Magnus
from octoplan.model.paths import Array, Linear
from octoplan.model.rotations import compose, exponential, inverse
from octoplan.model.stations import stations
from octoplan.model.unloaded.march_derivative import adjoint_function, step_jacobian

# Coefficients of a polynomial.
TERMS = 3


@dataclass(frozen=True, eq=False)
class PullPolynomials:
    """The coefficients of pull in (1 - s/L)^2, (1 - s/L) s/L and (s/L)^2.

    That basis keeps all digits at both ends: at a slender tip, and where an anchorage is near the
    base.

    Attributes
    ----------
    length : float
        L [m].
    own : one array a section, tip first
        (3 n_pull, n) coefficients per newton of its n tendons, term by term.
    """

    length: float
    own: tuple[Array, ...]

    @classmethod
    def of(cls, arm: Arm, statics: ClosedStatics) -> PullPolynomials | None:
        """Return the polynomials of an arm, None where an offset is not linear."""
        if not all(isinstance(path, Linear) for _, path in arm.offset_paths):
            return None
        parts = []
        for i, section in enumerate(arm.sections):
            s = section.at * np.array([0.0, 0.5, 1.0])
            maps = statics.pulls(arm, stations(arm, s, np.full(TERMS, i + 1)))
            maps = maps[:, :, list(arm.tendons_of(i + 1))]
            parts.append(_coefficients(maps, section.at / arm.length))
        return cls(arm.length, tuple(parts))

    def basis(self, s: Array) -> Array:
        """Return the three terms at arc lengths s: (3, N)."""
        v = s / self.length
        u = 1 - v
        return np.stack([u * u, u * v, v * v])

    def carried(self, T: ca.MX) -> list[ca.MX]:
        """Return the coefficients (n_pull, 3) where 0, 1, .. sections cross, of tensions T."""
        results = [ca.MX(self.own[0].shape[0] // TERMS, TERMS)]
        start = 0
        for each in self.own:
            added = ca.sparsify(ca.DM(each)) @ T[start : start + each.shape[1]]
            results.append(results[-1] + ca.reshape(added, -1, TERMS))
            start += each.shape[1]
        return results


def _coefficients(values: Array, share: float) -> Array:
    """Return (3 n_pull, n) from the values (3, n_pull, n) at 0, share / 2, share of the length.

    First the Bernstein form on that stretch, then, with t = v / share and 1 - t = u - k v, that in
    u = 1 - s/L and v = s/L.
    """
    first, middle, last = values[0], 2 * values[1] - (values[0] + values[2]) / 2, values[2]
    k = (1 - share) / share
    mixed = 2 * (middle / share - k * first)
    square = k * k * first - 2 * k * middle / share + last / share**2
    return np.concatenate([first, mixed, square])


def strain_function(statics: ClosedStatics) -> ca.Function:
    """Return (pull, data) -> (tau, xi, k, q) at one cross-section; tau is 0."""
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    strain = statics.law.reported(statics.solve(pull, data))
    return ca.Function("strain", [pull, data], [ca.densify(strain)], {"cse": True})


def twist(strain: ca.SX) -> ca.SX:
    """Return (kappa, nu) per unit reference length from (tau, xi, k, q), eq. (1)."""
    stretch = 1 + strain[3]
    return ca.vertcat(stretch * strain[:3], stretch, 0, 0)


def twist_step(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return (x, c, basis (TERMS, m), data, h) -> x across a step, with pull by coefficients c.

    x is the pose (7,), then the sum over steps so far of the spatial twists per unit of each
    coefficient (6 n_pull TERMS), column by column.
    """
    m, n, h = len(scheme.nodes), statics.n_pull, ca.SX.sym("h")
    x = ca.SX.sym("x", 7 + 6 * n * TERMS)
    c, data = ca.SX.sym("c", n * TERMS), ca.SX.sym("data", statics.n_data, m)
    basis, e = ca.SX.sym("basis", TERMS, m), ca.SX.sym("e", 3 * m)
    nodes = _Nodes(statics, ca.reshape(c, n, TERMS) @ basis, data)
    pose, local = step_jacobian(scheme, [twist(ca.vertcat(0, v)) for v in ca.vertsplit(e, 3)], h, e)
    jacobian, _ = nodes.derivatives(ca.SX(3 * m, 1))
    grown = adjoint_function()(x[:7]) @ local @ jacobian @ _by_terms(basis, n)
    after = ca.vertcat(compose(x[:7], pose), x[7:] + ca.vec(grown))
    after = ca.substitute([after], [e], [nodes.strains])[0]
    return ca.Function("twist_step", [x, c, basis, data, h], [after], {"cse": True})


def own_step(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return (pose, c, basis, data, h, wrench) -> what a step has of the Hessian by itself.

    As three parts A (6, 6), B (6, n) and C (n_pull m, n_pull m): it is B^T A B + D C D^T, with D
    the Kronecker product of the basis and the unit matrix; see the module. Pull is given by
    coefficients c (n_pull TERMS,) and a basis.
    """
    m, n, h = len(scheme.nodes), statics.n_pull, ca.SX.sym("h")
    c, data = ca.SX.sym("c", n * TERMS), ca.SX.sym("data", statics.n_data, m)
    basis, e = ca.SX.sym("basis", TERMS, m), ca.SX.sym("e", 3 * m)
    nodes = _Nodes(statics, ca.reshape(c, n, TERMS) @ basis, data)
    g, wrench, work = ca.SX.sym("g", 7), ca.SX.sym("wrench", 6), ca.SX.sym("work", 6)
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
    """Return the derivatives of pull (n,) at a step's nodes by the coefficients (n TERMS,)."""
    return ca.kron(basis.T, ca.SX.eye(n))


class _Nodes:
    """The cross-sections at a step's nodes, by pull (n_pull, m) and data (n_data, m).

    Attributes
    ----------
    strains : SX (3 m,)
        xi, k and q of each.
    """

    def __init__(self, statics: ClosedStatics, pull: ca.SX, data: ca.SX) -> None:
        self._each = list(zip(ca.horzsplit(pull), ca.horzsplit(data), strict=True))
        strain, self._derivatives = strain_function(statics), _strain_derivatives(statics)
        self.strains = ca.vertcat(*(strain(*of)[1:] for of in self._each))

    def derivatives(self, weights: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return derivatives (3 m, n_pull m) of the strains by pull, and of their sum by weights.

        Of that the second ones (n_pull m, n_pull m).
        """
        parts = zip(
            ca.vertsplit(self.strains, 3), self._each, ca.vertsplit(weights, 3), strict=True
        )
        pairs = [self._derivatives(strain, *of, weight) for strain, of, weight in parts]
        first, second = zip(*pairs, strict=True)
        return ca.diagcat(*first), ca.diagcat(*second)


def _displacement_derivatives() -> ca.Function:
    """Return Omega (6,), wrench -> Hessian and gradient of the work on how exp(Omega) moves.

    That is the logarithm of exp(Omega + change) exp(-Omega), as far as its second order, from which
    quaternions differ beyond.
    """
    omega, wrench, here = ca.SX.sym("omega", 6), ca.SX.sym("wrench", 6), ca.SX.sym("here", 7)
    pose = exponential(omega[:3], omega[3:])
    moved = compose(pose, inverse(here))
    rotation = 2 * moved[1:4]
    shift = moved[4:] - ca.cross(rotation, moved[4:]) / 2
    work = ca.hessian(ca.dot(wrench, ca.vertcat(rotation, shift)), omega)
    results = [ca.densify(value) for value in ca.substitute(list(work), [here], [pose])]
    return ca.Function("move", [omega, wrench], results, {"cse": True})


def _strain_derivatives(statics: ClosedStatics) -> ca.Function:
    """Return (xi, k, q; pull, data, weights (3,)) -> derivatives of these strains by pull.

    The first ones (3, n_pull), and the second ones (n_pull, n_pull) of their sum by weights. By the
    implicit function theorem, from the wrench that vanishes.
    """
    law, e, weights = statics.law, ca.SX.sym("e", 3), ca.SX.sym("weights", 3)
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    v = ca.SX.sym("v", size(law))
    wrench, strain = statics.wrench(v, pull, data), law.reported(v)[1:]
    value, multipliers = ca.dot(weights, strain), ca.SX.sym("lam", v.numel())
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
