"""Kernels of elements and nodes: kinematics, balance, the clamp, the tip, and loads at nodes.

An element is the part of the rod between two nodes of the mesh.

With kappa_i, nu_i the strains at the Gauss stages and a, b, c the tableau
(octoplan.model.rod.collocation), poses follow from base to tip, moments and forces from tip to
base:

    R_i = R_k exp(rotation to stage i)                 R_{k+1} = R_k exp(rotation across)
    u_{k+1} = u_k + h sum_j b_j R_j nu_j               (u' = R nu, eq. (1))
    F_k = F_{k+1} + h sum_j b_j f_j                    (F' = -f)
    M_k = M_{k+1} + h sum_j b_j [(R_j nu_j) x F_j + m_j]     (M' = -u' x F - m, eq. (3))
    body(v_i) + sum T tendon(v_i) = (R_i^T M_i, R_i^T F_i)

with F_i, M_i at the stages by b_j - a_ij in place of b_j, and the dead resultant added to F_i.
Poses are integrated from the base, forces and moments from the tip, so that the balance of a stage
contains M_{k+1} and F_{k+1}. The dead loads enter by their known resultant between each stage and
the tip; f are the shape-dependent loads of the rod terms, m their moments per length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from octoplan.model.cross_section.law import join
from octoplan.model.rod.collocation import gauss, rotation_vectors, weighted_sum
from octoplan.model.rod.kernels import Intermediates, Kernel
from octoplan.model.rod.rod_term import NodeView, RodTerm, SectionView, Symbols
from octoplan.model.rod.structure import RodStructure, TermStructure, of_term
from octoplan.model.rotations import POSE, half_angle, multiply, unit_matrix
from octoplan.model.support.errors import InputError


class ElementSymbols:
    """Unknowns and parameters of one element.

    Unknowns: load factor, (q, u, M, F) at the first node, strains and further variables at the
    stages, (q, u, M, F) at the last node. Parameters: h, an additional dead force (3,) beyond the
    element and an additional moment (3,) at its last node (0 except in sensitivities), the dead
    resultant (3,) of each stage, and
    the parameters of the terms.
    """

    def __init__(self, structure: RodStructure) -> None:
        m = structure.stages
        loaded = structure.has_moment
        self.load_factor = ca.SX.sym("load", int(loaded))
        self.q = ca.SX.sym("q", 4)
        self.u = ca.SX.sym("u", 3)
        self.w = ca.SX.sym("w", structure.n_wrench)
        self.z = ca.SX.sym("v", structure.n_stage, m)
        self.v = self.z[: structure.n_strains, :]
        self.q_next = ca.SX.sym("q_next", 4)
        self.u_next = ca.SX.sym("u_next", 3)
        self.w_next = ca.SX.sym("w_next", structure.n_wrench)
        first = (self.load_factor, self.q, self.u, self.w)
        last = (self.q_next, self.u_next, self.w_next)
        self.unknowns = ca.vertcat(*first, ca.vec(self.z), *last)
        self.h = ca.SX.sym("h")
        self.force = ca.SX.sym("force", 3 * loaded)
        self.moment = ca.SX.sym("moment", 3 * loaded)
        self.dead = ca.SX.sym("dead", 3 * loaded, m)
        self.of_terms: Symbols = {}
        if loaded:
            self.of_terms = structure.symbols("uniform") | structure.symbols("section", m)
        own = {"h": self.h, "force": self.force, "moment": self.moment, "dead": self.dead}
        self.parameters = own | self.of_terms


def element(structure: RodStructure) -> Kernel:
    """Return the kernel of an element.

    Rows: the residuals of M_k and F_k; by stage, minus the local wrench and then the shares of the
    terms in their stage equations; the residuals of q_{k+1} and u_{k+1}. All vectors except the
    rows at the nodes are in the frame at the first node.
    """
    x = ElementSymbols(structure)
    intermediates = Intermediates()
    kinematics = _kinematics(structure, x, intermediates)
    if structure.has_moment:
        balance = _balance_rows(structure, x, kinematics, intermediates)
    else:
        balance = ca.SX.zeros(x.z.numel())
    rows = ca.vertcat(balance, *kinematics.rows)
    return Kernel("element", x.unknowns, x.parameters, rows, intermediates)


@dataclass(frozen=True, eq=False)
class _Kinematics:
    """Kinematics of an element.

    Attributes
    ----------
    frame_at_node : (3, 3)
        Frame at the first node.
    frames : list of (3, 3)
        Frames at the stages, relative to the first node.
    strains : list of ((3,), (3,))
        kappa and nu at the stages.
    tangents : list of (3,)
        R_i nu_i in the frame at the first node.
    rows : list
        Residuals of the quaternion (4,) and the position (3,) at the last node.
    """

    frame_at_node: ca.SX
    frames: list[ca.SX]
    strains: list[tuple[ca.SX, ca.SX]]
    tangents: list[ca.SX]
    rows: list[ca.SX]


def _kinematics(
    structure: RodStructure, x: ElementSymbols, intermediates: Intermediates
) -> _Kinematics:
    """Return the kinematics of an element."""
    twists = [structure.law.twist(v) for v in ca.horzsplit(x.v)]
    curvatures = intermediates.define_all([kappa for kappa, _ in twists])
    strains = [(kappa, nu) for kappa, (_, nu) in zip(curvatures, twists, strict=True)]
    *to_stages, across = rotation_quaternions(intermediates, curvatures, x.h)
    frames = [unit_matrix(quaternion) for quaternion in to_stages]
    pairs = zip(frames, strains, strict=True)
    tangents = intermediates.define_all([R @ nu for R, (_, nu) in pairs])
    frame_at_node = unit_matrix(x.q)
    mean_tangent = intermediates.define(weighted_sum(gauss(structure.stages).b, tangents))
    rows = [
        x.q_next - multiply(x.q, across),
        x.u_next - x.u - x.h * frame_at_node @ mean_tangent,
    ]
    return _Kinematics(frame_at_node, frames, strains, tangents, rows)


def _balance_rows(
    structure: RodStructure,
    x: ElementSymbols,
    kinematics: _Kinematics,
    intermediates: Intermediates,
) -> ca.SX:
    """Return the residuals of M_k and F_k, and the rows of the stages."""
    from_base = BaseVectors(kinematics.frame_at_node, intermediates)
    sections = [
        SectionView(
            strains=x.v[:, i],
            variables=x.z[structure.n_strains :, i],
            parameters={},
            load_factor=x.load_factor,
            frame=frame,
            kappa=kappa,
            nu=nu,
            from_base=from_base,
        )
        for i, (frame, (kappa, nu)) in enumerate(
            zip(kinematics.frames, kinematics.strains, strict=True)
        )
    ]
    loads = [_load(structure, x, section, i) for i, section in enumerate(sections)]
    if structure.has_force:
        loads = intermediates.define_all(loads)
    F, force_rows = _forces(structure, x, kinematics.frame_at_node, loads, intermediates)
    moments = [_moment(structure, x, section, i) for i, section in enumerate(sections)]
    M, moment_row = _moments(structure, x, kinematics, F, moments, intermediates)
    stage_rows = []
    for i, section in enumerate(sections):
        moment = section.frame.T @ M[i]
        force = section.frame.T @ F[i]
        stage_rows.append(-join(structure.law, moment, force[0], force[1:]))
        view = replace(
            section, moment=moment, force=force, load=loads[i], distributed_moment=moments[i]
        )
        for k, term in enumerate(structure.terms):
            view_of_term = _section_of_term(structure, x, view, k, i)
            stage_rows.append(term.section_equations(structure.law, view_of_term))
    return ca.vertcat(moment_row, *force_rows, *stage_rows)


class BaseVectors:
    """Rotation from the base frame to the frame at the first node; vectors are rotated once."""

    def __init__(self, frame_at_node: ca.SX, intermediates: Intermediates) -> None:
        self._frame_at_node = frame_at_node
        self._intermediates = intermediates
        self._rotated = list[tuple[ca.SX, ca.SX]]()

    def __call__(self, vector: ca.SX) -> ca.SX:
        """Return a vector (3,) of the base frame in the frame at the first node."""
        for given, rotated in self._rotated:
            if given is vector:
                return rotated
        rotated = self._intermediates.define(self._frame_at_node.T @ vector)
        self._rotated.append((vector, rotated))
        return rotated


def rotation_quaternions(intermediates: Intermediates, kappa: list[ca.SX], h: ca.SX) -> list[ca.SX]:
    """Return the quaternions (4,) from the first node to each stage and to the last node.

    `kappa` are the curvatures (3,) at the stages.
    """
    inner = Intermediates()
    stacked = ca.vertcat(*rotation_vectors(kappa, h, inner.define))
    vectors = ca.vertsplit(intermediates.define(stacked, inner), 3)
    squares = intermediates.define_all([ca.sumsqr(vector) for vector in vectors])
    halves = [half_angle(square) for square in squares]
    return intermediates.define_all(
        [
            ca.vertcat(half[0], half[1] * vector)
            for vector, half in zip(vectors, halves, strict=True)
        ]
    )


def _section_of_term(
    structure: RodStructure, x: ElementSymbols, section: SectionView, k: int, stage: int
) -> SectionView:
    """Return the view of a cross-section for term k."""
    first = structure.variable_slices[k].start - structure.n_strains
    last = structure.variable_slices[k].stop - structure.n_strains
    return replace(
        section,
        variables=section.variables[first:last],
        parameters=of_term(structure, k, x.of_terms, stage),
    )


def check_declared(term: RodTerm, load: ca.SX, has_force: bool) -> None:
    """Raise InputError if a term has a shape-dependent load that the rod would leave out."""
    if load.nnz() and not has_force:
        name = f"{type(term).__name__}.depends_on_shape"
        raise InputError(name, False, "True for a term with shape-dependent forces")


def _load(structure: RodStructure, x: ElementSymbols, section: SectionView, stage: int) -> ca.SX:
    """Return the shape-dependent load (3,) at a stage, in the frame at the first node [N/m]."""
    load = ca.SX(3, 1)
    for k, term in enumerate(structure.terms):
        load_of_term = term.load_per_length(_section_of_term(structure, x, section, k, stage))
        check_declared(term, load_of_term, has_force=structure.has_force)
        load += x.load_factor * load_of_term
    return load


def _moment(structure: RodStructure, x: ElementSymbols, section: SectionView, stage: int) -> ca.SX:
    """Return the moment per length (3,) at a stage, in the frame at the first node [N m/m]."""
    moment = ca.SX(3, 1)
    for k, term in enumerate(structure.terms):
        view = _section_of_term(structure, x, section, k, stage)
        moment += x.load_factor * term.moment_per_length(view)
    return moment


def _forces(
    structure: RodStructure,
    x: ElementSymbols,
    frame_at_node: ca.SX,
    loads: list[ca.SX],
    intermediates: Intermediates,
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return the forces at the stages in the frame at the first node, and the residual of F_k."""
    method = gauss(structure.stages)
    F_next = x.w_next[3:] if structure.has_force else ca.SX.zeros(3)
    beyond = [x.load_factor * dead + x.force + F_next for dead in ca.horzsplit(x.dead)]
    F = intermediates.define_all([frame_at_node.T @ force for force in beyond])
    if not structure.has_force:
        return F, []
    F = intermediates.define_all(
        [
            dead + x.h * weighted_sum(method.b - a, loads)
            for dead, a in zip(F, method.a, strict=True)
        ]
    )
    return F, [x.w[3:] - F_next - x.h * frame_at_node @ weighted_sum(method.b, loads)]


def _moments(
    structure: RodStructure,
    x: ElementSymbols,
    kinematics: _Kinematics,
    F: list[ca.SX],
    moments: list[ca.SX],
    intermediates: Intermediates,
) -> tuple[list[ca.SX], ca.SX]:
    """Return the moments at the stages in the frame at the first node, and the residual of M_k.

    `moments` are those per length at the stages.
    """
    method = gauss(structure.stages)
    parts = zip(kinematics.tangents, F, moments, strict=True)
    rates = intermediates.define_all(
        [ca.cross(tangent, force) + moment for tangent, force, moment in parts]
    )
    M_next = x.w_next[:3] + x.moment
    mean_rate = intermediates.define(weighted_sum(method.b, rates))
    row = x.w[:3] - M_next - x.h * kinematics.frame_at_node @ mean_rate
    M_local = intermediates.define(kinematics.frame_at_node.T @ M_next)
    M = intermediates.define_all(
        [M_local + x.h * weighted_sum(method.b - a, rates) for a in method.a]
    )
    return M, row


# Nodes


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
