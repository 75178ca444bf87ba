"""The potential energy of an arm, and the rows that hold its lengths and gaps; as sums of kernels.

See octoplan.model.extensions.lengths.least_energy, where they are the program that is solved.
Lengths are in units of the arm's, forces in those that bend it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from octoplan.model.cross_section.energy import EnergySection
from octoplan.model.cross_section.law import CrossSection, body_size, elastic_strains, size
from octoplan.model.extensions.obstacles.base import SIZE, signed_distance
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.element import element, rotation_quaternions
from octoplan.model.rod.equations import Equations, Term
from octoplan.model.rod.kernels import Intermediates, Kernel
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.nodes import POSE
from octoplan.model.rod.structure import RodStructure
from octoplan.model.rod.tendons import tendon_length
from octoplan.model.rotations import unit_matrix
from octoplan.model.support.machine.functions import cached


def body_energy(law: EnergySection) -> Kernel:
    """Return the kernel of a stage's energy less the work of dead generalised forces.

    Strains; weight, numbers of the body, less the forces.
    """
    n = body_size(law)
    v, weight, body = ca.SX.sym("v", size(law)), ca.SX.sym("weight"), ca.SX.sym("body", n)
    forces = ca.SX.sym("forces", size(law))
    parameters = {"weight": weight, "body": body, "forces": forces}
    energy = law.energy(elastic_strains(law, v, body), body[:4]) + ca.dot(forces, v)
    return Kernel("body_energy", v, parameters, weight * energy)


def dead_loads(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of less the work of dead loads on an element.

    q, strains; h, the resultants of dead forces beyond the stages (3, m) -> - integral of F . u'.
    """
    q, v = ca.SX.sym("q", 4), ca.SX.sym("v", size(law), m)
    h, dead = ca.SX.sym("h"), ca.SX.sym("dead", 3, m)
    twists, through = [law.twist(at) for at in ca.horzsplit(v)], Intermediates()
    turns = rotation_quaternions(through, [kappa for kappa, _ in twists], h)[:-1]
    along = [unit_matrix(turn) @ nu for turn, (_, nu) in zip(turns, twists, strict=True)]
    local = ca.horzsplit(unit_matrix(q).T @ dead)
    work = ca.vertcat(*(ca.dot(f, t) for f, t in zip(local, along, strict=True)))
    value = -h * ca.dot(ca.DM(gauss(m).b), work)
    y = ca.vertcat(q, ca.vec(v))
    return Kernel("dead_loads", y, {"h": h, "dead": dead}, value, through)


def off_midline() -> Kernel:
    """Return the kernel of less the work of a dead force off the midline: q; offset, force."""
    q = ca.SX.sym("q", 4)
    offset = ca.SX.sym("offset", 3)
    force = ca.SX.sym("force", 3)
    work = ca.dot(unit_matrix(q) @ offset, force)
    return Kernel("off_midline", q, {"offset": offset, "force": force}, -work)


def kinematics(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of an element's kinematics: the residuals of the pose at its end."""
    structure = RodStructure(law, m, has_moment=False)
    return cached(element, structure).part("kinematics", slice(-POSE, None))


def node_gap() -> Kernel:
    """Return the kernel of the gap at a node: u; the obstacle's numbers, the arm's radius, L [m].

    The obstacle's are in metres, what else there is in units of L.
    """
    u, c = ca.SX.sym("u", 3), ca.SX.sym("c", SIZE + 2)
    distance, _ = signed_distance()(c[SIZE + 1] * u, c[:SIZE])
    return Kernel("node_gap", u, {"values": c}, distance / c[SIZE + 1] - c[SIZE])


def stretched() -> Kernel:
    """Return the kernel of a tendon's energy: by how much it is longer; its stiffness."""
    e = ca.SX.sym("e")
    stiffness = ca.SX.sym("stiffness")
    return Kernel("stretched", e, {"stiffness": stiffness}, stiffness * e**2 / 2)


def longer() -> Kernel:
    """Return the kernel of what a tendon's stretch adds to its row: less the stretch."""
    e = ca.SX.sym("e")
    return Kernel("longer", e, {}, -e)


def potential_energy(of: Layout, levers: tuple[int, ...]) -> Equations:
    """Return the energy of a structure: of its states, then what tendons stretch by.

    `levers` are the nodes at which dead forces act off the midline.
    """
    law, m, n, nodes, v = of.structure.law, of.structure.stages, of.n_states, of.nodes, of.stages.T
    assert isinstance(law, EnergySection)
    terms = [
        (body_energy(law), v),
        (cached(tendon_length, law), v[:, of.crossings[0]]),
        (dead_loads(law, m), np.vstack([nodes[:-1, :4].T, of.inside])),
        (off_midline(), nodes[list(levers), :4].T),
        (stretched(), n + np.arange(of.n_tendons)[None]),
    ]
    row = [Term(kernel, y, np.zeros((1, y.shape[1]), np.int64)) for kernel, y in terms]
    return Equations(n + of.n_tendons, 1, row)


def held_rows(of: Layout, obstacles: int) -> Equations:
    """Return the rows: poses at the ends of elements, lengths of tendons, gaps at nodes."""
    law, nodes, (stage, tendon) = of.structure.law, of.nodes, of.crossings
    n, N, tendons = of.n_states, of.elements, np.arange(of.n_tendons)[None]
    poses = np.arange(POSE * N).reshape(N, POSE).T
    lengths, gaps = POSE * N + tendons, POSE * N + tendons.size + np.arange(N * obstacles)[None]
    places = np.vstack([nodes[:-1].T, of.inside, nodes[1:].T])
    terms = [
        Term(kinematics(law, of.structure.stages), places, poses),
        Term(cached(tendon_length, law), of.stages.T[:, stage], lengths[:, tendon]),
        Term(longer(), n + tendons, lengths),
        Term(node_gap(), np.repeat(nodes[1:, 4:], obstacles, axis=0).T, gaps),
    ]
    return Equations(n + tendons.size, POSE * N + tendons.size + gaps.size, terms)
