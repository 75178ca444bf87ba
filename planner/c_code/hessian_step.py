"""How poses along an arm answer to the tensions to second order, where strains are closed forms.

With spatial twists z_k (6,) by which steps move what is beyond them, a pose becomes
exp(z_1) exp(z_2) .. g, and by the formula of Baker, Campbell and Hausdorff its own twist is

    zeta = sum_k z_k + 1/2 sum_(i<k) [z_i, z_k] + ...

so that a second derivative of zeta is the sum of the steps' own and of brackets with the sums so
far (planner.c_code.tip_jacobian). What is asked of it is its product with a wrench, or with several
of them at places along the arm, which then add up from the tip to each step.
"""

from __future__ import annotations

import casadi as ca

from model.cross_section.law import size
from model.cross_section.statics import ClosedStatics
from model.integrators import Magnus
from model.rotations import compose, exponential, inverse
from model.unloaded.march_derivative import adjoint_function
from planner.c_code.pulls import TERMS
from planner.c_code.tip_jacobian import strain_function, strain_jacobian, twist


def own_step(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return (pose, c, basis, data, h, wrench) -> what a step has of the Hessian by itself.

    As three parts A (6, 6), B (6, n) and C (n_pull m, n_pull m): it is B^T A B + D C D^T, with D
    the Kronecker product of the basis and the unit matrix; see the module. Pull is given by
    coefficients c (n_pull TERMS,) and a basis.
    """
    m, h = len(scheme.nodes), ca.SX.sym("h")
    c, data = ca.SX.sym("c", statics.n_pull * TERMS), ca.SX.sym("data", statics.n_data, m)
    basis, e = ca.SX.sym("basis", TERMS, m), ca.SX.sym("e", 3 * m)
    pull = ca.reshape(c, statics.n_pull, TERMS) @ basis
    g, wrench, work = ca.SX.sym("g", 7), ca.SX.sym("wrench", 6), ca.SX.sym("work", 6)
    omega = scheme.expansion([twist(ca.vertcat(0, v)) for v in ca.vertsplit(e, 3)], h)
    moved, gradient = _move()(omega, adjoint_function()(g).T @ wrench)
    along = ca.jacobian(omega, e)
    bent = ca.substitute([ca.hessian(ca.dot(work, omega), e)[0]], [work], [gradient])[0]
    by_strains, nodes = gradient.T @ along, range(m)
    strain = strain_function(statics)
    strains = [strain(pull[:, i], data[:, i])[1:] for i in nodes]
    arguments = [(strains[i], pull[:, i], data[:, i]) for i in nodes]
    strain_by, strain_by_twice = strain_jacobian(statics), _strain_hessian(statics)
    jacobian = [strain_by(*of) for of in arguments]
    parts = [slice(3 * i, 3 * i + 3) for i in nodes]
    blocks = [[ca.SX()] * m for _ in nodes]
    for i in nodes:
        for j in range(i + 1):
            blocks[i][j] = jacobian[i].T @ bent[parts[i], parts[j]] @ jacobian[j]
            blocks[j][i] = blocks[i][j].T
        blocks[i][i] = blocks[i][i] + strain_by_twice(*arguments[i], by_strains[parts[i]].T)
    at_nodes = [along[:, part] @ slope for part, slope in zip(parts, jacobian, strict=True)]
    turned = ca.horzcat(*(sum((basis[t, i] * at_nodes[i] for i in nodes), 0) for t in range(TERMS)))
    results = [ca.densify(value) for value in (moved, turned, ca.blockcat(blocks))]
    results = ca.substitute(results, [e], [ca.vertcat(*strains)])
    return ca.Function("own_step", [g, c, basis, data, h, wrench], results, {"cse": True})


def _move() -> ca.Function:
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


def _strain_hessian(statics: ClosedStatics) -> ca.Function:
    """Return (xi, k, q; pull, data, weights (3,)) -> weighted second derivatives (n_pull, n_pull).

    By the implicit function theorem to second order, from the wrench that vanishes.
    """
    law, e, weights = statics.law, ca.SX.sym("e", 3), ca.SX.sym("weights", 3)
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    v = ca.SX.sym("v", size(law))
    wrench, value = statics.wrench(v, pull, data), ca.dot(weights, law.reported(v)[1:])
    inverted, multipliers = ca.inv_minor(ca.jacobian(wrench, v)), ca.SX.sym("lam", v.numel())
    changes = -inverted @ ca.jacobian(wrench, pull)
    both = ca.vertcat(v, pull)
    hessian = ca.hessian(value + ca.dot(multipliers, wrench), both)[0]
    hessian = ca.substitute([hessian], [multipliers], [-inverted.T @ ca.gradient(value, v)])[0]
    along = ca.vertcat(changes, ca.SX.eye(pull.numel()))
    kappa = ca.vertcat(0, (1 + e[2]) * e[:2])
    strains = law.strains(kappa, ca.vertcat(1 + e[2], 0, 0))
    result = ca.substitute([along.T @ hessian @ along], [v], [strains])[0]
    arguments = [e, pull, data, weights]
    return ca.Function("strain_hessian", arguments, [ca.densify(result)], {"cse": True})
