"""How the tip answers to the tensions, in scenes without loads.

Where strains are in closed form a step's pose answers to its strains by a spatial twist, its
strains to the pull of the tendons, the pull to the coefficients that are carried along the arm
(planner.c_code.pulls). Steps are summed up to each anchorage before the tensions come in, so that
the work grows with the number of tendons.
"""

from __future__ import annotations

from typing import TypeVar

import casadi as ca

from model.cross_section.law import size
from model.cross_section.statics import ClosedStatics
from model.integrators import Magnus
from model.rotations import compose
from model.unloaded.march_derivative import adjoint_function, step_jacobian
from planner.c_code.pulls import TERMS

S = TypeVar("S", ca.SX, ca.MX)


def strain_function(statics: ClosedStatics) -> ca.Function:
    """Return (pull, data) -> (tau, xi, k, q) at one cross-section; tau is 0."""
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    strain = statics.law.reported(statics.solve(pull, data))
    return ca.Function("strain", [pull, data], [ca.densify(strain)], {"cse": True})


def twist(strain: ca.SX) -> ca.SX:
    """Return (kappa, nu) per unit reference length from (tau, xi, k, q), eq. (1)."""
    stretch = 1 + strain[3]
    return ca.vertcat(stretch * strain[:3], stretch, 0, 0)


def strain_jacobian(statics: ClosedStatics) -> ca.Function:
    """Return (xi, k, q; pull, data) -> derivatives (3, n_pull) of these strains against pull.

    By the implicit function theorem from the wrench that vanishes.
    """
    law, e = statics.law, ca.SX.sym("e", 3)
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    v = ca.SX.sym("v", size(law))
    wrench, strain = statics.wrench(v, pull, data), law.reported(v)[1:]
    changes = -ca.inv_minor(ca.jacobian(wrench, v)) @ ca.jacobian(wrench, pull)
    jacobian = ca.densify(ca.jacobian(strain, v) @ changes)
    kappa = ca.vertcat(0, (1 + e[2]) * e[:2])
    result = ca.substitute([jacobian], [v], [law.strains(kappa, ca.vertcat(1 + e[2], 0, 0))])
    return ca.Function("jacobian", [e, pull, data], result, {"cse": True})


def twist_step(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return (x, c, basis (TERMS, m), data, h) -> x across a step, with pull by coefficients c.

    x is the pose (7,), then the sum over steps so far of the spatial twists per unit of each
    coefficient (6 n_pull TERMS), column by column.
    """
    m, n, h = len(scheme.nodes), statics.n_pull, ca.SX.sym("h")
    x = ca.SX.sym("x", 7 + 6 * n * TERMS)
    c, data = ca.SX.sym("c", n * TERMS), ca.SX.sym("data", statics.n_data, m)
    basis, e = ca.SX.sym("basis", TERMS, m), ca.SX.sym("e", 3 * m)
    pull = ca.reshape(c, n, TERMS) @ basis
    strain = strain_function(statics)
    strains = [strain(pull[:, i], data[:, i])[1:] for i in range(m)]
    pose, local = step_jacobian(scheme, [twist(ca.vertcat(0, v)) for v in ca.vertsplit(e, 3)], h, e)
    seen = adjoint_function()(x[:7]) @ local
    changes = strain_jacobian(statics)
    parts = [
        seen[:, 3 * i : 3 * i + 3] @ changes(strains[i], pull[:, i], data[:, i]) for i in range(m)
    ]
    grown = [sum((basis[t, i] * parts[i] for i in range(m)), ca.SX(6, n)) for t in range(TERMS)]
    after = ca.vertcat(compose(x[:7], pose), x[7:] + ca.vec(ca.horzcat(*grown)))
    after = ca.substitute([after], [e], [ca.vertcat(*strains)])[0]
    return ca.Function("twist_step", [x, c, basis, data, h], [after], {"cse": True})


def shifts_and_turns(pose: S, twists: S) -> S:
    """Return displacements and turns (6, n) at a pose (7,) from spatial twists (6, n)."""
    turns = twists[:3, :]
    return ca.vertcat(twists[3:, :] - ca.skew(pose[4:]) @ turns, turns)
