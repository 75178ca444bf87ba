"""Kernels of the nodes: the clamp, the tip, and the forces and moments of the rod terms."""

from __future__ import annotations

import casadi as ca

from octoplan.model.rod.kernels import Kernel
from octoplan.model.rod.rod_term import NodeView, check_declared
from octoplan.model.rod.structure import RodStructure, TermStructure
from octoplan.model.rotations import unit_matrix

# Size of a pose: quaternion and position.
POSE = 7


def clamp() -> Kernel:
    """Return the kernel of the base: the pose minus the pose of the clamp."""
    pose = ca.SX.sym("g", POSE)
    clamped = ca.SX.sym("clamped", POSE)
    return Kernel("clamp", pose, {"pose": clamped}, pose - clamped)


def zero() -> Kernel:
    """Return the kernel of an unknown that is 0."""
    value = ca.SX.sym("value")
    return Kernel("zero", value, {}, value)


def tip(structure: RodStructure) -> Kernel:
    """Return the kernel of the tip: M, F minus an additional moment (3,), for sensitivities."""
    w = ca.SX.sym("w", structure.n_wrench)
    moment = ca.SX.sym("moment", 3)
    return Kernel("tip", w, {"moment": moment}, ca.vertcat(w[:3] - moment, w[3:]))


def node_kernel_name(group: int) -> str:
    """Return the name of the kernel of a group of terms at its nodes."""
    return f"node_{group}"


def node(name: str, structure: TermStructure, n_wrench: int) -> Kernel:
    """Return the kernel of a term at a node.

    Unknowns: load factor, pose, node variables of the term. Rows: minus the moment and the force on
    the node, which are the jumps of M and F from its tip side to its base side; then the equations
    of the node variables.
    """
    term = structure.term
    load_factor = ca.SX.sym("load")
    pose = ca.SX.sym("g", POSE)
    variables = ca.SX.sym("z", term.n_node_variables)
    symbols = {key: ca.SX.sym(key, size) for key, size in term.node_parameters.items()}
    view = NodeView(frame=unit_matrix(pose[:4]), variables=variables, parameters=symbols)
    force = term.node_force(view)
    check_declared(term, force, has_force=n_wrench > 3)
    wrench = ca.vertcat(term.node_moment(view), force)[:n_wrench]
    rows = ca.vertcat(-load_factor * wrench, term.node_equations(view))
    return Kernel(name, ca.vertcat(load_factor, pose, variables), symbols, rows)
